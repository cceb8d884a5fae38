//! The keys of a preset along a sequence of frames: `[[lens.focus_keys]]`, `[[lens.f_number_keys]]`, `[[lens.focal_length_keys]]`.

use super::super::{Easing, Focus, FocusKey, Keyed, KeyedSetting, NumberKey, Setting, Value, Values};
use super::entry::Entry;
use crate::error::Error;
use toml::Spanned;
use toml::de::DeValue;

/// The list of focus keys, with its table.
pub(super) const FOCUS_KEYS: &str = "lens.focus_keys";

/// A name in the tables of a list of keys, and how its value is checked and stored in a draft.
pub(super) struct Part<Draft> {
    pub(super) name: &'static str,
    set: fn(&mut Draft, &Entry<'_>) -> Result<(), Error>,
}

/// One of the `[[lens.focus_keys]]` while it is read.
#[derive(Default)]
pub(super) struct FocusKeyDraft {
    frame: Option<i64>,
    focus: Option<Focus>,
    easing: Easing,
}

/// Every name in the `[[lens.focus_keys]]`.
pub(super) static FOCUS_KEY_PARTS: [Part<FocusKeyDraft>; 5] = [
    Part { name: "frame", set: |key, e| e.integer().map(|x| key.frame = Some(x)) },
    Part { name: "distance", set: |key, e| e.focus_of_key(key, "focus_distance") },
    Part { name: "point", set: |key, e| e.focus_of_key(key, "focus_point") },
    Part { name: "object", set: |key, e| e.focus_of_key(key, "focus_object") },
    Part { name: "easing", set: |key, e| e.one_of(&Easing::ALL).map(|x| key.easing = x) },
];

/// A key with a number while it is read.
pub(super) struct NumberKeyDraft {
    setting: &'static Setting,
    frame: Option<i64>,
    value: Option<f32>,
    easing: Easing,
}

/// Every name in the tables of keys with numbers.
pub(super) static NUMBER_KEY_PARTS: [Part<NumberKeyDraft>; 3] = [
    Part { name: "frame", set: |key, e| e.integer().map(|x| key.frame = Some(x)) },
    Part {
        name: "value",
        set: |key, e| {
            if let Value::Number(number) = e.setting(key.setting)? {
                key.value = Some(number);
            }
            Ok(())
        },
    },
    Part { name: "easing", set: |key, e| e.one_of(&Easing::ALL).map(|x| key.easing = x) },
];

/// The focus keys of `entry`; `unknown` makes the error for an unknown name.
pub(super) fn focus_keys(
    entry: &Entry<'_>,
    unknown: impl Fn(&Entry<'_>) -> Error,
) -> Result<Vec<FocusKey>, Error> {
    list(entry, FOCUS_KEYS, |item| {
        let draft = FocusKeyDraft::default();
        let FocusKeyDraft { frame, focus, easing } =
            drafted(item, (FOCUS_KEYS, &FOCUS_KEY_PARTS), draft, &unknown)?;
        let lacks = |what: &str, help: &str| lacks(item, &format!("a focus key has no {what}"), help);
        let frame = frame.ok_or_else(|| lacks("frame", "give its frame: frame = 1"))?;
        let help = "give its focus: distance = 2.0, point = [x, y] or object = \"NAME\"";
        let focus = focus.ok_or_else(|| lacks("focus", help))?;
        Ok(FocusKey { frame, focus, easing })
    })
}

/// The keys of `entry`, which is the list of `keyed`; `unknown` makes the error for an unknown name.
pub(super) fn number_keys(
    entry: &Entry<'_>,
    keyed: &KeyedSetting,
    unknown: impl Fn(&Entry<'_>) -> Error,
) -> Result<Vec<NumberKey>, Error> {
    list(entry, keyed.path, |item| {
        let draft =
            NumberKeyDraft { setting: keyed.setting(), frame: None, value: None, easing: Easing::default() };
        let draft = drafted(item, (keyed.path, &NUMBER_KEY_PARTS), draft, &unknown)?;
        let lacks =
            |what: &str, help: &str| lacks(item, &format!("a key of {} has no {what}", entry.key), help);
        let frame = draft.frame.ok_or_else(|| lacks("frame", "give its frame: frame = 1"))?;
        let value = draft.value.ok_or_else(|| lacks("value", "give its value: value = 4.0"))?;
        Ok(NumberKey { frame, value, easing: draft.easing })
    })
}

/// One table of a list: the entry of the list, and the table.
type Item<'e, 'a> = (&'e Entry<'a>, &'a Spanned<DeValue<'a>>);

/// The keys of the list in `entry`, which is called `path`, each read by `read`.
fn list<K: Keyed>(
    entry: &Entry<'_>,
    path: &str,
    read: impl Fn(Item<'_, '_>) -> Result<K, Error>,
) -> Result<Vec<K>, Error> {
    let items = entry.value.get_ref().as_array().filter(|items| !items.is_empty());
    let items = items.ok_or_else(|| not_a_list(entry, path))?;
    let mut keys: Vec<K> = Vec::new();
    for item in items {
        let key = read((entry, item))?;
        if let Some(last) = keys.last().filter(|last| last.frame() >= key.frame()) {
            let what = format!("frame {} comes after frame {}", key.frame(), last.frame());
            let help = "put the keys in rising order of frame, each frame once";
            return Err(entry.document.error(what, item.span()).help(help));
        }
        keys.push(key);
    }
    Ok(keys)
}

/// The names of one table of the list called `path`, stored in `draft` as `parts` say.
fn drafted<Draft>(
    (entry, item): Item<'_, '_>,
    (path, parts): (&'static str, &[Part<Draft>]),
    mut draft: Draft,
    unknown: &impl Fn(&Entry<'_>) -> Error,
) -> Result<Draft, Error> {
    let table = item.get_ref().as_table().ok_or_else(|| not_a_list(entry, path))?;
    for part_entry in entry.document.entries(path, table) {
        let part = parts.iter().find(|part| part.name == part_entry.key);
        (part.ok_or_else(|| unknown(&part_entry))?.set)(&mut draft, &part_entry)?;
    }
    Ok(draft)
}

fn not_a_list(entry: &Entry<'_>, path: &str) -> Error {
    entry.unsuitable(&format!("at least one table, [[{path}]]"))
}

fn lacks((entry, item): Item<'_, '_>, what: &str, help: &str) -> Error {
    entry.document.error(what, item.span()).help(help)
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
