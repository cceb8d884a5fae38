//! ANALYZE: the value of a setting with keys at one frame of a sequence, and its reason in words.

use crate::error::Error;
use crate::lens::Pull;
use crate::settings::{Interpolation, Keyed, KeyedSetting, Values};

/// A frame of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameNumber {
    /// Its number.
    pub number: i64,
    /// Where the number comes from, in words.
    pub from: &'static str,
}

/// The value of one key, and how it was found, to be added to the reason.
pub(super) type KeyValue = (f32, String);

/// The value at `frame` between `keys`, and its reason; `value_of` gives the value of the key at an index.
///
/// # Errors
/// No keys, and those of `value_of`.
pub(super) fn value_at(
    keys: &[impl Keyed],
    frame: FrameNumber,
    interpolation: Interpolation,
    value_of: impl Fn(usize) -> Result<KeyValue, Error>,
) -> Result<(f32, String), Error> {
    let Some(pull) = Pull::at(keys, frame.number) else {
        return Err(Error::settings("there are no keys").help("give at least one"));
    };
    let (from, how_from) = value_of(pull.from)?;
    let (to, how_to) = if pull.from == pull.to { (from, String::new()) } else { value_of(pull.to)? };
    let value = pull.value(interpolation, from, to);
    let FrameNumber { number, from: source } = frame;
    let [first, second] = [pull.from, pull.to].map(|place| keys[place].frame());
    let place = if pull.from == pull.to {
        format!("at the key of frame {first}")
    } else {
        format!("between keys {first} and {second}, eased {:.2} of the way from {from} to {to}", pull.eased)
    };
    Ok((value, format!("frame {number}, from {source}; {place}: {value}{how_from}{how_to}")))
}

/// The number that the keys in `values` give to the setting `keyed` at `frame`, and its reason; `None` without keys.
///
/// # Errors
/// Keys without a frame number.
pub(crate) fn number_at(
    keyed: &KeyedSetting,
    values: &Values,
    frame: Option<FrameNumber>,
) -> Result<Option<(f32, String)>, Error> {
    let Some(keys) = (keyed.keys)(values) else { return Ok(None) };
    let frame = frame.ok_or_else(|| no_frame_number(keyed.name))?;
    value_at(keys, frame, keyed.interpolation, |place| Ok((keys[place].value, String::new()))).map(Some)
}

/// The error for keys of the setting called `name` in a job without a frame number.
pub(super) fn no_frame_number(name: &str) -> Error {
    Error::settings(format!("{name} keys need the number of the frame, which is not known"))
        .with(
            "looked for",
            "`frame`, or digits before the extension of the input's name, as in shot.0042.exr",
        )
        .help("give the frame number: `frame = N`")
}
