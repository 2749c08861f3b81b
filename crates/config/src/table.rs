//! One table of a run file, key by key.

use std::path::Path;

use toml::de::DeValue;

use crate::fault::{escaped, shown, unknown};
use crate::key::{Key, OnResume, tables_with};
use crate::names;
use crate::paths;
use crate::reader::{Document, MOST, Set};
use crate::value::{Value, Whole};

impl<'t> Document<'t> {
    /// Reads a table: `read` asks for its keys; the keys it does not ask for are faults.
    pub fn table<T>(
        &mut self,
        name: &'static str,
        read: impl FnOnce(&mut Table<'_, 't>) -> T,
    ) -> T {
        self.tables.insert(name);
        let header = format!("[{name}]\n");
        self.resolved.push_str(&header);
        self.portable.push_str(&header);
        let mut table = Table::new(self, name);
        let result = read(&mut table);
        let known = table.known();
        self.resolved.push('\n');
        let mut strangers = vec![];
        if let Some((key, value)) = self.root.get_key_value(name) {
            let line = self.line(key.span().start);
            match value.get_ref() {
                DeValue::Table(found) => {
                    let found = found
                        .keys()
                        .filter(|key| !known.contains(&key.get_ref().as_ref()));
                    for key in found.take(MOST) {
                        let line = self.line(key.span().start);
                        strangers.push((line, key.get_ref().to_string()));
                    }
                }
                DeValue::Array(_) => {
                    let message =
                        format!("expected one table, [{name}], found a list of them, [[{name}]]");
                    self.fault(line, name, message);
                }
                _ => {
                    let message = format!("expected a table: [{name}] on a line of its own");
                    self.fault(line, name, message);
                }
            }
        }
        for set in &self.sets {
            if set.table == name && !known.contains(&set.key) {
                strangers.push((0, set.key.to_owned()));
            }
        }
        for (line, key) in strangers {
            let message = match tables_with(self.all, &key).as_slice() {
                [] => unknown("key", &key, &known),
                tables => format!("unknown key; it belongs to [{}]", tables.join("] or [")),
            };
            self.fault(line, &format!("{name}.{key}"), message);
        }
        result
    }
}

/// A path as it was given and made absolute.
pub(crate) struct Given {
    /// With `~` and variables filled in.
    text: String,
    pub(crate) path: String,
}

impl Given {
    /// The path as a message says it.
    pub(crate) fn shown(&self) -> String {
        escaped(&self.text)
    }
}

/// One table being read.
pub struct Table<'d, 't> {
    document: &'d mut Document<'t>,
    name: &'static str,
    known: Vec<&'static str>,
    /// What a change of the next key means for a run that is resumed.
    on_resume: OnResume,
}

impl<'d, 't> Table<'d, 't> {
    pub(crate) fn new(document: &'d mut Document<'t>, name: &'static str) -> Self {
        Self {
            document,
            name,
            known: vec![],
            on_resume: OnResume::Fixed,
        }
    }

