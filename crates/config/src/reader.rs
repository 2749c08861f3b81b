//! Reads one table of a run file key by key, and gathers every fault with its line.

use std::collections::BTreeSet;
use std::fmt;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One thing that is wrong with a run file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Line in the file, from 1; 0 for a value given by `--set`.
    pub line: usize,
    /// `table.key`, or empty for a syntax error.
    pub key: String,
    /// What is wrong and what would be right.
    pub message: String,
}

/// All that is wrong with a run file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Faults {
    /// The file's name.
    pub origin: String,
    /// In the order of lines.
    pub faults: Vec<Fault>,
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, fault) in self.faults.iter().enumerate() {
            let gap = if i > 0 { "\n" } else { "" };
            let separator = if fault.key.is_empty() { "" } else { ": " };
            let Fault { line, key, message } = fault;
            match line {
                0 => write!(f, "{gap}--set {key}{separator}{message}")?,
                _ => write!(f, "{gap}{}:{line}: {key}{separator}{message}", self.origin)?,
            }
        }
        Ok(())
    }
}

/// A type that a key's value can have.
pub(crate) trait Value: Clone {
    /// What it is called in a fault.
    const NAME: &'static str;
    fn read(value: &DeValue<'_>) -> Option<Self>;
    fn write(&self) -> String;
}

fn integer(value: &DeValue<'_>) -> Option<i128> {
    let integer = value.as_integer()?;
    i128::from_str_radix(integer.as_str(), integer.radix()).ok()
}

impl Value for usize {
    const NAME: &'static str = "a whole number";
    fn read(value: &DeValue<'_>) -> Option<Self> {
        Self::try_from(integer(value)?).ok()
    }
    fn write(&self) -> String {
        self.to_string()
    }
}

impl Value for f64 {
    const NAME: &'static str = "a number";
    fn read(value: &DeValue<'_>) -> Option<Self> {
        let number = match value {
            DeValue::Float(float) => float.as_str().parse().ok()?,
            _ => integer(value)? as Self,
        };
        number.is_finite().then_some(number)
    }
    fn write(&self) -> String {
        format!("{self:?}")
    }
}

impl Value for bool {
    const NAME: &'static str = "true or false";
    fn read(value: &DeValue<'_>) -> Option<Self> {
        value.as_bool()
    }
    fn write(&self) -> String {
        self.to_string()
    }
}

impl Value for String {
    const NAME: &'static str = "a text in quotes";
    fn read(value: &DeValue<'_>) -> Option<Self> {
        value.as_str().map(str::to_owned)
    }
    fn write(&self) -> String {
        toml::Value::String(self.clone()).to_string()
    }
}

impl<T: Value> Value for Vec<T> {
    const NAME: &'static str = "a list";
    fn read(value: &DeValue<'_>) -> Option<Self> {
        value
            .as_array()?
            .iter()
            .map(|item| T::read(item.get_ref()))
            .collect()
    }
    fn write(&self) -> String {
        format!(
            "[{}]",
            self.iter().map(Value::write).collect::<Vec<_>>().join(", ")
        )
    }
}

/// A parsed run file with `--set` values laid over it.
pub(crate) struct Document<'t> {
    text: &'t str,
    root: DeTable<'t>,
    sets: Vec<(String, String, DeTable<'t>)>,
    pub(crate) faults: Vec<Fault>,
    /// The resolved file, written as keys are read.
    pub(crate) resolved: String,
    tables: BTreeSet<&'static str>,
}

impl<'t> Document<'t> {
    /// `sets` are pairs of `table.key` and a line `value = ...`.
    pub(crate) fn new(text: &'t str, sets: &'t [(String, String)]) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut document = Self {
            text,
            root: root.into_inner(),
            sets: vec![],
            faults: vec![],
            resolved: String::new(),
            tables: BTreeSet::new(),
        };
        for error in errors {
            let line = error.span().map_or(1, |span| document.line(span.start));
            let message = error.message().to_owned();
            document.faults.push(Fault {
                line,
                key: String::new(),
                message,
            });
        }
        for (path, line) in sets {
            match (DeTable::parse(line), path.split_once('.')) {
                (Ok(table), Some((section, key))) => {
                    let key = (section.to_owned(), key.to_owned(), table.into_inner());
                    document.sets.push(key);
                }
                (Err(_), _) => document.fault(0, path, "not a TOML value"),
                (_, None) => document.fault(0, path, "keys are written table.key"),
            }
        }
        document
    }

    fn line(&self, offset: usize) -> usize {
        let before = self.text.as_bytes().get(..offset).unwrap_or_default();
        1 + before.iter().filter(|byte| **byte == b'\n').count()
    }

    pub(crate) fn fault(&mut self, line: usize, key: &str, message: impl Into<String>) {
        self.faults.push(Fault {
            line,
            key: key.to_owned(),
            message: message.into(),
        });
    }

    /// Whether the file or `--set` has a table.
    pub(crate) fn has(&self, table: &str) -> bool {
        self.root.get(table).is_some() || self.sets.iter().any(|(section, ..)| section == table)
    }

