//! Data that do not fit a run are refused before it starts; those that nobody could use end it at
//! once, without restarts.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::time::Duration;

use dataset::{Dataset, Shape, d4rl};
use system_tests::{SMALL, finished, formica, one_at_a_time, piped, text};

/// Widths of the ant.
const OBSERVATION: usize = 29;
const ACTION: usize = 8;

/// Walks to and fro along the umaze, 0.2 m a step, in the frame of the map.
fn walks(episodes: usize) -> Dataset {
    let way: Vec<[f32; 2]> = (0..=120)
        .map(|i| {
            let s = 0.2 * i as f32;
            match s {
                s if s < 8.0 => [s, 0.0],
                s if s < 16.0 => [8.0, s - 8.0],
                s => [24.0 - s, 8.0],
            }
        })
        .collect();
    let mut data = Dataset::new(Shape::ant());
    for number in 0..episodes {
        let mut way = way.clone();
        if number % 2 == 1 {
            way.reverse();
        }
        for (t, place) in way.iter().enumerate() {
            let next = way[(t + 1).min(way.len() - 1)];
            let mut o = [0.0; OBSERVATION];
            o[..2].copy_from_slice(place);
            (o[2], o[3]) = (0.55, 1.0);
            (o[8], o[10], o[12], o[14]) = (0.9, -0.9, -0.9, 0.9);
            for axis in 0..2 {
                o[15 + axis] = (next[axis] - place[axis]) / 0.1;
            }
            data.observations.extend(o);
            let action = |i: usize| ((t * 7 + i * 3 + number) % 21) as f32 / 10.0 - 1.0;
            data.actions.extend((0..ACTION).map(action));
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.end_episode();
    }
    data
}

/// Writes data and a config of the small run on them.
fn prepare(folder: &Path, data: &Dataset) {
    d4rl::write(&folder.join("data.hdf5"), data).unwrap();
    let config = SMALL.replace("[collect]\ntransitions = 12000\n", "");
    std::fs::write(folder.join("small.toml"), config).unwrap();
}

#[test]
fn data_of_another_maze_or_without_episodes_are_refused_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path(), &walks(6));
    let check = |sets: &[&str]| {
        let mut command = formica(folder.path(), &["check", "small.toml"]);
        sets.iter().for_each(|set| {
            command.args(["--set", set]);
        });
        let output = command.output().unwrap();
        (output.status.code(), text(&output))
    };
    let (code, told) = check(&[]);
    assert_eq!(code, Some(0), "{told}");
    let (code, told) = check(&["maze.layout=medium"]);
    assert_eq!(code, Some(2), "{told}");
    for wanted in [
        "data.hdf5: ",
        "% of the rows lie inside walls of 'medium'",
        "they fit 'umaze'",
    ] {
        assert!(told.contains(wanted), "{told}");
    }
    assert_eq!(told.lines().count(), 1, "{told}");
    let (code, told) = check(&["graph.lag=200"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("no episode has more rows than graph.lag = 200"),
        "{told}"
    );
    let launched = formica(
        folder.path(),
        &["launch", "small.toml", "--set", "maze.layout=large"],
    );
    let output = { launched }.output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(!folder.path().join("runs").exists());
}

/// One walk makes no edge that two episodes have: the graph has none, which no restart mends.
#[test]
fn a_graph_that_leads_nowhere_ends_the_run_at_once() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path(), &walks(1));
    let launcher = piped(&mut formica(folder.path(), &["launch", "small.toml"]));
    let (code, told) = finished(launcher, Duration::from_secs(60));
    assert!(matches!(code, Some(1 | 2)), "{told}");
    let cause = "the graph's largest connected part has 1 of 20 nodes and 0 edges";
    assert_eq!(told.matches(cause).count(), 1, "{told}");
    assert!(
        !told.contains("starting it again") && !told.contains("restarts:"),
        "{told}"
    );
}

/// Weights that are no numbers would be refused by all, who then wait for others.
#[test]
fn weights_that_diverge_end_the_run_at_once() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let mut data = walks(6);
    data.observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(|o| o[28] = f32::MAX);
    prepare(folder.path(), &data);
    let output = formica(folder.path(), &["check", "small.toml"]).output();
    let told = text(&output.unwrap());
    assert!(told.contains("row 0 holds 3.40e38 in column 28"), "{told}");
    let arguments = ["launch", "small.toml", "--set", "dataset.fit=warn"];
    let launcher = piped(&mut formica(folder.path(), &arguments));
    let (code, told) = finished(launcher, Duration::from_secs(60));
    assert!(matches!(code, Some(1 | 2)), "{told}");
    assert!(told.contains("weights diverged"), "{told}");
    assert!(!told.contains("starting it again"), "{told}");
}
