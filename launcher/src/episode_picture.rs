//! The picture of a traced episode: the paper's figure 3.

use trace::Trace;

use crate::picture::{Picture, WalkedPath};
use crate::story::{self, Story};

/// Maze, graph, chosen nodes and the path walked, as SVG.
pub(crate) fn svg(
    trace: &Trace,
    story: &Story,
    title: String,
    subtitle: String,
) -> anyhow::Result<String> {
    let walls = story::layout(trace)?.boxes();
    let graph = &trace.graph;
    let nodes: Vec<[f32; 2]> = story::nodes(trace);
    let edges: Vec<(u32, u32)> = graph
        .from
        .iter()
        .copied()
        .zip(graph.to.iter().copied())
        .collect();
    let chosen = story
        .subgoals
        .iter()
        .filter_map(|s| u32::try_from(s.subgoal_node).ok());
    let chosen: Vec<u32> = chosen.collect();
    let picture = Picture {
        title,
        subtitle,
        walls,
        nodes: &nodes,
        edges: &edges,
        chosen: &chosen,
        paths: vec![WalkedPath {
            points: &story.path,
            success: story.outcome == "success",
        }],
        start: Some(story.start),
        goal: Some(story.goal),
        goal_radius: trace.meta.success_radius,
    };
    Ok(picture.svg())
}
