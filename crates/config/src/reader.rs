//! Reads one table of a run file key by key, and gathers every fault with its line.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use crate::fault::{Fault, escaped, shown, unknown};
use crate::names;
use crate::paths::{self, Paths};
use crate::resume;
use crate::syntax;
use crate::value::{Value, Whole};

/// Items of a list of tables that are told as faults, and keys of a table.
const MOST: usize = 50;

/// A value given by `--set`.
struct Set<'t> {
    table: &'t str,
    key: &'t str,
    value: DeValue<'t>,
    raw: &'t str,
}

impl<'t> Set<'t> {
    fn of(table: &'t str, key: &'t str, line: &'t str, raw: &'t str) -> Self {
        // What is no TOML by itself is a text: --set maze.layout=large.
        let parsed = DeTable::parse(line).ok().map(toml::Spanned::into_inner);
        let only = parsed.filter(|found| found.len() == 1);
        let value = only.and_then(|found| found.into_iter().next());
        let value = value.map(|(_, value)| value.into_inner());
        Self {
            table,
            key,
            value: value.unwrap_or_else(|| DeValue::String(raw.into())),
            raw,
        }
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

/// A parsed run file with `--set` values laid over it.
pub(crate) struct Document<'t> {
    text: &'t str,
    root: DeTable<'t>,
    sets: Vec<Set<'t>>,
    /// Where relative paths begin; the present folder without.
    base: Option<PathBuf>,
    /// Whether files that it names need not be there.
    lenient: bool,
    pub(crate) faults: Vec<Fault>,
    /// The resolved file, written as keys are read.
    pub(crate) resolved: String,
    /// The same with the names of files in the place of their paths.
    pub(crate) portable: String,
    tables: BTreeSet<&'static str>,
}

impl<'t> Document<'t> {
    /// `sets` are pairs of `table.key` and value; `lines` are the same values as `value = ...`.
    pub(crate) fn new(text: &'t str, sets: &'t [(String, String)], lines: &'t [String]) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let root = root.into_inner();
        let mut document = Self {
            faults: syntax::faults(text, &root, &errors),
            text,
            root,
            sets: vec![],
            base: None,
            lenient: false,
            resolved: String::new(),
            portable: String::new(),
            tables: BTreeSet::new(),
        };
        for ((path, raw), line) in sets.iter().zip(lines) {
            match path.split_once('.') {
                Some((table, key)) => document.sets.push(Set::of(table, key, line, raw)),
                None => {
                    let tables = resume::tables_with(path);
                    let hint = match tables.as_slice() {
                        [] => String::new(),
                        tables => {
                            format!(", as in {}.{path}", tables.join(&format!(".{path} or ")))
                        }
                    };
                    document.fault(0, path, format!("keys are written table.key{hint}"));
                }
            }
        }
        document
    }

    /// Says how paths are taken.
    pub(crate) fn take_paths(&mut self, paths: Paths<'_>) {
        self.base = paths.base.map(Path::to_path_buf);
        self.lenient = paths.lenient;
    }

    fn line(&self, offset: usize) -> usize {
        syntax::line(self.text, offset)
    }

    pub(crate) fn fault(&mut self, line: usize, key: &str, message: impl Into<String>) {
        // An empty key would make it a fault of the whole file.
        let key = if line == 0 && key.is_empty() {
            "''"
        } else {
            key
        };
        self.faults.push(Fault {
            line,
            key: shown(key),
            // What others say of a value may hold it as it is.
            message: escaped(&message.into()),
        });
    }

    /// Whether the file or `--set` has a table.
    pub(crate) fn has(&self, table: &str) -> bool {
        self.root.get(table).is_some() || self.sets.iter().any(|set| set.table == table)
    }

    /// Reads a table: `read` asks for its keys; the keys it does not ask for are faults.
    pub(crate) fn table<T>(
        &mut self,
        name: &'static str,
        read: impl FnOnce(&mut Table<'_, 't>) -> T,
    ) -> T {
        self.tables.insert(name);
        let header = format!("[{name}]\n");
        self.resolved.push_str(&header);
        self.portable.push_str(&header);
        let mut table = Table {
            document: self,
            name,
            known: vec![],
        };
        let result = read(&mut table);
        let known = table.known;
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
            let message = match resume::tables_with(&key).as_slice() {
                [] => unknown("key", &key, &known),
                tables => format!("unknown key; it belongs to [{}]", tables.join("] or [")),
            };
            self.fault(line, &format!("{name}.{key}"), message);
        }
        result
    }

