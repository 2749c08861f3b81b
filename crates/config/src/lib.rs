//! The run file: parsed, checked as a whole (all faults at once, each with its line), resolved.

mod fault;
mod names;
mod paths;
mod read;
mod reader;
mod resume;
mod sections;
mod syntax;
#[cfg(test)]
mod tests;
mod text;
mod value;

use std::path::Path;

pub use fault::{Fault, Faults};
pub use paths::Paths;
pub use resume::{Change, OnResume};
pub use sections::{
    Collect, Config, Controller, Dataset, Encoder, Evaluation, Execution, Graph, High, Kind,
    Knowledge, Latent, Low, Maze, Misfit, OnFault, Planner, Rollouts, Run, Seeding, Supervision,
    Topology, Traces, WalkerTraining,
};

impl Config {
    /// Reads a run file, with `table.key` and value pairs laid over it. Relative paths begin at
    /// the present folder.
    ///
    /// # Errors
    /// Every fault of the file at once; an unreadable file is one fault.
    pub fn load(path: &Path, sets: &[(String, String)]) -> Result<Self, Faults> {
        Self::load_with(path, sets, Paths::default(), none)
    }

    /// The same with `further` checks, of what the file alone does not tell: faults by
    /// `table.key`. They are asked of a config in which defaults stand for faulty values.
    ///
    /// # Errors
    /// Every fault of the file and of the further checks at once.
    pub fn load_with<K: AsRef<str>>(
        path: &Path,
        sets: &[(String, String)],
        paths: Paths<'_>,
        further: impl FnOnce(&Self) -> Vec<(K, String)>,
    ) -> Result<Self, Faults> {
        let origin = path.display().to_string();
        match text::read(path) {
            Ok(text) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                Self::parse_with(&text, &origin, &stem, sets, paths, further)
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
    pub fn of_run(folder: &Path) -> Result<Self, Faults> {
        Self::load_of_run(&folder.join("config.toml"), folder, &[], none)
    }

    /// Reads a config of a run in a folder, as [`of_run`](Self::of_run) does, with `table.key` and
    /// value pairs laid over it and `further` checks. Relative paths begin where the run was
    /// launched: the folder that has `runs` in it.
    ///
    /// # Errors
    /// Every fault of the file and of the further checks at once.
    pub fn load_of_run<K: AsRef<str>>(
        file: &Path,
        folder: &Path,
        sets: &[(String, String)],
        further: impl FnOnce(&Self) -> Vec<(K, String)>,
    ) -> Result<Self, Faults> {
        let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let paths = Paths {
            base: whole.ancestors().nth(2),
            lenient: true,
        };
        Self::load_with(file, sets, paths, further)
    }

    /// Reads the text of a run file; `stem` names the run when the file does not.
    ///
    /// # Errors
    /// Every fault of the text at once.
    pub fn parse(
        text: &str,
        origin: &str,
        stem: &str,
        sets: &[(String, String)],
    ) -> Result<Self, Faults> {
        Self::parse_with(text, origin, stem, sets, Paths::default(), none)
    }

    /// The same with [`Paths`] and `further` checks.
    ///
    /// # Errors
    /// Every fault of the text and of the further checks at once.
    pub fn parse_with<K: AsRef<str>>(
        text: &str,
        origin: &str,
        stem: &str,
        sets: &[(String, String)],
        paths: Paths<'_>,
        further: impl FnOnce(&Self) -> Vec<(K, String)>,
    ) -> Result<Self, Faults> {
        let lines = sets.iter().map(|(_, value)| format!("value = {value}"));
        let lines: Vec<String> = lines.collect();
        let mut document = reader::Document::new(text, sets, &lines);
        if !document.faults.is_empty()
            && let Some(message) = syntax::other_format(text, origin)
        {
            return Err(Faults::of_file(origin.to_owned(), message.to_owned()));
        }
        document.take_paths(paths);
        let mut config = read::read(&mut document, stem);
        config.resolved = std::mem::take(&mut document.resolved);
        config.portable = std::mem::take(&mut document.portable);
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

    /// The whole file with every default written out and every path absolute; reading it gives this
    /// config again, wherever it is read.
    #[must_use]
    pub fn resolved(&self) -> &str {
        &self.resolved
    }

    /// A hash of the resolved file (FNV-1a, 16 hexadecimal digits). Of files that it names the names
    /// count, not where they lie: the same run elsewhere has the same hash.
    #[must_use]
    pub fn hash(&self) -> String {
        let hash = self
            .portable
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        format!("{hash:016x}")
    }
}

/// No further checks.
fn none(_: &Config) -> Vec<(&'static str, String)> {
    vec![]
}
