//! The graph over the maze, and the paths that ants walked in it.

use std::path::{Path, PathBuf};

use graph::Graph;

use super::page::{self, absent, figure};
use crate::episode_picture;
use crate::groups::Group;
use crate::picture::Picture;
use crate::recorded::Recorded;
use crate::story::{self, Story};

/// Graphs drawn, and paths, at most.
const GRAPHS: usize = 6;
const PATHS: usize = 6;

/// A run's maze as a picture, and where it came to nothing why.
fn picture<'a>(run: &Recorded, faults: &mut Vec<String>) -> Picture<'a> {
    let radius = run.config.get("evaluation.success_radius");
    let mut picture = Picture {
        goal_radius: radius.and_then(|radius| radius.parse().ok()).unwrap_or(0.0),
        ..Picture::default()
    };
    match story::layout_of(&run.toml) {
        Ok(layout) => {
            picture.walls = layout.boxes();
            picture.start = Some(layout.centre(layout.start()));
            picture.goal = layout.goals().first().map(|goal| layout.centre(*goal));
        }
        Err(error) => faults.push(format!("{}: the maze is not drawn: {error}.", run.name)),
    }
    picture
}

/// The newest graph of a run.
fn newest(run: &Recorded) -> Result<Graph, String> {
    let path = run.folder.join("graph.bin");
    if !path.exists() {
        return Err(format!("{}: no graph was built yet.", run.name));
    }
    Graph::load(&path).map_err(|error| {
        let (name, file) = (&run.name, path.display());
        match error {
            graph::GraphError::Io { .. } => format!("{name}: {error}."),
            _ => format!("{name}: {file} cannot be read: {error}."),
        }
    })
}

/// Sentences on what could not be shown.
fn told(faults: &[String]) -> String {
    faults.iter().map(|fault| absent(fault)).collect()
}

/// The runs, every group's turn before any group's next.
fn by_turns(groups: &[Group]) -> Vec<&Recorded> {
    let runs = groups
        .iter()
        .flat_map(|group| group.runs.iter().enumerate());
    let mut runs: Vec<(usize, &Recorded)> = runs.collect();
    runs.sort_by_key(|(turn, _)| *turn);
    runs.into_iter().map(|(_, run)| run).collect()
}

/// The graph of each run over its maze.
pub(crate) fn graphs(groups: &[Group]) -> String {
    let (mut pictures, mut faults, mut left_out) = (vec![], vec![], 0);
    for run in by_turns(groups) {
        if pictures.len() == GRAPHS {
            left_out += 1;
            continue;
        }
        let graph = match newest(run) {
            Ok(graph) => graph,
            Err(fault) => {
                faults.push(fault);
                continue;
            }
        };
        let edges = graph.pairs();
        let picture = Picture {
            title: run.name.clone(),
            subtitle: format!(
                "{} nodes, {} edges; version {}",
                graph.len(),
                edges.len(),
                graph.version
            ),
            nodes: &graph.places,
            edges: &edges,
            ..picture(run, &mut faults)
        };
        pictures.push(picture.svg());
    }
    let mut body = String::new();
    if !pictures.is_empty() {
        let mut caption = "<b>Figure 2.</b> The latent graph over the maze. A node stands at the \
            mean place of the states that it stands for; a line is an edge, one way or both."
            .to_owned();
        if left_out > 0 {
            caption += &format!(" The graphs of {left_out} more runs are left out.");
        }
        body += &figure("graph", page_layout(&pictures), &pictures, &caption);
    }
    body + &told(&faults)
}

fn page_layout(pictures: &[String]) -> page::Layout {
    match pictures.len() {
        1 => page::Layout::One,
        _ => page::Layout::Maps,
    }
}

/// An episode that could be drawn.
struct Walked<'a> {
    run: &'a Recorded,
    path: PathBuf,
    success: bool,
    /// Its place among the run's episodes that ended alike.
    turn: usize,
}

/// A run's traces, in the order of their names.
fn traces(run: &Recorded) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(run.folder.join("traces"));
    let paths = entries
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let is_trace = |path: &PathBuf| path.extension().is_some_and(|end| end == "mcap");
    let mut paths: Vec<PathBuf> = paths.filter(is_trace).collect();
    paths.sort();
    paths
}

