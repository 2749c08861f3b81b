//! Maps of the graphs.

use graph::Graph;
use plot::map::Map;
use runs::read::Recorded;
use runs::seeds::SeedGroup;

use super::html::figure;
use super::maps::{interleaved, layout, map, messages};

/// Maximum number of graphs.
const GRAPHS: usize = 6;

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

/// The graph of each run, over its maze.
pub(super) fn section(groups: &[SeedGroup]) -> String {
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

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

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
        let body = section(&groups);
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
        let body = section(&grouped(vec![custom]));
        assert!(
            body.contains("class=\"wall\"") && body.contains("class=\"goal\""),
            "{body}"
        );
        let body = section(&grouped(vec![unknown]));
        assert!(
            body.contains("unknown: the maze is not drawn: unknown maze 'moon'"),
            "{body}"
        );
        assert!(
            body.contains("<figure") && !body.contains("class=\"wall\""),
            "{body}"
        );
        let body = section(&grouped(vec![bare]));
        assert!(body.contains("bare: no graph was built yet.") && !body.contains("<figure"));
    }
}
