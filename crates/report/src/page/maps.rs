//! Maps of graphs and of paths.

use std::path::{Path, PathBuf};

use graph::Graph;
use plot::map::Map;
use runs::read::Recorded;
use runs::seeds::SeedGroup;

use super::html::{self, absent, figure};
use crate::episode::{self, EpisodeSummary, layout_of};

/// Maximum number of maps of graphs, and of paths.
const GRAPHS: usize = 6;
const PATHS: usize = 6;

/// A map of a run's maze. Adds to `problems` if the maze is unknown.
fn map<'a>(run: &Recorded, problems: &mut Vec<String>) -> Map<'a> {
    let radius = run.config.get("evaluation.success_radius");
    let mut map = Map {
        goal_radius: radius.and_then(|radius| radius.parse().ok()).unwrap_or(0.0),
        ..Map::default()
    };
    match layout_of(&run.toml) {
        Ok(layout) => {
            map.walls = layout.boxes();
            map.start = Some(layout.centre(layout.start()));
            map.goal = layout.goals().first().map(|goal| layout.centre(*goal));
        }
        Err(error) => problems.push(format!("{}: the maze is not drawn: {error}.", run.name)),
    }
    map
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

/// Messages about what could not be shown.
fn messages(problems: &[String]) -> String {
    problems.iter().map(|problem| absent(problem)).collect()
}

/// The runs, alternating between groups.
fn interleaved(groups: &[SeedGroup]) -> Vec<&Recorded> {
    let runs = groups
        .iter()
        .flat_map(|group| group.runs.iter().enumerate());
    let mut runs: Vec<(usize, &Recorded)> = runs.collect();
    runs.sort_by_key(|(turn, _)| *turn);
    runs.into_iter().map(|(_, run)| run).collect()
}

/// The graph of each run, over its maze.
pub(super) fn graphs(groups: &[SeedGroup]) -> String {
    let (mut maps, mut problems, mut left_out) = (vec![], vec![], 0);
    for run in interleaved(groups) {
        if maps.len() == GRAPHS {
            left_out += 1;
            continue;
        }
        let graph = match newest(run) {
            Ok(graph) => graph,
            Err(problem) => {
                problems.push(problem);
                continue;
            }
        };
        let edges = graph.pairs();
        let map = Map {
            title: run.name.clone(),
            subtitle: format!(
                "{} nodes, {} edges; version {}",
                graph.len(),
                edges.len(),
                graph.version
            ),
            nodes: &graph.places,
            edges: &edges,
            ..map(run, &mut problems)
        };
        maps.push(map.svg());
    }
    let mut body = String::new();
    if !maps.is_empty() {
        let mut caption = "<b>Figure 2.</b> The latent graph over the maze. A node stands at the \
            mean place of the states that it stands for; a line is an edge, one way or both."
            .to_owned();
        if left_out > 0 {
            caption += &format!(" The graphs of {left_out} more runs are left out.");
        }
        body += &figure("graph", layout(&maps), &maps, &caption);
    }
    body + &messages(&problems)
}

fn layout(maps: &[String]) -> html::Layout {
    match maps.len() {
        1 => html::Layout::One,
        _ => html::Layout::Maps,
    }
}

/// An episode to draw.
struct Walked<'a> {
    run: &'a Recorded,
    path: PathBuf,
    success: bool,
    /// Its index among the run's episodes with the same outcome.
    turn: usize,
}

/// Traces of a run, sorted by name.
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

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Paths of the evaluation: failures first, alternating between runs.
pub(super) fn paths(groups: &[SeedGroup]) -> String {
    let (mut episodes, mut problems) = (vec![], vec![]);
    for run in interleaved(groups) {
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
                Err(error) => problems.push(format!("{}: a trace is left out: {error}.", run.name)),
            }
        }
    }
    episodes.sort_by_key(|episode| (episode.success, episode.turn));
    let several = groups.len() > 1 || groups.iter().any(|group| group.runs.len() > 1);
    let mut maps = vec![];
    let all = episodes.len();
    for episode in selected(&episodes) {
        match walked(episode, several) {
            Ok(svg) => maps.push(svg),
            Err(error) => {
                problems.push(format!(
                    "{}: a trace is left out: {error}.",
                    episode.run.name
                ));
            }
        }
    }
    let mut body = String::new();
    if maps.is_empty() {
        body += &absent("There is no trace to draw: traces are written by the evaluation.");
    } else {
        let caption = format!(
            "<b>Figure 3.</b> Paths walked in the evaluation, over the graph: {} of {all} traces, \
             failures first. The dotted line links the nodes that were chosen, in their order.",
            maps.len()
        );
        body += &figure("paths", layout(&maps), &maps, &caption);
    }
    problems.dedup();
    body + &messages(&problems)
}

/// The episodes to draw: failures first, but at most half of them if there are successes.
fn selected<'e, 'r>(episodes: &'e [Walked<'r>]) -> impl Iterator<Item = &'e Walked<'r>> {
    let failures = episodes.iter().filter(|episode| !episode.success).count();
    let successes = episodes.len() - failures;
    let failed = failures.min(PATHS.saturating_sub(successes).max(PATHS / 2));
    let (lost, won) = episodes.split_at(failures);
    lost.iter()
        .take(failed)
        .chain(won.iter().take(PATHS - failed))
}

/// The map of an episode.
fn walked(episode: &Walked<'_>, several: bool) -> anyhow::Result<String> {
    let trace = trace::read(&episode.path)?;
    let summary = EpisodeSummary::of(&trace);
    let ended = match summary.outcome {
        "success" => "goal reached",
        "failure" if summary.fell => "on the back",
        "failure" => "goal not reached",
        _ => "no end told",
    };
    let name = match several {
        true => format!("{}, episode", episode.run.name),
        false => "Episode".to_owned(),
    };
    let count = summary.subgoals.len();
    let title = format!("{name} {}: {ended}", summary.episode);
    let subtitle = format!(
        "{} steps, {count} node{} chosen; {}",
        summary.steps,
        if count == 1 { "" } else { "s" },
        file_name(&episode.path)
    );
    episode::svg(&trace, &summary, title, subtitle)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use graph::Edge;
    use runs::seeds::grouped;

    use super::*;

    /// A run with a config, and with a graph of two nodes.
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
    fn groups_alternate() {
        let folder = tempfile::tempdir().unwrap();
        let mut runs: Vec<Recorded> = (0..7)
            .map(|i| run(folder.path(), &format!("a-{i}"), "layout = \"umaze\"", true))
            .collect();
        runs.push(run(folder.path(), "b", "layout = \"large\"", true));
        let groups = grouped(runs);
        let names: Vec<&str> = interleaved(&groups)
            .iter()
            .map(|run| run.name.as_str())
            .collect();
        assert_eq!(
            names,
            ["a-0", "b", "a-1", "a-2", "a-3", "a-4", "a-5", "a-6"]
        );
        let body = graphs(&groups);
        assert_eq!(body.matches("<svg").count(), GRAPHS, "{body}");
        for text in [
            "2 nodes, 1 edges; version 3",
            "graphs of 2 more runs are left out",
        ] {
            assert!(body.contains(text), "{text} in {body}");
        }
    }

    #[test]
    fn a_custom_maze_is_drawn_and_an_unknown_one_is_reported() {
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
