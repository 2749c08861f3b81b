//! Whole traces: written, read, recovered.

pub(crate) mod made;
mod recorder;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use durable::{Existing, OutputError};
use maze::AntBody;
use simulator::Spaces;

use crate::{
    EndRecord, EpisodeMeta, EpisodeWriter, Outcome, Scene, StateRecord, StepRecord, Still,
    TraceError, read, read_bytes, read_whole, recover,
};
use made::*;

fn outcome_of(steps: u32) -> Outcome {
    Outcome {
        success: true,
        fell: false,
        steps,
        episode_return: (steps / 10) as f32,
    }
}

#[test]
fn a_whole_trace_reads_back_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let writer = write(&path, 50);
    assert!(!path.exists(), "not before it is whole");
    writer.end(&end(50)).unwrap();
    assert!(!part_of(&path).exists());
    let trace = read_whole(&path).unwrap();
    assert_eq!(
        (&trace.meta, trace.outcome),
        (&meta(), Some(outcome_of(50)))
    );
    assert_eq!(trace.times[1] - trace.times[0], 5_000_000_000);
    let counts = [
        ("/scene/maze", 1),
        ("/scene/body", 1),
        ("/scene/choice", 5),
        ("/graph", 1),
        ("/graph/nodes", 1),
        ("/graph/structure", 1),
        ("/points/walls", 1),
        ("/points/body", 1),
        ("/tf", 51),
        ("/goal", 1),
        ("/subgoal", 1),
        ("/path", 6),
        ("/start", 1),
        ("/step", 50),
        ("/choice", 5),
        ("/outcome", 4),
        ("/end", 1),
        ("/log", 11),
    ];
    assert_eq!(
        trace.messages,
        counts.map(|(topic, n)| (topic.to_owned(), n)).into()
    );
    assert_eq!(
        (trace.graph.x, trace.graph.to),
        (vec![1.0, 2.0], vec![1, 9])
    );
    let from = trace.start.unwrap();
    assert_eq!(Some(from.simulator_state), start());
    assert_eq!(
        (from.version_names, from.versions),
        (
            ["graph", "high", "low"].map(str::to_owned).to_vec(),
            vec![6, 5, 4]
        )
    );
    assert_eq!(trace.end.unwrap().observation, state(50).observation);
    assert_eq!(trace.steps.len(), 50);
    for (i, step) in (0..).zip(&trace.steps) {
        let written = record(i);
        assert_eq!((step.step, step.value), (i, (i / 10 * 10) as f32 / 2.0));
        assert_eq!(step.return_so_far, ((i + 1) / 10) as f32);
        assert_eq!(
            (&step.observation[..], &step.action[..]),
            (&written.state.observation[..], &written.action[..])
        );
        assert_eq!(step.subgoal_node, written.subgoal_node);
    }
    assert_eq!(trace.choices[3].probabilities, [0.75]);
    let reached: Vec<_> = trace
        .outcomes
        .iter()
        .map(|o| (o.reached, o.steps))
        .collect();
    assert_eq!(reached, [(true, 10), (false, 10), (true, 10), (false, 10)]);
}

