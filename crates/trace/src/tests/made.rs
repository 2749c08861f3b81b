//! An episode made up for tests.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maze::AntBody;
use simulator::Body;

use crate::{
    ChoiceRecord, EndRecord, EpisodeMeta, EpisodeWriter, OutcomeRecord, Scene, StateRecord,
    StepRecord, Still,
};

pub(super) fn still() -> Arc<Still> {
    let scene = Scene {
        walls: vec![[0.0, 0.0, 2.0, 2.0]],
        nodes: vec![[1.0, 1.0], [2.0, 2.0]],
        // The second names a node that does not exist.
        edges: vec![(0, 1), (0, 9)],
        ..Scene::default()
    };
    Arc::new(Still::new(scene.with_body(&AntBody)))
}

pub(super) fn meta() -> EpisodeMeta {
    EpisodeMeta {
        version: "0.1.0".to_owned(),
        run: "test".to_owned(),
        config_hash: "c0ffee".to_owned(),
        config_toml: "[run]\n".to_owned(),
        purpose: "evaluation".to_owned(),
        actor: 1,
        episode_index: 7,
        seed: 3,
        maze: "u".to_owned(),
        start: [0.5, -0.25],
        goal: [20.5, 0.1],
        simulator: "ant".to_owned(),
        spaces: Some(AntBody.spaces()),
        versions: [("low", 4), ("high", 5), ("graph", 6)]
            .map(|(name, version)| (name.to_owned(), version))
            .into(),
        success_radius: 0.5,
    }
}

/// A generator's digits: an episode does not compress like a constant.
fn noise(step: u32, i: u32) -> f32 {
    ((step * 131 + i).wrapping_mul(2_654_435_761) >> 8) as f32 * 1e-7
}

pub(super) fn numbers(step: u32, from: u32, len: u32) -> Vec<f32> {
    (from..from + len).map(|i| noise(step, i)).collect()
}

pub(super) fn start() -> Option<Vec<u8>> {
    Some((0..124).collect())
}

pub(super) fn state(step: u32) -> StateRecord {
    StateRecord {
        observation: numbers(step, 0, 29),
        observation_bytes: vec![],
        poses: (0..9)
            .map(|body| std::array::from_fn(|i| noise(step, 40 + 7 * body + i as u32)))
            .collect(),
    }
}

pub(super) fn record(step: u32) -> StepRecord {
    StepRecord {
        step,
        reward: f32::from(u8::from(step % 10 == 9)),
        node: 0,
        subgoal_node: (step / 20) as i32 - 1,
        state: state(step),
        action: numbers(step, 29, 8),
        subgoal: Some([2.0, 2.0]),
    }
}

/// A choice at each tenth step, which ends at the next one.
pub(super) fn choice(step: u32) -> ChoiceRecord {
    ChoiceRecord {
        step,
        node: 0,
        goal_node: 1,
        subgoal_node: 1,
        value: step as f32 / 2.0,
        neighbours: vec![1],
        probabilities: vec![0.75],
    }
}

pub(super) fn outcome(step: u32) -> OutcomeRecord {
    OutcomeRecord {
        step,
        node: 0,
        subgoal_node: 1,
        reached: step % 20 == 10,
    }
}

pub(super) fn end(steps: u32) -> EndRecord {
    EndRecord {
        success: true,
        fell: false,
        state: state(steps),
    }
}

/// A whole episode's bytes, a chunk for each five steps.
pub(crate) fn episode_bytes(steps: u32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let mut writer =
        EpisodeWriter::begin(&path, part_of(&path), &meta(), still(), start()).unwrap();
    for step in 0..steps {
        if step % 10 == 0 {
            if step > 0 {
                writer.outcome(&outcome(step)).unwrap();
            }
            writer.choice(choice(step)).unwrap();
        }
        writer.step(&record(step)).unwrap();
        if step % 5 == 4 {
            writer.flush().unwrap();
        }
    }
    fs::read(writer.end(&end(steps)).unwrap()).unwrap()
}

pub(super) fn part_of(path: &Path) -> PathBuf {
    path.with_extension("mcap.part")
}

pub(super) fn write(path: &Path, steps: u32) -> EpisodeWriter {
    let mut writer = EpisodeWriter::begin(path, part_of(path), &meta(), still(), start()).unwrap();
    for step in 0..steps {
        if step % 10 == 0 {
            if step > 0 {
                writer.outcome(&outcome(step)).unwrap();
            }
            writer.choice(choice(step)).unwrap();
        }
        writer.step(&record(step)).unwrap();
    }
    writer
}
