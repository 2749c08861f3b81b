//! Maps of mazes, and how they are arranged.

use plot::map::Map;
use runs::read::Recorded;
use runs::seeds::SeedGroup;

use super::html::{Layout, absent};
use crate::episode::layout_of;

/// A map of a run's maze. Adds to `problems` if the maze is unknown.
pub(super) fn map<'a>(run: &Recorded, problems: &mut Vec<String>) -> Map<'a> {
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

/// Messages about what could not be shown.
pub(super) fn messages(problems: &[String]) -> String {
    problems.iter().map(|problem| absent(problem)).collect()
}

/// The runs, alternating between groups.
pub(super) fn interleaved(groups: &[SeedGroup]) -> Vec<&Recorded> {
    let runs = groups
        .iter()
        .flat_map(|group| group.runs.iter().enumerate());
    let mut runs: Vec<(usize, &Recorded)> = runs.collect();
    runs.sort_by_key(|(turn, _)| *turn);
    runs.into_iter().map(|(_, run)| run).collect()
}

/// The layout of a figure of maps.
pub(super) fn layout(maps: &[String]) -> Layout {
    match maps.len() {
        1 => Layout::One,
        _ => Layout::Maps,
    }
}