/// A simulator of images without a graph, whose body is drawn by nobody.
#[test]
fn images_are_read_back_and_a_trace_without_a_graph_has_no_topic_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let image = |step: u32| -> Vec<u8> {
        let values = (0..64 * 64 * 3).map(|i| (((step * 131 + i) * 7) >> 3) as u8);
        values.collect()
    };
    let meta = EpisodeMeta {
        simulator: "camera".to_owned(),
        spaces: Some(Spaces::parse("u8:64x64x3 f32:2 2 0.05").unwrap()),
        versions: [("critic".to_owned(), 3)].into(),
        ..meta()
    };
    let still = Arc::new(Still::new(Scene::default()));
    let mut writer = EpisodeWriter::begin(&path, part_of(&path), &meta, still, None).unwrap();
    let mut record = StepRecord::default();
    for step in 0..20 {
        record.step = step;
        record.state.observation_bytes = image(step);
        record.action = vec![0.5, -1.0];
        writer.choice(choice(step)).unwrap();
        writer.step(&record).unwrap();
    }
    let state = StateRecord {
        observation_bytes: image(20),
        ..StateRecord::default()
    };
    writer
        .end(&EndRecord {
            state,
            ..EndRecord::default()
        })
        .unwrap();
    let trace = read_whole(&path).unwrap();
    assert_eq!(trace.meta, meta);
    assert_eq!(
        trace.times[1] - trace.times[0],
        1_000_000_000,
        "20 steps of 0.05 s"
    );
    for (i, step) in (0..).zip(&trace.steps) {
        assert!(step.observation_bytes == image(i) && step.observation.is_empty());
        assert_eq!(
            (step.node, step.subgoal_node, &*step.action),
            (-1, -1, &[0.5, -1.0][..])
        );
        assert!(step.goal_distance.is_nan() && step.subgoal_distance.is_nan());
    }
    assert_eq!(trace.steps.len(), 20);
    assert!(trace.end.unwrap().observation_bytes == image(20));
    assert!(trace.start.unwrap().simulator_state.is_empty());
    let topics: Vec<&str> = trace.messages.keys().map(String::as_str).collect();
    let expected = [
        "/end",
        "/goal",
        "/log",
        "/path",
        "/points/walls",
        "/scene/maze",
        "/start",
        "/step",
    ];
    assert_eq!(topics, expected);
    assert!(trace.graph.x.is_empty() && trace.choices.is_empty());
}

#[test]
fn a_trace_of_an_older_version_is_read() {
    let bytes = include_bytes!("../../../fuzz/corpus/trace/lz4");
    let trace = read_bytes(Path::new("old.mcap"), bytes).unwrap();
    assert!(trace.is_whole());
    assert_eq!((trace.meta.simulator(), &trace.meta.spaces), ("ant", &None));
    assert_eq!(trace.meta.versions, meta().versions);
    let from = trace.start.unwrap();
    assert_eq!((from.state.len(), from.simulator_state.len()), (29, 0));
    assert_eq!(
        (trace.steps.len(), trace.steps[0].observation.len()),
        (3, 29)
    );
    assert_eq!(trace.end.unwrap().observation.len(), 29);
}

#[test]
fn the_ant_is_drawn_as_a_sphere_with_four_bones_and_eight_links() {
    let scene = Scene::default().with_body(&AntBody).body();
    assert_eq!(scene.entities.len(), 9);
    let [torso, links @ ..] = &*scene.entities else {
        panic!("no torso");
    };
    assert_eq!((torso.spheres.len(), torso.lines.len()), (1, 4));
    assert_eq!(torso.spheres[0].size.as_ref().unwrap().x, 0.5);
    assert!(torso.frame_locked && torso.frame_id == "torso" && torso.id == "torso");
    for (link, reach) in links.iter().zip([0.2, 0.4].into_iter().cycle()) {
        let [bone] = &*link.lines else {
            panic!("a link is one bone");
        };
        assert!((bone.thickness - 0.16).abs() < 1e-6);
        assert!((bone.points[1].x.abs() - reach).abs() < 1e-6, "{}", link.id);
    }
}

#[test]
fn of_an_episode_that_was_cut_off_the_whole_chunks_are_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    let part = part_of(&path);
    let mut writer = write(&path, 25);
    writer.flush().unwrap();
    for step in 25..30 {
        writer.step(&record(step)).unwrap();
    }
    // As a killed process leaves it: the last chunk is not there, or half of it.
    let bytes = fs::read(&part).unwrap();
    std::mem::forget(writer);
    assert!(!path.exists());
    for extra in [&[][..], &[6, 200, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3]] {
        fs::write(&part, [&bytes, extra].concat()).unwrap();
        let trace = read(&part).unwrap();
        assert!(trace.cut.is_some() && trace.outcome.is_none());
        assert_eq!((trace.meta, trace.steps.len()), (meta(), 25));
        assert!(read_whole(&part).is_err(), "it is not whole");
        let recovered = recover(&part, &path, Existing::Refuse).unwrap();
        assert_eq!((recovered.steps, recovered.cut.is_some()), (25, true));
        let trace = read_whole(&path).unwrap();
        assert_eq!(trace.steps[24].observation, state(24).observation);
        assert_eq!(trace.metadata["outcome"], "cut off");
        fs::remove_file(&path).unwrap();
    }
    // A whole one stays what it is.
    write(&path, 15).end(&end(15)).unwrap();
    let copy = folder.path().join("copy.mcap");
    assert_eq!(recover(&path, &copy, Existing::Refuse).unwrap().cut, None);
    assert_eq!(read_whole(&path).unwrap(), read_whole(&copy).unwrap());
}

