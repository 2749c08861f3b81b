//! Reads run files of a registry's algorithms.

use std::path::Path;
use std::sync::OnceLock;

use crate::fault::{Fault, Faults};
use crate::key::Key;
use crate::paths::Paths;
use crate::reader::Document;
use crate::registry::Registry;
use crate::sections::Config;
use crate::{read, syntax, text};

/// Reads run files: their tables are the project's, and those that the chosen algorithm names.
pub struct Reader {
    registry: &'static dyn Registry,
    keys: OnceLock<Vec<Key>>,
}

impl Reader {
    /// Of a registry's algorithms.
    #[must_use]
    pub const fn new(registry: &'static dyn Registry) -> Self {
        Self {
            registry,
            keys: OnceLock::new(),
        }
    }

    /// Every key of every algorithm.
    fn keys(&self) -> &[Key] {
        self.keys.get_or_init(|| {
            let mut keys = vec![];
            for algorithm in self.registry.algorithms() {
                let text = format!("[run]\nalgorithm = \"{algorithm}\"\n[collect]\n");
                let mut document = Document::new(&text, &[], &[], &[]);
                read::read(&mut document, "x", self.registry);
                keys.extend(document.keys);
            }
            keys.sort();
            keys.dedup();
            keys
        })
    }

    /// Reads a run file, with `table.key` and value pairs laid over it. Relative paths begin at
    /// the present folder.
    ///
    /// # Errors
    /// Every fault of the file at once; an unreadable file is one fault.
    pub fn load(&self, path: &Path, sets: &[(String, String)]) -> Result<Config, Faults> {
        self.load_with(path, sets, Paths::default(), none)
    }

    /// The same with `further` checks, of what the file alone does not tell: faults by
    /// `table.key`. They are asked of a config in which defaults stand for faulty values.
    ///
    /// # Errors
    /// Every fault of the file and of the further checks at once.
    pub fn load_with<K: AsRef<str>>(
        &self,
        path: &Path,
        sets: &[(String, String)],
        paths: Paths<'_>,
        further: impl FnOnce(&Config) -> Vec<(K, String)>,
    ) -> Result<Config, Faults> {
        let origin = path.display().to_string();
        match text::read(path) {
            Ok(text) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                self.parse_with(&text, &origin, &stem, sets, paths, further)
            }
            Err((0, message)) => Err(Faults::of_file(origin, message)),
            Err((line, message)) => Err(Faults {
                origin,
                faults: vec![Fault {
                    line,
                    key: String::new(),
                    message,
                }],
            }),
        }
    }

    /// Reads the config in a run's folder. Files that it names need not be there any more.
    ///
    /// # Errors
    /// Every fault of the file at once.
    pub fn of_run(&self, folder: &Path) -> Result<Config, Faults> {
        self.load_of_run(&folder.join("config.toml"), folder, &[], none)
    }

    /// Reads a config of a run in a folder, as [`of_run`](Self::of_run) does, with `table.key` and
    /// value pairs laid over it and `further` checks. Relative paths begin where the run was
    /// launched: the folder that has `runs` in it.
    ///
    /// # Errors
    /// Every fault of the file and of the further checks at once.
    pub fn load_of_run<K: AsRef<str>>(
        &self,
        file: &Path,
        folder: &Path,
        sets: &[(String, String)],
        further: impl FnOnce(&Config) -> Vec<(K, String)>,
    ) -> Result<Config, Faults> {
        let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let paths = Paths {
            base: whole.ancestors().nth(2),
            lenient: true,
        };
        self.load_with(file, sets, paths, further)
    }

    /// Reads the text of a run file; `stem` names the run when the file does not.
    ///
    /// # Errors
    /// Every fault of the text at once.
    pub fn parse(
        &self,
        text: &str,
        origin: &str,
        stem: &str,
        sets: &[(String, String)],
    ) -> Result<Config, Faults> {
        self.parse_with(text, origin, stem, sets, Paths::default(), none)
    }

    /// The same with [`Paths`] and `further` checks.
    ///
    /// # Errors
    /// Every fault of the text and of the further checks at once.
    pub fn parse_with<K: AsRef<str>>(
        &self,
        text: &str,
        origin: &str,
        stem: &str,
        sets: &[(String, String)],
        paths: Paths<'_>,
        further: impl FnOnce(&Config) -> Vec<(K, String)>,
    ) -> Result<Config, Faults> {
        let lines = sets.iter().map(|(_, value)| format!("value = {value}"));
        let lines: Vec<String> = lines.collect();
        let mut document = Document::new(text, sets, &lines, self.keys());
        if !document.faults.is_empty()
            && let Some(message) = syntax::other_format(text, origin)
        {
            return Err(Faults::of_file(origin.to_owned(), message.to_owned()));
        }
        document.take_paths(paths);
        let mut config = read::read(&mut document, stem, self.registry);
        config.resolved = std::mem::take(&mut document.resolved);
        config.portable = std::mem::take(&mut document.portable);
        config.keys = std::mem::take(&mut document.keys);
        for (path, message) in further(&config) {
            document.fault_at(path.as_ref(), message);
        }
        document.order();
        if document.faults.is_empty() {
            Ok(config)
        } else {
            Err(Faults {
                origin: origin.to_owned(),
                faults: document.faults,
            })
        }
    }
}

/// No further checks.
fn none(_: &Config) -> Vec<(&'static str, String)> {
    vec![]
}