    /// Tables that nobody asked for are faults. `ignored` ones are known, but not of this kind of
    /// run.
    pub(crate) fn finish(&mut self, ignored: &[&'static str]) {
        let known: Vec<&str> = self.tables.iter().chain(ignored).copied().collect();
        let mut strangers = vec![];
        for (key, value) in &self.root {
            let name = key.get_ref().as_ref();
            if !known.contains(&name) && strangers.len() < MOST {
                let line = self.line(key.span().start);
                strangers.push((line, name.to_owned(), value.get_ref().is_table()));
            }
        }
        for set in &self.sets {
            if !known.contains(&set.table) {
                strangers.push((0, set.table.to_owned(), true));
            }
        }
        for (line, key, is_table) in strangers {
            let message = match resume::tables_with(&key).as_slice() {
                tables @ [_, ..] if !is_table => format!(
                    "this key stands above all tables; write it below [{}]",
                    tables.join("] or [")
                ),
                _ => unknown("table", &key, &known),
            };
            self.fault(line, &key, message);
        }
    }

    /// Whether all of it is TOML.
    fn is_whole(&self) -> bool {
        let mut faults = self.faults.iter();
        !faults.any(|fault| fault.key.is_empty())
    }

    /// Puts the faults in the order of lines, each once. What was made of a line that is not TOML
    /// says nothing new.
    pub(crate) fn order(&mut self) {
        let broken = self.faults.iter().filter(|fault| fault.key.is_empty());
        let broken: BTreeSet<usize> = broken.map(|fault| fault.line).collect();
        self.faults
            .retain(|fault| fault.key.is_empty() || !broken.contains(&fault.line));
        self.faults.sort_by_key(|fault| fault.line);
        self.faults.dedup();
    }

    /// Notes a fault at a `table.key`.
    pub(crate) fn fault_at(&mut self, path: &str, message: impl Into<String>) {
        let (table, key) = path.split_once('.').unwrap_or((path, ""));
        self.fault(self.line_of(table, key), path, message);
    }

    /// Line of a key (0 when it was set on the command line), or of the table, or 1.
    fn line_of(&self, table: &str, key: &str) -> usize {
        if self
            .sets
            .iter()
            .any(|set| set.table == table && set.key == key)
        {
            return 0;
        }
        let Some((name, found)) = self.root.get_key_value(table) else {
            return 1;
        };
        let found = found.get_ref().as_table();
        let key = found.and_then(|table| table.get_key_value(key));
        self.line(key.map_or(name.span().start, |(key, _)| key.span().start))
    }
}

/// One table being read.
pub(crate) struct Table<'d, 't> {
    document: &'d mut Document<'t>,
    name: &'static str,
    known: Vec<&'static str>,
}

impl Table<'_, '_> {
    /// Notes a fault at a key.
    pub(crate) fn fault(&mut self, key: &str, message: impl Into<String>) {
        self.document
            .fault_at(&format!("{}.{key}", self.name), message);
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

    /// A whole number within a range.
    pub(crate) fn count(&mut self, key: &'static str, default: usize, range: [usize; 2]) -> usize {
        let whole = self.value(key, Whole(default as i128), |value| {
            within(value.0, range.map(|end| end as i128))
        });
        usize::try_from(whole.0).unwrap_or(default)
    }

    /// A number within a range.
    pub(crate) fn number(&mut self, key: &'static str, default: f64, range: [f64; 2]) -> f64 {
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
    pub(crate) fn flag(&mut self, key: &'static str, default: bool) -> bool {
        self.value(key, default, |_| Ok(()))
    }

    /// One of some words.
    pub(crate) fn word(&mut self, key: &'static str, default: &str, words: &[&str]) -> String {
        self.value(key, default.to_owned(), |value| {
            if words.contains(&value.as_str()) {
                return Ok(());
            }
            Err(unknown("word", value, words))
        })
    }

    /// Widths of hidden layers.
    pub(crate) fn layers(&mut self, key: &'static str, default: &[usize]) -> Vec<usize> {
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
