//! The run file: parsed, checked as a whole (all faults at once, each with its line), resolved.

mod read;
mod reader;
mod sections;

use std::path::Path;

pub use reader::{Fault, Faults};
pub use sections::{
    Collect, Config, Controller, Dataset, Encoder, Evaluation, Execution, Graph, High, Kind,
    Knowledge, Latent, Low, Maze, OnFault, Planner, Rollouts, Run, Seeding, Supervision, Topology,
    Traces, WalkerTraining,
};

impl Config {
    /// Reads a run file, with `table.key` and value pairs laid over it.
    ///
    /// # Errors
    /// Every fault of the file at once; an unreadable file is one fault.
    pub fn load(path: &Path, sets: &[(String, String)]) -> Result<Self, Faults> {
        Self::load_with(path, sets, |_| vec![])
    }

    /// The same with `further` checks, of what the file alone does not tell: faults by
    /// `table.key`. They are asked of a config in which defaults stand for faulty values.
    ///
    /// # Errors
    /// Every fault of the file and of the further checks at once.
    pub fn load_with(
        path: &Path,
        sets: &[(String, String)],
        further: impl FnOnce(&Self) -> Vec<(&'static str, String)>,
    ) -> Result<Self, Faults> {
        let origin = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => {
                let stem = path
                    .file_stem()
                    .map(|stem| stem.to_string_lossy().into_owned());
                Self::parse_with(&text, &origin, &stem.unwrap_or_default(), sets, further)
            }
            Err(error) => {
                let message = format!("cannot be read: {error}");
                Err(Faults {
                    origin,
                    faults: vec![Fault {
                        line: 1,
                        key: String::new(),
                        message,
                    }],
                })
            }
        }
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
        Self::parse_with(text, origin, stem, sets, |_| vec![])
    }

    fn parse_with(
        text: &str,
        origin: &str,
        stem: &str,
        sets: &[(String, String)],
        further: impl FnOnce(&Self) -> Vec<(&'static str, String)>,
    ) -> Result<Self, Faults> {
        // A value that is no TOML by itself is a text: --set maze.layout=large.
        let sets: Vec<(String, String)> = sets
            .iter()
            .map(|(key, value)| {
                let line = format!("value = {value}");
                let plain = toml::de::DeTable::parse(&line).is_ok();
                let text = || format!("value = {}", toml::Value::String(value.clone()));
                (key.clone(), if plain { line } else { text() })
            })
            .collect();
        let mut document = reader::Document::new(text, &sets);
        let mut config = read::read(&mut document, stem);
        config.resolved = std::mem::take(&mut document.resolved);
        for (path, message) in further(&config) {
            document.fault_at(path, message);
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

    /// The whole file with every default written out; reading it gives this config again.
    #[must_use]
    pub fn resolved(&self) -> &str {
        &self.resolved
    }

    /// A hash of the resolved file (FNV-1a, 16 hexadecimal digits).
    #[must_use]
    pub fn hash(&self) -> String {
        let hash = self
            .resolved
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        format!("{hash:016x}")
    }
}
