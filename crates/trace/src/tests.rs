use std::fs;

use super::*;
use crate::{EpisodeWriter, Scene, StepMessage, StepRecord};

fn scene() -> Scene {
    Scene {
        walls: vec![[0.0, 0.0, 2.0, 2.0]],
        nodes: vec![[1.0, 1.0], [2.0, 2.0]],
        // The second names a node that does not exist.
        edges: vec![(0, 1), (0, 9)],
        ..Scene::default()
    }
}

fn meta() -> EpisodeMeta {
    EpisodeMeta {
        run: "test".to_owned(),
        config_hash: "c0ffee".to_owned(),
        config_toml: "[run]\n".to_owned(),
        actor: 1,
        episode_index: 7,
        seed: 3,
        maze: "u".to_owned(),
        start: [0.5, -0.25],
        goal: [20.5, 0.1],
        low_version: 4,
        high_version: 5,
        graph_version: 6,
        success_radius: 0.5,
    }
}

fn record(step: u32) -> StepRecord {
    // A generator's digits: an episode does not compress like a constant.
    let noise = |i: u32| ((step * 131 + i).wrapping_mul(2_654_435_761) >> 8) as f32 * 1e-7;
    let message = StepMessage {
        step,
        reward: f32::from(u8::from(step % 10 == 9)),
        node: 0,
        subgoal_node: (step / 20) as i32 - 1,
        graph_version: 6,
        observation: (0..29).map(noise).collect(),
        action: (29..37).map(noise).collect(),
        neighbours: vec![0, 1],
        probabilities: vec![0.25, 0.75],
        ..StepMessage::default()
    };
    let bodies = std::array::from_fn(|b| std::array::from_fn(|i| noise(40 + (7 * b + i) as u32)));
    StepRecord {
        message,
        bodies,
        goal: [20.5, 0.1],
        subgoal: [2.0, 2.0],
    }
}

fn write(path: &Path, steps: u32) -> EpisodeWriter {
    let mut writer = EpisodeWriter::begin(path, &meta(), &scene()).unwrap();
    for step in 0..steps {
        writer.set_value(step as f32 / 2.0);
        writer.step(&record(step)).unwrap();
    }
    writer
}

const OUTCOME: Outcome = Outcome {
    success: true,
    fell: false,
    steps: 50,
    episode_return: 5.0,
};

#[test]
fn a_whole_trace_reads_back_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let writer = write(&path, 50);
    assert!(!path.exists(), "not before it is whole");
    writer.end(OUTCOME).unwrap();
    assert!(!folder.path().join("episode.mcap.part").exists());
    let summary = summary(&path).unwrap();
    assert_eq!((&summary.meta, summary.outcome), (&meta(), Some(OUTCOME)));
    assert_eq!(
        (summary.steps, summary.times[1] - summary.times[0]),
        (50, 4_900_000_000)
    );
    let counts = [
        ("/scene/maze", 1),
        ("/scene/ant", 1),
        ("/graph", 1),
        ("/graph/nodes", 1),
        ("/tf", 50),
        ("/goal", 50),
        ("/subgoal", 50),
        ("/step", 50),
        ("/path", 6),
        ("/log", 5),
    ];
    assert_eq!(
        summary.messages,
        counts.map(|(topic, n)| (topic.to_owned(), n)).into()
    );
    let steps = steps(&path).unwrap();
    assert_eq!(steps.len(), 50);
    for (i, step) in (0..).zip(&steps) {
        let written = record(i).message;
        assert_eq!((step.step, step.value), (i, i as f32 / 2.0));
        assert_eq!(step.return_so_far, ((i + 1) / 10) as f32);
        assert_eq!(
            (&step.observation, &step.action),
            (&written.observation, &written.action)
        );
        assert_eq!(step.probabilities, written.probabilities);
        assert_eq!(
            (&step.goal[..], step.subgoal_node),
            (&[20.5, 0.1][..], written.subgoal_node)
        );
    }
}

#[test]
fn metadata_may_come_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let mut writer = EpisodeWriter::create(&path, &scene(), "").unwrap();
    writer.step(&record(0)).unwrap();
    writer
        .finish(BTreeMap::from([("seed".to_owned(), "9".to_owned())]))
        .unwrap();
    let summary = summary(&path).unwrap();
    assert_eq!((summary.meta.seed, summary.outcome), (9, None));
}

#[test]
fn an_episode_cut_off_leaves_only_a_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let part = folder.path().join("episode.mcap.part");
    let writer = write(&path, 25);
    let before = fs::metadata(&part).unwrap().len();
    assert!(
        before > 10_000,
        "whole seconds are in the file before the end: {before}"
    );
    drop(writer);
    assert!(!path.exists() && part.exists());
    assert!(
        summary(&part)
            .unwrap_err()
            .to_string()
            .contains("unfinished")
    );
    write(&path, 5).discard();
    assert!(!path.exists() && !part.exists());
}

#[test]
fn a_long_episode_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    write(&path, 1000).end(OUTCOME).unwrap();
    let bytes = fs::metadata(&path).unwrap().len();
    assert!(bytes < 3_000_000, "{bytes}");
}

#[test]
fn damage_is_an_error_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    write(&path, 30).end(OUTCOME).unwrap();
    let whole = fs::read(&path).unwrap();
    let damaged = folder.path().join("damaged.mcap");
    for i in 0..64 {
        fs::write(&damaged, &whole[..whole.len() * i / 64]).unwrap();
        assert!(
            summary(&damaged).is_err() && steps(&damaged).is_err(),
            "cut at {i}/64"
        );
    }
    // A flipped bit outside of what checksums cover may pass, but never kill.
    let mut caught = 0;
    for i in 0..400 {
        let mut bytes = whole.clone();
        bytes[whole.len() * i / 400] ^= 1 << (i % 8);
        fs::write(&damaged, &bytes).unwrap();
        let _ = steps(&damaged);
        caught += u32::from(summary(&damaged).is_err());
    }
    assert!(caught > 390, "{caught} of 400");
    fs::write(&damaged, vec![0xff; 4096]).unwrap();
    assert!(summary(&damaged).is_err());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_trace_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    std::os::unix::fs::symlink("/dev/full", folder.path().join("episode.mcap.part")).unwrap();
    assert!(EpisodeWriter::begin(&path, &meta(), &scene()).is_err());
    assert!(!path.exists());
}
