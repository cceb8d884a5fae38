//! What is decided once for a shot, so that nothing changes between its frames but what they show.
//!
//! A few frames, evenly spread over the shot, are read and analyzed. The number of views is that of the frame that needs most; an effect that
//! is on in any of them is on in all frames. The view table follows from the number of views and the lens, and is then the same too.

use crate::error::{Error, ErrorKind};
use crate::finding::Finding;
use crate::methods::Plan;
use crate::output::atomic;
use crate::output::exr::Codec;
use crate::render::{self, Decisions, Job};
use crate::scene::{EffectKind, SceneStats};
use crate::settings::Focus;
use std::path::Path;

/// Number of frames that are looked at.
const SAMPLES: usize = 5;

/// The decisions of a shot, and where they come from.
#[derive(Debug, Default)]
#[non_exhaustive]
pub struct Steady {
    /// What is decided.
    pub decisions: Decisions,
    /// The frames that were looked at and can be prepared.
    pub looked_at: Vec<LookedAt>,
    /// Why the first of those that cannot be prepared cannot.
    pub error: Option<Error>,
}

/// A frame that was looked at.
#[derive(Debug)]
#[non_exhaustive]
pub struct LookedAt {
    /// Its number.
    pub number: i64,
    /// Its statistics; `None` for a frame that does not fit into memory.
    pub stats: Option<SceneStats>,
    /// What it needs.
    pub plan: Plan,
    /// Wall time that reading it took, in seconds.
    pub read_seconds: f64,
}

/// Decides for the shot of the frames `numbers`, of which `job_of` gives the jobs. If none of the frames that should be looked at can be
/// prepared, the first of the others that can decides alone; if none can, nothing is decided, and [`Steady::error`] says why.
///
/// # Errors
/// Those of `job_of`, a focus that nobody chose ([`check_focus`]), and [`crate::error::ErrorKind::Settings`] of the first frame where all
/// that should be looked at have such an error: the call is wrong, and not the frames.
pub fn decide(numbers: &[i64], job_of: impl Fn(i64) -> Result<Job, Error>) -> Result<Steady, Error> {
    let mut steady = Steady::default();
    let sampled = samples(numbers.len());
    let mut is_call = true;
    for &place in &sampled {
        let looked_at = look_at(numbers[place], &job_of(numbers[place])?)?;
        is_call &= looked_at.as_ref().is_err_and(|error| error.kind() == ErrorKind::Settings);
        steady.add(looked_at);
    }
    if let Some(error) = steady.error.take_if(|_| is_call) {
        return Err(error);
    }
    for place in (0..numbers.len()).filter(|place| !sampled.contains(place)) {
        if !steady.looked_at.is_empty() {
            break;
        }
        steady.add(look_at(numbers[place], &job_of(numbers[place])?)?);
    }
    Ok(steady)
}

/// What frame `number` needs, or why it cannot be prepared.
///
/// # Errors
/// A focus that nobody chose.
fn look_at(number: i64, job: &Job) -> Result<Result<LookedAt, Error>, Error> {
    let decided = if matches!(render::fits_into_memory(job), Ok(false)) {
        in_bands(number, job)
    } else {
        whole(number, job)
    };
    match decided {
        Ok((focus, frame)) => check_focus(&focus).map(|()| Ok(frame)),
        Err(error) => Ok(Err(error)),
    }
}

/// What is in focus in frame `number`, and what it needs.
fn whole(number: i64, job: &Job) -> Result<(Focus, LookedAt), Error> {
    let mut prepared = render::prepare(job)?;
    let focus = prepared.settings.lens.focus.value.clone();
    if focus != Focus::Centre {
        let calibration = prepared.calibration()?;
        prepared.decide_views(&calibration)?;
    }
    let read_seconds = prepared.clock.seconds().read;
    Ok((focus, LookedAt { number, stats: Some(prepared.stats), plan: prepared.plan, read_seconds }))
}

/// The same of a frame that does not fit into memory.
fn in_bands(number: i64, job: &Job) -> Result<(Focus, LookedAt), Error> {
    match render::in_bands(job, Codec::default())? {
        Some(bands) => {
            let frame = LookedAt { number, stats: None, plan: bands.plan().clone(), read_seconds: 0.0 };
            Ok((bands.focus().clone(), frame))
        }
        None => whole(number, job),
    }
}

/// Refuses a focus that nobody chose: what the centre of the picture shows changes from frame to frame, and focus would jump with it.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for [`Focus::Centre`].
pub fn check_focus(focus: &Focus) -> Result<(), Error> {
    if *focus != Focus::Centre {
        return Ok(());
    }
    Err(Error::settings("what is in focus in this sequence is not said")
        .with(
            "found",
            "no focus distance in the flags, in the preset, or in the frames' headers: focus would jump with what the centre of \
             each frame shows",
        )
        .help(
            "give a distance with `focus_distance`, a pixel with `focus_point = [X, Y]`, an object with `focus_object`, or \
             [[lens.focus_keys]] in a preset",
        ))
}

/// Places of the frames to look at, of `count` in order: the first, the last, and some evenly between.
fn samples(count: usize) -> Vec<usize> {
    let number = count.min(SAMPLES);
    (0..number).map(|i| if number < 2 { 0 } else { i * (count - 1) / (number - 1) }).collect()
}

