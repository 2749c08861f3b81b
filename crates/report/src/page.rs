//! `formica report`: all that runs have recorded, as one page that needs no other file.

mod charts;
mod graphs;
mod html;
mod maps;
mod outcome;
mod paths;
mod scores;
mod settings;
mod stages;

use runs::seeds::SeedGroup;

use html::Section;

/// The page of groups of runs, as HTML.
///
/// # Errors
/// A file of a run is damaged.
pub fn page(groups: &[SeedGroup]) -> anyhow::Result<String> {
    let section = |id, heading, body| Section { id, heading, body };
    let sections = [
        section("scores", "Scores", scores::section(groups)?),
        section("learning", "Learning curves", charts::learning(groups)),
        section("latent-graph", "Graph", graphs::section(groups)),
        section("walks", "Paths", paths::section(groups)),
        section("stages", "Stages", stages::section(groups)?),
        section("machinery", "Throughput and lag", charts::machinery(groups)),
        section("training", "Training", charts::training(groups)),
        section("config", "Config", settings::section(groups)),
    ];
    let title = format!("{} · formica report", scores::title(groups));
    Ok(html::page(&title, &scores::head(groups)?, &sections))
}
