//! Checkpoints: weights for others to use, and states to go on from.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use config::Config;
use durable::{Stamp, States};
use nets::file::{self, ParameterFile};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Saves one module's flat weights with what they belong to.
pub(crate) fn module(
    folder: &Path,
    name: &str,
    config: &Config,
    version: u64,
    weights: &[f32],
) -> anyhow::Result<()> {
    let metadata = BTreeMap::from([
        ("kind".to_owned(), format!("formica {name}")),
        ("version".to_owned(), version.to_string()),
        ("config".to_owned(), config.hash()),
    ]);
    let path = folder
        .join("checkpoints")
        .join(format!("{name}.safetensors"));
    file::save(
        &path,
        &[("weights".to_owned(), vec![weights.len()], weights)],
        &metadata,
    )?;
    Ok(())
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

/// Reads what [`module`] saved, of a network with so many parameters.
pub(crate) fn load(path: &Path, parameters: usize) -> anyhow::Result<Vec<f32>> {
    let told = || path.display().to_string();
    let file = ParameterFile::load(path).with_context(told)?;
    file.tensor("weights", &[parameters]).with_context(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_come_back_and_those_of_another_shape_do_not() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("checkpoints")).unwrap();
        let text = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";
        let config = Config::parse(text, "x.toml", "x", &[]).unwrap();
        module(folder.path(), "low", &config, 3, &[0.5, -1.0]).unwrap();
        let path = folder.path().join("checkpoints/low.safetensors");
        assert_eq!(load(&path, 2).unwrap(), [0.5, -1.0]);
        assert!(load(&path, 3).is_err());
    }
}