fn shown(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Paths that were walked in the evaluation: failures first, and every run's turn before any
/// run's next.
pub(crate) fn paths(groups: &[Group]) -> String {
    let (mut episodes, mut faults) = (vec![], vec![]);
    for run in by_turns(groups) {
        let mut turns = [0; 2];
        for path in traces(run) {
            match trace::read_whole(&path) {
                Ok(trace) => {
                    let success = trace.outcome.is_some_and(|outcome| outcome.success);
                    let turn = &mut turns[usize::from(success)];
                    *turn += 1;
                    episodes.push(Walked {
                        run,
                        path,
                        success,
                        turn: *turn,
                    });
                }
                Err(error) => faults.push(format!("{}: a trace is left out: {error}.", run.name)),
            }
        }
    }
    episodes.sort_by_key(|episode| (episode.success, episode.turn));
    let several = groups.len() > 1 || groups.iter().any(|group| group.runs.len() > 1);
    let mut pictures = vec![];
    let all = episodes.len();
    for episode in shown_of(&episodes) {
        match walked(episode, several) {
            Ok(svg) => pictures.push(svg),
            Err(error) => {
                faults.push(format!(
                    "{}: a trace is left out: {error}.",
                    episode.run.name
                ));
            }
        }
    }
    let mut body = String::new();
    if pictures.is_empty() {
        body += &absent("There is no trace to draw: traces are written by the evaluation.");
    } else {
        let caption = format!(
            "<b>Figure 3.</b> Paths walked in the evaluation, over the graph: {} of {all} traces, \
             failures first. The dotted line links the nodes that were chosen, in their order.",
            pictures.len()
        );
        body += &figure("paths", page_layout(&pictures), &pictures, &caption);
    }
    faults.dedup();
    body + &told(&faults)
}

/// Failures first, but no more than half of what there is room for where that leaves successes
/// unseen.
fn shown_of<'e, 'r>(episodes: &'e [Walked<'r>]) -> impl Iterator<Item = &'e Walked<'r>> {
    let failures = episodes.iter().filter(|episode| !episode.success).count();
    let successes = episodes.len() - failures;
    let failed = failures.min(PATHS.saturating_sub(successes).max(PATHS / 2));
    let (lost, won) = episodes.split_at(failures);
    lost.iter()
        .take(failed)
        .chain(won.iter().take(PATHS - failed))
}

/// The picture of an episode.
fn walked(episode: &Walked<'_>, several: bool) -> anyhow::Result<String> {
    let trace = trace::read(&episode.path)?;
    let story = Story::of(&trace);
    let ended = match story.outcome {
        "success" => "goal reached",
        "failure" if story.fell => "on the back",
        "failure" => "goal not reached",
        _ => "no end told",
    };
    let name = match several {
        true => format!("{}, episode", episode.run.name),
        false => "Episode".to_owned(),
    };
    let count = story.subgoals.len();
    let title = format!("{name} {}: {ended}", story.episode);
    let subtitle = format!(
        "{} steps, {count} node{} chosen; {}",
        story.steps,
        if count == 1 { "" } else { "s" },
        shown(&episode.path)
    );
    episode_picture::svg(&trace, &story, title, subtitle)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use graph::Edge;

    use super::*;
    use crate::groups::grouped;

    /// A run's folder with a config, and a graph of two nodes.
    fn run(folder: &Path, name: &str, maze: &str, with_graph: bool) -> Recorded {
        let folder = folder.join(name);
        fs::create_dir(&folder).unwrap();
        let config = format!(
            "[run]\nname = \"{name}\"\nseed = 0\n[maze]\n{maze}\n[evaluation]\nsuccess_radius = 0.5\n"
        );
        fs::write(folder.join("config.toml"), config).unwrap();
        if with_graph {
            let edge = Edge {
                to: 1,
                count: 1,
                mean_steps: 1.0,
                least_steps: 1.0,
                reachability: 1.0,
                tried: 0.0,
                reached: 0.0,
                rollout_steps: 0.0,
            };
            let graph = Graph {
                version: 3,
                ids: vec![0, 1],
                latent_dim: 1,
                latents: vec![0.0; 2],
                places: vec![[0.0, 0.0], [4.0, 0.0]],
                offsets: vec![0, 1, 1],
                edges: vec![edge],
                mean_edge_steps: 1.0,
            };
            graph.save(&folder.join("graph.bin")).unwrap();
        }
        Recorded::read(folder).unwrap()
    }

    #[test]
    fn every_group_has_its_turn_before_any_has_its_next() {
        let folder = tempfile::tempdir().unwrap();
        let mut runs: Vec<Recorded> = (0..7)
            .map(|i| run(folder.path(), &format!("a-{i}"), "layout = \"umaze\"", true))
            .collect();
        runs.push(run(folder.path(), "b", "layout = \"large\"", true));
        let groups = grouped(runs);
        let names: Vec<&str> = by_turns(&groups)
            .iter()
            .map(|run| run.name.as_str())
            .collect();
        assert_eq!(
            names,
            ["a-0", "b", "a-1", "a-2", "a-3", "a-4", "a-5", "a-6"]
        );
        let body = graphs(&groups);
        assert_eq!(body.matches("<svg").count(), GRAPHS, "{body}");
        for told in [
            "2 nodes, 1 edges; version 3",
            "graphs of 2 more runs are left out",
        ] {
            assert!(body.contains(told), "{told} in {body}");
        }
    }

    #[test]
    fn a_maze_of_its_own_is_drawn_and_an_unknown_one_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let rows = "layout = \"custom\"\nrows = [\"11111\", \"1r0g1\", \"11111\"]";
        let custom = run(folder.path(), "custom", rows, true);
        let unknown = run(folder.path(), "unknown", "layout = \"moon\"", true);
        let bare = run(folder.path(), "bare", "layout = \"large\"", false);
        let body = graphs(&grouped(vec![custom]));
        assert!(
            body.contains("class=\"wall\"") && body.contains("class=\"goal\""),
            "{body}"
        );
        let body = graphs(&grouped(vec![unknown]));
        assert!(
            body.contains("unknown: the maze is not drawn: unknown maze 'moon'"),
            "{body}"
        );
        assert!(
            body.contains("<figure") && !body.contains("class=\"wall\""),
            "{body}"
        );
        let body = graphs(&grouped(vec![bare]));
        assert!(body.contains("bare: no graph was built yet.") && !body.contains("<figure"));
    }
}
