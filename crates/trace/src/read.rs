//! Reads what a trace says of itself.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::{METADATA, TraceError};

/// A trace at a glance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// The episode's metadata: outcome, versions, seeds.
    pub metadata: BTreeMap<String, String>,
    /// Messages of each topic.
    pub messages: BTreeMap<String, u64>,
}

/// Reads a whole trace and checks it as it goes: every message, in order of time.
///
/// # Errors
/// What the system refuses, or any damage.
pub fn summary(path: &Path) -> Result<Summary, TraceError> {
    let name = path.display().to_string();
    let bytes = fs::read(path).map_err(|source| TraceError::Io { path: name.clone(), source })?;
    let damaged = |reason: String| TraceError::Mcap { path: name.clone(), reason };
    let mut messages = BTreeMap::new();
    let mut last = 0;
    let stream = mcap::MessageStream::new(&bytes).map_err(|error| damaged(error.to_string()))?;
    for message in stream {
        let message = message.map_err(|error| damaged(error.to_string()))?;
        if message.log_time < last {
            return Err(damaged(format!("time runs backwards on {}", message.channel.topic)));
        }
        last = message.log_time;
        *messages.entry(message.channel.topic.clone()).or_default() += 1;
    }
    let summary = mcap::Summary::read(&bytes).map_err(|error| damaged(error.to_string()))?;
    let summary = summary.ok_or_else(|| damaged("it has no summary".to_owned()))?;
    let index = summary.metadata_indexes.iter().find(|index| index.name == METADATA);
    let index = index.ok_or_else(|| damaged(format!("it has no record '{METADATA}'")))?;
    let metadata = mcap::read::metadata(&bytes, index).map_err(|error| damaged(error.to_string()))?;
    Ok(Summary { metadata: metadata.metadata, messages })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EpisodeWriter, Scene, StepMessage, StepRecord};

    fn write(path: &Path, steps: u32) -> EpisodeWriter {
        let scene = Scene {
            walls: vec![[0.0, 0.0, 2.0, 2.0]],
            nodes: vec![[1.0, 1.0], [2.0, 2.0]],
            edges: vec![(0, 1)],
            ..Scene::default()
        };
        let mut writer = EpisodeWriter::create(path, &scene, "[run]\n").unwrap();
        for step in 0..steps {
            let observation = vec![step as f32; 29];
            let message = StepMessage { step, observation, ..StepMessage::default() };
            writer.step(&StepRecord { message, ..StepRecord::default() }).unwrap();
        }
        writer
    }

    #[test]
    fn a_whole_trace_tells_its_steps_and_outcome() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episode.mcap");
        let writer = write(&path, 50);
        assert!(!path.exists(), "not before it is whole");
        writer.finish(BTreeMap::from([("success".to_owned(), "true".to_owned())])).unwrap();
        let summary = summary(&path).unwrap();
        assert_eq!(summary.metadata["steps"], "50");
        assert_eq!(summary.metadata["success"], "true");
        assert_eq!((summary.messages["/step"], summary.messages["/tf"]), (50, 50));
        assert_eq!((summary.messages["/scene"], summary.messages["/ant"]), (1, 1));
    }

    #[test]
    fn an_episode_cut_off_leaves_only_a_part() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episode.mcap");
        drop(write(&path, 5));
        assert!(!path.exists() && folder.path().join("episode.mcap.part").exists());
        write(&path, 5).discard();
        assert!(!folder.path().join("episode.mcap.part").exists());
    }

    #[test]
    fn damage_is_an_error_never_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episode.mcap");
        write(&path, 30).finish(BTreeMap::new()).unwrap();
        let bytes = fs::read(&path).unwrap();
        let damaged = folder.path().join("damaged.mcap");
        for i in 0..64 {
            fs::write(&damaged, &bytes[..bytes.len() * i / 64]).unwrap();
            assert!(summary(&damaged).is_err(), "cut at {i}/64");
        }
    }
}