#[test]
fn recovering_writes_over_nothing_and_leaves_nothing_when_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let bytes = episode_bytes(20);
    let cut = &bytes[..bytes.len() - 500];
    fs::write(path("cut.mcap"), cut).unwrap();
    fs::write(path("mine.mcap"), "mine").unwrap();
    fs::write(path("empty.mcap"), "").unwrap();
    fs::write(path("chunkless.mcap"), &bytes[..300]).unwrap();
    fs::create_dir(path("folder")).unwrap();
    fs::hard_link(path("cut.mcap"), path("hard.mcap")).unwrap();
    std::os::unix::fs::symlink("cut.mcap", path("link.mcap")).unwrap();
    let names = || {
        let names = fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = names();
    let recover = |from: &str, to: &str, onto| recover(&path(from), &path(to), onto);
    for name in ["mine.mcap", "empty.mcap"] {
        let refused = recover("cut.mcap", name, Existing::Refuse);
        let exists: Result<crate::Recovered, _> =
            Err(TraceError::Output(OutputError::Exists(path(name))));
        assert_eq!(format!("{refused:?}"), format!("{exists:?}"));
    }
    for name in ["cut.mcap", "hard.mcap", "link.mcap", "folder"] {
        for existing in [Existing::Refuse, Existing::Replace] {
            let refused = recover("cut.mcap", name, existing);
            assert!(matches!(refused, Err(TraceError::Output(_))), "{name}");
        }
    }
    for name in ["empty.mcap", "chunkless.mcap", "mine.mcap"] {
        let nothing = recover(name, "new.mcap", Existing::Replace);
        assert!(matches!(nothing, Err(TraceError::Nothing { .. })), "{name}");
    }
    assert!(recover("cut.mcap", "no/such/folder.mcap", Existing::Refuse).is_err());
    assert_eq!(names(), before);
    assert_eq!(fs::read(path("cut.mcap")).unwrap(), cut);
    assert_eq!(fs::read(path("mine.mcap")).unwrap(), b"mine");
    recover("cut.mcap", "mine.mcap", Existing::Replace).unwrap();
    assert!(read_whole(&path("mine.mcap")).is_ok());
    assert_eq!(names(), before);
}

#[test]
fn what_was_given_up_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    write(&path, 5).discard();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_long_episode_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    write(&path, 1000).end(&end(1000)).unwrap();
    let bytes = fs::metadata(&path).unwrap().len();
    assert!(bytes < 1_000_000, "{bytes}");
}

#[test]
fn damage_is_an_error_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    write(&path, 30).end(&end(30)).unwrap();
    let whole = fs::read(&path).unwrap();
    let damaged = folder.path().join("damaged.mcap");
    let again = folder.path().join("again.mcap");
    for i in 0..64 {
        fs::write(&damaged, &whole[..whole.len() * i / 64]).unwrap();
        assert!(read_whole(&damaged).is_err(), "cut at {i}/64");
        // Whatever says how the episode starts can be recovered.
        let starts = read(&damaged).is_ok_and(|trace| trace.start.is_some());
        assert_eq!(starts, recover(&damaged, &again, Existing::Replace).is_ok());
    }
    // A flipped bit outside of what checksums cover may pass, but never kill.
    let mut caught = 0;
    for i in 0..400 {
        let mut bytes = whole.clone();
        bytes[whole.len() * i / 400] ^= 1 << (i % 8);
        fs::write(&damaged, &bytes).unwrap();
        caught += u32::from(read_whole(&damaged).is_err());
        let _ = recover(&damaged, &again, Existing::Replace);
    }
    assert!(caught > 390, "{caught} of 400");
    fs::write(&damaged, vec![0xff; 4096]).unwrap();
    assert!(read(&damaged).is_err());
}
