//! Several episodes as a table, for `formica inspect`.

use std::fmt::Write;
use std::path::PathBuf;

use plot::table::aligned;

use super::inspect::{named, short, versions};
use super::summary::EpisodeSummary;

/// Traces by path, with their summaries or the errors in reading them.
pub type Summaries = [(PathBuf, anyhow::Result<EpisodeSummary>)];

/// A line for each trace, and totals.
pub fn overview(summaries: &Summaries) -> String {
    let header = [
        "trace", "purpose", "outcome", "steps", "return", "subgoals", "reached", "given up",
        "falls", "versions",
    ];
    let mut lines = vec![header.map(str::to_owned).to_vec()];
    let mut notes = String::new();
    for (path, summary) in summaries {
        let name = path.display().to_string();
        if let Ok(EpisodeSummary { damage, .. }) = summary
            && let Some(first) = damage.first()
        {
            let _ = writeln!(notes, "damaged: {name}: {first}");
        }
        match summary {
            Ok(s) => lines.push(vec![
                name,
                named(&s.purpose),
                s.outcome.to_owned(),
                s.steps.to_string(),
                s.episode_return
                    .and_then(|value| short(value.into()))
                    .unwrap_or("-".to_owned()),
                s.subgoals.len().to_string(),
                s.reached().to_string(),
                s.given_up().to_string(),
                s.falls.to_string(),
                versions(s),
            ]),
            Err(error) => {
                let _ = writeln!(notes, "unreadable: {error:#}");
            }
        }
    }
    let read: Vec<&EpisodeSummary> = summaries
        .iter()
        .filter_map(|(_, s)| s.as_ref().ok())
        .collect();
    let count = |outcome: &str| read.iter().filter(|s| s.outcome == outcome).count();
    let steps: usize = read.iter().map(|summary| summary.steps).sum();
    let mut text = aligned(&lines);
    let _ = writeln!(
        text,
        "\n{} traces: {} successes, {} failures, {} cut off, {} unreadable; {steps} steps",
        summaries.len(),
        count("success"),
        count("failure"),
        count("cut off"),
        summaries.len() - read.len()
    );
    text + &notes
}

/// An array with an object for each trace.
///
/// # Errors
/// A summary cannot be serialized.
pub fn json(summaries: &Summaries) -> anyhow::Result<serde_json::Value> {
    let of = |(path, summary): &(PathBuf, anyhow::Result<EpisodeSummary>)| {
        let mut value = match summary {
            Ok(summary) => serde_json::to_value(summary)?,
            Err(error) => serde_json::json!({ "unreadable": format!("{error:#}") }),
        };
        value["trace"] = path.display().to_string().into();
        anyhow::Ok(value)
    };
    let all: anyhow::Result<Vec<_>> = summaries.iter().map(of).collect();
    Ok(all?.into())
}
