//! `formica inspect`: shows what happened in recorded episodes.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::report::episode::overview::{Summaries, json, overview};
use ::report::episode::{EpisodeSummary, inspect};
use anyhow::ensure;
use runs::traces::{self, Named};

use crate::output_files::{self, Force};
use crate::{exit, output};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Traces, folders of them, or runs by name or folder
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    /// For programs: an object for a trace, an array for several
    #[arg(long)]
    json: bool,
    /// Write the picture of a trace: maze, graph, chosen nodes, the path walked
    #[arg(long, value_name = "SVG")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// Exit code 1 if a trace cannot be read, 3 if one is truncated or damaged.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let [given] = &*args.paths
        && let Named::File(path) = traces::find(given)?
    {
        return one(&path, args);
    }
    ensure!(
        args.picture.is_none(),
        "--picture draws one trace; name its file, or see `formica report` for a run's"
    );
    several(&traces::all(&args.paths)?, args.json)
}

fn one(path: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let trace = trace::read(path)?;
    let summary = EpisodeSummary::of(&trace);
    if let Some(picture) = &args.picture {
        let svg = inspect::svg(&trace, &summary)?;
        output_files::write(picture, args.force.existing(), svg.as_bytes())?;
    }
    if args.json {
        outln!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        output::text(inspect::text(path, &trace, &summary));
    }
    Ok(ExitCode::from(code(&summary)))
}

fn several(paths: &[PathBuf], as_json: bool) -> anyhow::Result<ExitCode> {
    let summaries = paths.iter().map(|path| {
        let summary = trace::read(path).map(|trace| EpisodeSummary::of(&trace));
        (path.clone(), summary.map_err(Into::into))
    });
    let summaries: Vec<_> = summaries.collect();
    let summaries: &Summaries = &summaries;
    if as_json {
        outln!("{}", serde_json::to_string_pretty(&json(summaries)?)?);
    } else {
        output::text(overview(summaries));
    }
    let codes = summaries.iter().map(|(_, summary)| match summary {
        Ok(summary) => code(summary),
        Err(_) => exit::FAILED,
    });
    Ok(ExitCode::from(exit::worst(codes)))
}

fn code(summary: &EpisodeSummary) -> u8 {
    match summary.is_whole() {
        true => 0,
        false => exit::DAMAGED,
    }
}
