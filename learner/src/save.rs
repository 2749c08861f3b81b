//! Checkpoints: weights for others to use, and states to go on from.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use agents::Checkpoint;
use anyhow::Context;
use config::Config;
use durable::{Stamp, States};
use nets::file;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Saves a network's weights in a run's folder.
pub(crate) fn checkpoint(
    folder: &Path,
    name: &str,
    config: &Config,
    version: u64,
    checkpoint: &Checkpoint<'_>,
) -> anyhow::Result<()> {
    let path = folder
        .join("checkpoints")
        .join(format!("{name}.safetensors"));
    write(&path, name, config, version, checkpoint)
}

/// Writes a network's weights with what they belong to.
pub(crate) fn write(
    path: &Path,
    name: &str,
    config: &Config,
    version: u64,
    checkpoint: &Checkpoint<'_>,
) -> anyhow::Result<()> {
    let mut metadata = BTreeMap::from([
        ("kind".to_owned(), format!("formica {name}")),
        ("version".to_owned(), version.to_string()),
        ("config".to_owned(), config.hash()),
    ]);
    metadata.extend(checkpoint.metadata.iter().cloned());
    let saved = file::save(path, &checkpoint.tensors, &metadata);
    saved.with_context(|| format!("writing {}", path.display()))
}

/// Keeps the states of a stage's training.
pub(crate) struct Keeper {
    states: States,
    every: Duration,
    kept: Instant,
}

impl Keeper {
    /// Of the stage `name` of a run, and the newest state to go on from, of those that have
    /// learned from at most `rounds` rounds.
    pub(crate) fn open<T: DeserializeOwned>(
        folder: &Path,
        name: &'static str,
        config: &Config,
        rounds: u32,
    ) -> (Self, Option<T>) {
        let states = States::new(&folder.join("checkpoints"), name);
        let newest = states.newest(rounds);
        for damaged in &newest.damaged {
            log::warn!("{damaged}; going on from the one before");
        }
        let state = newest.state.map(|(stamp, state)| {
            log::info!("{name} goes on from {}", stamp.number);
            states.forget_after(stamp.number);
            state
        });
        let keeper = Self {
            states,
            every: Duration::from_secs_f64(config.run.checkpoint_seconds),
            kept: Instant::now(),
        };
        (keeper, state)
    }

    /// Whether it is time for the next one.
    pub(crate) fn is_due(&self) -> bool {
        self.kept.elapsed() >= self.every
    }

    /// Keeps a state. A disk that is full costs the state, not the training.
    pub(crate) fn keep(&mut self, number: u64, round: u32, state: &impl Serialize) {
        self.kept = Instant::now();
        if let Err(error) = self.states.save(Stamp { number, round }, state) {
            log::warn!("no state was kept, the one before stays: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use nets::file::ParameterFile;

    use super::*;

    #[test]
    fn weights_come_back_with_what_they_belong_to() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("checkpoints")).unwrap();
        let text = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";
        let config = agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap();
        let weights = [0.5, -1.0];
        let saved = Checkpoint {
            tensors: vec![("weights".to_owned(), vec![2], &weights)],
            metadata: vec![("hidden".to_owned(), "4".to_owned())],
            copy: None,
        };
        checkpoint(folder.path(), "low", &config, 3, &saved).unwrap();
        let path = folder.path().join("checkpoints/low.safetensors");
        let file = ParameterFile::load(&path).unwrap();
        assert_eq!(file.tensor("weights", &[2]).unwrap(), weights);
        let metadata = file.metadata();
        assert_eq!((&*metadata["version"], &*metadata["hidden"]), ("3", "4"));
        assert_eq!(metadata["config"], config.hash());
    }
}