    /// Reads a table: `read` asks for its keys; the keys it does not ask for are faults.
    pub(crate) fn table<T>(
        &mut self,
        name: &'static str,
        read: impl FnOnce(&mut Table<'_, 't>) -> T,
    ) -> T {
        self.tables.insert(name);
        self.resolved.push_str(&format!("[{name}]\n"));
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
            match value.get_ref().as_table() {
                Some(found) => {
                    for key in found
                        .keys()
                        .filter(|key| !known.contains(&key.get_ref().as_ref()))
                    {
                        let line = self.line(key.span().start);
                        strangers.push((line, key.get_ref().to_string()));
                    }
                }
                None => {
                    let line = self.line(key.span().start);
                    self.fault(line, name, "expected a table: [name] on a line of its own");
                }
            }
        }
        for (section, key, _) in &self.sets {
            if section == name && !known.contains(&key.as_str()) {
                strangers.push((0, key.clone()));
            }
        }
        for (line, key) in strangers {
            let message = unknown("key", &key, &known);
            self.fault(line, &format!("{name}.{key}"), message);
        }
        result
    }

    /// Tables that nobody asked for are faults. `ignored` ones are known, but not of this kind of
    /// run.
    pub(crate) fn finish(&mut self, ignored: &[&'static str]) {
        let known: Vec<&str> = self.tables.iter().chain(ignored).copied().collect();
        let mut strangers = vec![];
        for key in self.root.keys() {
            if !known.contains(&key.get_ref().as_ref()) {
                strangers.push((self.line(key.span().start), key.get_ref().to_string()));
            }
        }
        for (section, ..) in &self.sets {
            if !known.contains(&section.as_str()) {
                strangers.push((0, section.clone()));
            }
        }
        for (line, key) in strangers {
            let message = unknown("table", &key, &known);
            self.fault(line, &key, message);
        }
    }

    /// Puts the faults in the order of lines, each once.
    pub(crate) fn order(&mut self) {
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
        let set = |(section, set, _): &(String, String, _)| section == table && set == key;
        if self.sets.iter().any(set) {
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

fn unknown(what: &str, name: &str, known: &[&str]) -> String {
    let nearest = known
        .iter()
        .map(|known| (strsim::damerau_levenshtein(name, known), *known))
        .min()
        .filter(|(distance, known)| *distance <= 1 + known.len() / 3);
    match nearest {
        Some((_, known)) => format!("unknown {what}; did you mean '{known}'?"),
        None => format!("unknown {what}; known are {}", known.join(", ")),
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

    /// The value of a key where there is one and it has the right type.
    pub(crate) fn optional<T: Value>(&mut self, key: &'static str) -> Option<T> {
        self.known.push(key);
        let document = &*self.document;
        let set = document
            .sets
            .iter()
            .rev()
            .find(|(table, k, _)| table == self.name && k == key);
        let value: Option<&Spanned<DeValue<'_>>> = match set {
            Some((_, _, table)) => table.get("value"),
            None => document
                .root
                .get(self.name)
                .and_then(|table| table.get_ref().as_table())
                .and_then(|table| table.get(key)),
        };
        let found = value?.get_ref();
        if let Some(read) = T::read(found) {
            self.document
                .resolved
                .push_str(&format!("{key} = {}\n", read.write()));
            return Some(read);
        }
        let message = format!("expected {}, found {}", T::NAME, describe(found));
        self.fault(key, message);
        None
    }

    /// The value of a key, or its default where there is none or `allowed` says what is wrong
    /// with it.
    pub(crate) fn value<T: Value>(
        &mut self,
        key: &'static str,
        default: T,
        allowed: impl FnOnce(&T) -> Result<(), String>,
    ) -> T {
        let before = self.document.faults.len();
        match self.optional::<T>(key) {
            Some(value) => match allowed(&value) {
                Ok(()) => value,
                Err(message) => {
                    self.fault(key, message);
                    default
                }
            },
            None => {
                if self.document.faults.len() == before {
                    let line = format!("{key} = {}\n", default.write());
                    self.document.resolved.push_str(&line);
                }
                default
            }
        }
    }

    /// A whole number within a range.
    pub(crate) fn count(&mut self, key: &'static str, default: usize, range: [usize; 2]) -> usize {
        self.value(key, default, |value| within(*value, range))
    }

    /// A number within a range.
    pub(crate) fn number(&mut self, key: &'static str, default: f64, range: [f64; 2]) -> f64 {
        self.value(key, default, |value| within(*value, range))
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
        self.value(key, default.to_vec(), |layers| {
            if layers.is_empty() || layers.len() > 8 {
                return Err(format!("{} layers; 1 to 8 are possible", layers.len()));
            }
            layers
                .iter()
                .try_for_each(|width| within(*width, [1, 4096]))
        })
    }
}

fn within<T: PartialOrd + fmt::Display + Copy>(
    value: T,
    [low, high]: [T; 2],
) -> Result<(), String> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(format!(
        "{value} is out of range; {low} to {high} are possible"
    ))
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(integer) => format!("the whole number {integer}"),
        DeValue::Float(float) => format!("the number {float}"),
        DeValue::Boolean(boolean) => boolean.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(_) => "a list of other things".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
