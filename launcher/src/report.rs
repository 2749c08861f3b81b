//! `formica report`: everything that runs have left, as one page that needs no other file.

mod charts;
mod maps;
mod outcome;
mod page;
mod quality;
mod scores;
mod settings;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::ensure;
use durable::Existing;

use crate::groups::grouped;
use crate::outputs::{self, Force};
use crate::recorded;
use page::Section;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folders of runs, or their names under runs/
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// The page to write; report.html in the folder of the first run by default
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(out) = &args.out {
        ensure!(
            !out.is_dir(),
            "--out {} is a folder; give the file to write",
            out.display()
        );
    }
    let runs = recorded::all(&args.runs)?;
    let first = runs.first().map(|run| run.folder.join("report.html"));
    let out = args.out.clone().or(first).unwrap_or_default();
    let groups = grouped(runs);
    let section = |id, heading, body| Section { id, heading, body };
    let sections = [
        section("scores", "Scores", scores::section(&groups)?),
        section("learning", "Learning curves", charts::learning(&groups)),
        section("latent-graph", "Graph", maps::graphs(&groups)),
        section("walks", "Paths", maps::paths(&groups)),
        section("stages", "Stages", quality::section(&groups)?),
        section(
            "machinery",
            "Throughput and lag",
            charts::machinery(&groups),
        ),
        section("training", "Training", charts::training(&groups)),
        section("config", "Config", settings::section(&groups)),
    ];
    let title = format!("{} · formica report", scores::title(&groups));
    let page = page::page(&title, &scores::head(&groups)?, &sections);
    // The page of a run is its own, and made anew as the run goes on.
    let existing = match args.out {
        Some(_) => args.force.existing(),
        None => Existing::Replace,
    };
    outputs::write(&out, existing, page.as_bytes())?;
    say!("the report is {}", out.display());
    Ok(ExitCode::SUCCESS)
}
