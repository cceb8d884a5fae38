//! The `[[lens.focus_keys]]` of a preset: what is in focus at which frame.

use super::super::{Easing, Focus, FocusKey, Setting, Values};
use super::entry::Entry;
use crate::error::Error;
use toml::Spanned;
use toml::de::DeValue;

/// A key of the tables `[[lens.focus_keys]]`: its name, and how its value is checked and stored.
pub(super) struct FocusKeyPart {
    pub(super) name: &'static str,
    set: fn(&mut FocusKeyDraft, &Entry<'_>) -> Result<(), Error>,
}

/// One of the `[[lens.focus_keys]]` while it is read.
#[derive(Default)]
struct FocusKeyDraft {
    frame: Option<i64>,
    focus: Option<Focus>,
    easing: Easing,
}

/// Every key of the `[[lens.focus_keys]]`.
pub(super) static FOCUS_KEY_PARTS: [FocusKeyPart; 5] = [
    FocusKeyPart { name: "frame", set: |key, e| e.integer().map(|x| key.frame = Some(x)) },
    FocusKeyPart { name: "distance", set: |key, e| e.focus_of_key(key, "focus_distance") },
    FocusKeyPart { name: "point", set: |key, e| e.focus_of_key(key, "focus_point") },
    FocusKeyPart { name: "object", set: |key, e| e.focus_of_key(key, "focus_object") },
    FocusKeyPart { name: "easing", set: |key, e| e.one_of(&Easing::ALL).map(|x| key.easing = x) },
];

/// The focus keys of `entry`; `unknown` makes the error for an unknown key.
pub(super) fn focus_keys(
    entry: &Entry<'_>,
    unknown: impl Fn(&Entry<'_>) -> Error,
) -> Result<Vec<FocusKey>, Error> {
    let expected = "at least one table, [[lens.focus_keys]]";
    let items = entry.value.get_ref().as_array().filter(|items| !items.is_empty());
    let items = items.ok_or_else(|| entry.unsuitable(expected))?;
    let mut keys: Vec<FocusKey> = Vec::new();
    for item in items {
        let key = focus_key(entry, item, &unknown)?;
        if let Some(last) = keys.last().filter(|last| last.frame >= key.frame) {
            let what = format!("frame {} comes after frame {}", key.frame, last.frame);
            let help = "put the focus keys in rising order of frame, each frame once";
            return Err(entry.document.error(what, item.span()).help(help));
        }
        keys.push(key);
    }
    Ok(keys)
}

/// One focus key, the `item` of the list in `entry`.
fn focus_key(
    entry: &Entry<'_>,
    item: &Spanned<DeValue<'_>>,
    unknown: &impl Fn(&Entry<'_>) -> Error,
) -> Result<FocusKey, Error> {
    let table = item.get_ref().as_table();
    let table = table.ok_or_else(|| entry.unsuitable("at least one table, [[lens.focus_keys]]"))?;
    let mut draft = FocusKeyDraft::default();
    for part_entry in entry.document.entries("lens.focus_keys", table) {
        let part = FOCUS_KEY_PARTS.iter().find(|part| part.name == part_entry.key);
        (part.ok_or_else(|| unknown(&part_entry))?.set)(&mut draft, &part_entry)?;
    }
    let FocusKeyDraft { frame, focus, easing } = draft;
    let lacks = |what: &str, help: &str| {
        entry.document.error(format!("a focus key has no {what}"), item.span()).help(help)
    };
    let frame = frame.ok_or_else(|| lacks("frame", "give its frame: frame = 1"))?;
    let help = "give its focus: distance = 2.0, point = [x, y] or object = \"NAME\"";
    let focus = focus.ok_or_else(|| lacks("focus", help))?;
    Ok(FocusKey { frame, focus, easing })
}

impl Entry<'_> {
    /// Stores the focus of `key`, a value of the setting called `setting`, unless another line has set it.
    fn focus_of_key(&self, key: &mut FocusKeyDraft, setting: &str) -> Result<(), Error> {
        let setting = Setting::by_key(setting).expect("each way to focus has a setting");
        let value = self.setting(setting)?;
        if key.focus.is_some() {
            let what = "'distance', 'point' and 'object' exclude one another";
            let help = "keep one of them, or move the other to a [[lens.focus_keys]] of its own";
            return Err(self.document.error(what, self.key_span.clone()).help(help));
        }
        let mut values = Values::default();
        setting.set(&mut values, &value);
        key.focus = values.focus;
        Ok(())
    }
}
