//! A run file being read: its tables, and every fault with its line.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use crate::fault::{Fault, escaped, shown, unknown};
use crate::key::{Key, tables_with};
use crate::paths::Paths;
use crate::syntax;

/// Items of a list of tables that are told as faults, and keys of a table.
pub(crate) const MOST: usize = 50;

/// A value given by `--set`.
pub(crate) struct Set<'t> {
    pub(crate) table: &'t str,
    pub(crate) key: &'t str,
    pub(crate) value: DeValue<'t>,
    pub(crate) raw: &'t str,
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

/// A parsed run file with `--set` values laid over it.
pub struct Document<'t> {
    text: &'t str,
    pub(crate) root: DeTable<'t>,
    pub(crate) sets: Vec<Set<'t>>,
    /// Where relative paths begin; the present folder without.
    pub(crate) base: Option<PathBuf>,
    /// Whether files that it names need not be there.
    pub(crate) lenient: bool,
    pub(crate) faults: Vec<Fault>,
    /// The resolved file, written as keys are read.
    pub(crate) resolved: String,
    /// The same with the names of files in the place of their paths.
    pub(crate) portable: String,
    pub(crate) tables: BTreeSet<&'static str>,
    /// Keys as they are read.
    pub(crate) keys: Vec<Key>,
    /// Keys of every algorithm, for hints.
    pub(crate) all: &'t [Key],
}

impl<'t> Document<'t> {
    /// `sets` are pairs of `table.key` and value; `lines` are the same values as `value = ...`.
    pub(crate) fn new(
        text: &'t str,
        sets: &'t [(String, String)],
        lines: &'t [String],
        all: &'t [Key],
    ) -> Self {
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
            keys: vec![],
            all,
        };
        for ((path, raw), line) in sets.iter().zip(lines) {
            match path.split_once('.') {
                Some((table, key)) => document.sets.push(Set::of(table, key, line, raw)),
                None => {
                    let tables = tables_with(all, path);
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

    pub(crate) fn line(&self, offset: usize) -> usize {
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
    #[must_use]
    pub fn has(&self, table: &str) -> bool {
        self.root.get(table).is_some() || self.sets.iter().any(|set| set.table == table)
    }

    /// Tables that nobody asked for are faults; those of other algorithms are passed over.
    pub(crate) fn finish(&mut self) {
        let others = self.all.iter().map(|key| key.table);
        let mut known: Vec<&str> = self.tables.iter().copied().chain(others).collect();
        known.sort_unstable();
        known.dedup();
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
            let message = match tables_with(self.all, &key).as_slice() {
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
    pub(crate) fn is_whole(&self) -> bool {
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
