//! `formica curves`: draws learning curves and prints final scores.

use std::path::PathBuf;
use std::process::ExitCode;

use ::report::curves::{SCORE, chart};
use ::report::seed_table;
use anyhow::ensure;
use plot::chart::Shape;
use runs::read;
use runs::seeds::grouped;

use crate::output;
use crate::output_files::{self, Force};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folders of runs, or their names under runs/
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// The metric to draw: a name in metrics.csv
    #[arg(long, value_name = "NAME", default_value = SCORE)]
    metric: String,
    /// The picture to write, an SVG
    #[arg(long, value_name = "FILE", default_value = "curves.svg")]
    out: PathBuf,
    #[command(flatten)]
    force: Force,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    ensure!(
        !args.out.is_dir(),
        "--out {} is a folder; give the file to write",
        args.out.display()
    );
    let runs = read::all(&args.runs)?;
    for run in &runs {
        let metric = run.metric(&args.metric)?;
        if metric.left_out > 0 {
            let (folder, count) = (run.folder.display(), metric.left_out);
            log::warn!("{folder}: {count} values that are no number to draw are left out");
        }
    }
    let groups = grouped(runs);
    let svg = chart(&groups, &args.metric).svg(Shape::Wide);
    output_files::write(&args.out, args.force.existing(), svg.as_bytes())?;
    output::text(seed_table::table(&groups));
    outln!("the picture is {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