    /// Keys that were asked for.
    pub(crate) fn known(self) -> Vec<&'static str> {
        self.known
    }

    /// Says what a change of the next key means for a run that is resumed; for others it is
    /// [`OnResume::Fixed`].
    pub fn on_resume(&mut self, on_resume: OnResume) -> &mut Self {
        self.on_resume = on_resume;
        self
    }

    /// Adds a fault at a key.
    pub fn fault(&mut self, key: &str, message: impl Into<String>) {
        self.document
            .fault_at(&format!("{}.{key}", self.name), message);
    }

    /// A key of an earlier version: a fault that says what to write instead.
    pub(crate) fn replaced(&mut self, key: &'static str, message: &str) {
        self.known.push(key);
        let set = |set: &Set<'_>| set.table == self.name && set.key == key;
        let table = self.document.root.get(self.name);
        let table = table.and_then(|table| table.get_ref().as_table());
        let found = table.is_some_and(|table| table.get(key).is_some());
        if found || self.document.sets.iter().any(set) {
            self.fault(key, message);
        }
    }

    /// Notes that a key has to be there; not where a fault may be the reason that it is not.
    pub(crate) fn absent(&mut self, key: &str, message: &str) {
        let path = format!("{}.{key}", self.name);
        let told = self.document.faults.iter().any(|fault| fault.key == path);
        if self.document.is_whole() && !told {
            self.fault(key, message);
        }
    }

    /// Notes that a file that a key names is not there.
    pub(crate) fn missing(&mut self, key: &str, message: String) {
        if !self.document.lenient {
            self.fault(key, message);
        }
    }

    /// Writes a key of the resolved file.
    fn write<T: Value>(&mut self, key: &str, value: &T) {
        let line = format!("{key} = {}\n", value.write());
        self.document.resolved.push_str(&line);
        self.document.portable.push_str(&line);
    }

    /// The value of a key where there is one; what is wrong with its type.
    fn look_up<T: Value>(&mut self, key: &'static str) -> Option<Result<T, String>> {
        self.known.push(key);
        self.document.keys.push(Key {
            table: self.name,
            key,
            on_resume: std::mem::replace(&mut self.on_resume, OnResume::Fixed),
        });
        let document = &*self.document;
        let mut sets = document.sets.iter().rev();
        if let Some(set) = sets.find(|set| set.table == self.name && set.key == key) {
            return Some(T::read_set(&set.value, set.raw));
        }
        let table = document.root.get(self.name)?.get_ref().as_table()?;
        Some(T::read(table.get(key)?.get_ref()))
    }

    /// The value of a key, or its default where there is none or `allowed` says what is wrong
    /// with it.
    pub(crate) fn value<T: Value>(
        &mut self,
        key: &'static str,
        default: T,
        allowed: impl FnOnce(&T) -> Result<(), String>,
    ) -> T {
        let found = self.look_up::<T>(key);
        let value = found.map(|found| found.and_then(|value| allowed(&value).map(|()| value)));
        let value = match value {
            Some(Ok(value)) => value,
            Some(Err(message)) => {
                self.fault(key, message);
                default
            }
            None => default,
        };
        self.write(key, &value);
        value
    }

    /// A run's name: the file's by default.
    pub(crate) fn run_name(&mut self, key: &'static str, stem: &str) -> String {
        let default = names::of_file(stem);
        let before = self.document.faults.len();
        let name = self.value(key, default.clone(), |name: &String| {
            names::check(name).map_err(|why| match names::of_file(name) {
                near if names::check(&near).is_ok() => format!("{why}; '{near}' is one"),
                _ => why,
            })
        });
        if name == default
            && self.document.faults.len() == before
            && let Err(why) = names::check(&name)
        {
            let message = format!(
                "the file's name '{}' gives none, so set run.name: {why}",
                shown(stem)
            );
            self.fault(key, message);
        }
        name
    }

    /// A path; none where there is none or it is empty.
    pub(crate) fn path(&mut self, key: &'static str) -> Option<Given> {
        let text = match self.look_up::<String>(key) {
            Some(Ok(text)) => text,
            Some(Err(message)) => {
                self.fault(key, message);
                String::new()
            }
            None => String::new(),
        };
        let base = self.document.base.clone();
        let expanded = match text.as_str() {
            "" => Ok(None),
            _ => paths::expand(&text, |name| std::env::var_os(name)).and_then(|expanded| {
                let path = paths::absolute(&expanded, base.as_deref())?;
                let text = if expanded == text { text } else { expanded };
                Ok(Some(Given { text, path }))
            }),
        };
        match expanded {
            Ok(given) => {
                let path = given.as_ref().map_or("", |given| given.path.as_str());
                let written = paths::written(path);
                let name = Path::new(path).file_name().unwrap_or_default();
                let line = |value: String| format!("{key} = {}\n", value.write());
                self.document.resolved.push_str(&line(written));
                let name = line(name.to_string_lossy().into_owned());
                self.document.portable.push_str(&name);
                given
            }
            Err(message) => {
                self.fault(key, message);
                None
            }
        }
    }

    /// A file that must be there, where the key is; its absolute path.
    pub fn file(&mut self, key: &'static str) -> Option<String> {
        let given = self.on_resume(OnResume::Input).path(key)?;
        if !Path::new(&given.path).is_file() {
            self.missing(key, format!("no file '{}'", given.shown()));
        }
        Some(given.path)
    }

    /// A file that can be written when `what` is there; empty where there is no such key.
    pub fn output(&mut self, key: &'static str, what: &str) -> String {
        let Some(given) = self.on_resume(OnResume::Free).path(key) else {
            return String::new();
        };
        let path = Path::new(&given.path);
        let folder = path.parent().unwrap_or(path);
        if path.is_dir() {
            self.fault(key, format!("'{}' is a folder; name a file", given.shown()));
        } else if !folder.is_dir() {
            let folder = folder.display();
            self.missing(
                key,
                format!("no folder '{folder}' to write {what} in; make it first"),
            );
        }
        given.path
    }

    /// A whole number within a range.
    pub fn count(&mut self, key: &'static str, default: usize, range: [usize; 2]) -> usize {
        let whole = self.value(key, Whole(default as i128), |value| {
            within(value.0, range.map(|end| end as i128))
        });
        usize::try_from(whole.0).unwrap_or(default)
    }

    /// A number within a range.
    pub fn number(&mut self, key: &'static str, default: f64, range: [f64; 2]) -> f64 {
        self.value(key, default, |value| {
            if *value >= range[0] && *value <= range[1] {
                return Ok(());
            }
            let [value, low, high] = [*value, range[0], range[1]].map(short);
            Err(format!(
                "{value} is out of range; {low} to {high} are possible"
            ))
        })
    }

    /// `true` or `false`.
    pub fn flag(&mut self, key: &'static str, default: bool) -> bool {
        self.value(key, default, |_| Ok(()))
    }

    /// One of some words, the default where it is none of them.
    pub fn word(&mut self, key: &'static str, default: &str, words: &[&str]) -> String {
        self.value(key, default.to_owned(), |value| {
            if words.contains(&value.as_str()) {
                return Ok(());
            }
            Err(unknown("word", value, words))
        })
    }

    /// Widths of hidden layers.
    pub fn layers(&mut self, key: &'static str, default: &[usize]) -> Vec<usize> {
        let default: Vec<Whole> = default.iter().map(|width| Whole(*width as i128)).collect();
        let layers = self.value(key, default, |layers| {
            if layers.is_empty() || layers.len() > 8 {
                return Err(format!("{} layers; 1 to 8 are possible", layers.len()));
            }
            layers
                .iter()
                .try_for_each(|width| within(width.0, [1, 4096]))
        });
        let widths = layers.iter().map(|width| usize::try_from(width.0));
        widths.filter_map(Result::ok).collect()
    }
}

fn within(value: i128, [low, high]: [i128; 2]) -> Result<(), String> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(format!(
        "{value} is out of range; {low} to {high} are possible"
    ))
}

/// A number without hundreds of digits.
fn short(number: f64) -> String {
    match number.abs() {
        0.0 => "0".to_owned(),
        1e-5..1e16 => number.to_string(),
        _ => format!("{number:e}"),
    }
}