impl Steady {
    /// Adds what another frame needs, or why it cannot be prepared.
    fn add(&mut self, frame: Result<LookedAt, Error>) {
        match frame {
            Ok(frame) => {
                self.decisions.join(&Decisions::of(&frame.plan, None));
                self.looked_at.push(frame);
            }
            Err(error) => {
                self.error.get_or_insert(error);
            }
        }
    }

    /// The decisions in words.
    pub fn finding(&self) -> Finding {
        if self.looked_at.is_empty() {
            return Finding::warning("shot", "no frame can be prepared: nothing is decided for the shot");
        }
        let Decisions { method, views, force, .. } = &self.decisions;
        let method = method.as_deref().unwrap_or("auto");
        let views = views.map(|views| format!(", {views} views")).unwrap_or_default();
        let effects: Vec<&str> = force.iter().copied().map(EffectKind::name).collect();
        let effects = if effects.is_empty() { "no effect".to_owned() } else { effects.join(", ") };
        let frames: Vec<String> = self.looked_at.iter().map(|frame| frame.number.to_string()).collect();
        let text = format!("{method}{views}, with {effects}; decided by frames {}", frames.join(", "));
        Finding::note("shot", text)
    }
}

/// Reads decisions from the file `path`, where [`save`] has written them.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for a file that cannot be read, and for anything in it that is no decision.
pub fn load(path: &Path) -> Result<Decisions, Error> {
    let help = "write the file with `thinlens plan SHOT --decisions FILE.toml`";
    let text = std::fs::read_to_string(path).map_err(|cause| {
        Error::settings("the decisions cannot be read").in_file(path).caused_by(cause).help(help)
    })?;
    toml::from_str(&text).map_err(|cause| {
        Error::settings("the file holds no decisions of a shot").in_file(path).caused_by(cause).help(help)
    })
}

/// Writes `decisions` to the file `path`.
///
/// # Errors
/// Those of [`atomic::write()`].
pub fn save(decisions: &Decisions, path: &Path) -> Result<(), Error> {
    let text = toml::to_string(decisions).map_err(|cause| {
        Error::output("the decisions cannot be written as TOML").in_file(path).caused_by(cause)
    })?;
    atomic::write_text(path, &text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Effort, Values};
    use crate::stack::Source;

    #[test]
    fn the_first_frame_the_last_and_some_between_are_looked_at() {
        assert_eq!(samples(0), Vec::<usize>::new());
        assert_eq!(samples(1), [0]);
        assert_eq!(samples(2), [0, 1]);
        assert_eq!(samples(5), [0, 1, 2, 3, 4]);
        assert_eq!(samples(6), [0, 1, 2, 3, 5]);
        assert_eq!(samples(101), [0, 25, 50, 75, 100]);
    }

    #[test]
    fn decisions_are_read_back_as_saved_and_a_slip_is_an_error_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shot.toml");
        let decisions = Decisions { views: Some(96), force: vec![EffectKind::Fill], ..Decisions::default() };
        save(&decisions, &path).unwrap();
        assert_eq!(load(&path).unwrap(), decisions);
        std::fs::write(&path, "views = 96\nnumbr = 3\n").unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains("numbr") && message.contains("shot.toml"), "{message}");
    }

    /// The job of a sample, or of a file that is not there.
    fn job(exists: bool, views: usize) -> Job {
        let name = if exists { "samples/fence/stack.exr" } else { "no/such.exr" };
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
        let (focus, effort) = (Some(Focus::Distance(6.0)), Some(Effort::Views(views)));
        Job::new([Source::file(file)]).with_values(Values { focus, effort, ..Values::default() })
    }

    #[test]
    fn a_frame_that_cannot_be_read_decides_nothing_and_the_next_that_can_does() {
        let numbers: Vec<i64> = (0..9).collect();
        let steady = decide(&numbers, |number| Ok(job(number == 3, 7))).unwrap();
        assert_eq!(
            samples(9).iter().filter(|place| **place == 3).count(),
            0,
            "frame 3 is not one of the five"
        );
        assert_eq!(steady.looked_at.iter().map(|frame| frame.number).collect::<Vec<_>>(), [3]);
        assert_eq!(steady.decisions.views, Some(7));
        let none = decide(&numbers, |_| Ok(job(false, 7))).unwrap();
        assert!(none.error.is_some_and(|error| error.kind() == ErrorKind::Input));
        assert_eq!((none.decisions, none.looked_at.len()), (Decisions::default(), 0));
    }

    #[test]
    fn a_wrong_call_is_an_error_of_the_shot_and_not_of_every_frame() {
        let error = decide(&[1, 2, 3], |_| Ok(job(true, 0))).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Settings);
    }

    #[test]
    fn a_focus_that_nobody_chose_is_refused() {
        let message = check_focus(&Focus::Centre).unwrap_err().to_string();
        assert!(message.contains("focus_keys") && message.contains("focus_point"), "{message}");
        for focus in [Focus::Distance(2.0), Focus::Point([1.0, 2.0]), Focus::Object("cow".to_owned())] {
            assert!(check_focus(&focus).is_ok(), "{focus:?}");
        }
    }
}
