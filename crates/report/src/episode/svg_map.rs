//! Map of an episode as SVG, as in figure 3 of the paper.

use plot::map::{Map, Path};
use trace::Trace;

use super::layout::layout;
use super::summary::EpisodeSummary;

/// Maze, graph, chosen nodes and path, as SVG.
pub(crate) fn svg(
    trace: &Trace,
    summary: &EpisodeSummary,
    title: String,
    subtitle: String,
) -> anyhow::Result<String> {
    let walls = layout(trace)?.boxes();
    let graph = &trace.graph;
    let nodes: Vec<[f32; 2]> = nodes(trace);
    let edges: Vec<(u32, u32)> = graph
        .from
        .iter()
        .copied()
        .zip(graph.to.iter().copied())
        .collect();
    let chosen = summary
        .subgoals
        .iter()
        .filter_map(|s| u32::try_from(s.subgoal_node).ok());
    let chosen: Vec<u32> = chosen.collect();
    let map = Map {
        title,
        subtitle,
        walls,
        nodes: &nodes,
        edges: &edges,
        chosen: &chosen,
        paths: vec![Path {
            points: &summary.path,
            success: summary.outcome == "success",
        }],
        start: Some(summary.start),
        goal: Some(summary.goal),
        goal_radius: trace.meta.success_radius,
    };
    Ok(map.svg())
}

/// Positions of the nodes of the graph (m).
pub(super) fn nodes(trace: &Trace) -> Vec<[f32; 2]> {
    let graph = &trace.graph;
    let places = graph.x.iter().zip(&graph.y);
    places.map(|(x, y)| [*x, *y]).collect()
}
