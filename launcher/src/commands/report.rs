//! `formica report`: writes a page about runs.

use std::path::PathBuf;
use std::process::ExitCode;

use ::report::page;
use anyhow::ensure;
use durable::Existing;
use runs::read;
use runs::seeds::grouped;

use crate::output_files::{self, Force};

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
    let runs = read::all(&args.runs)?;
    let first = runs.first().map(|run| run.folder.join("report.html"));
    let out = args.out.clone().or(first).unwrap_or_default();
    let page = page::page(&grouped(runs))?;
    // A run's own page is replaced as the run goes on.
    let existing = match args.out {
        Some(_) => args.force.existing(),
        None => Existing::Replace,
    };
    output_files::write(&out, existing, page.as_bytes())?;
    outln!("the report is {}", out.display());
    Ok(ExitCode::SUCCESS)
}
