//! Maps of the paths of the evaluation.

use std::path::{Path, PathBuf};

use runs::read::Recorded;
use runs::seeds::SeedGroup;

use super::html::{absent, figure};
use super::maps::{interleaved, layout, messages};
use crate::episode::{self, EpisodeSummary};

/// Maximum number of paths.
const PATHS: usize = 6;

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
pub(super) fn section(groups: &[SeedGroup]) -> String {
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
