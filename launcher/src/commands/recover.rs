//! `formica recover`: repairs truncated and damaged traces.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use runs::traces::{self, Named};
use trace::Recovered;

use crate::exit;
use crate::output_files::{self, Force};
use crate::supervise::salvage::beside;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// The trace, a .part or a damaged one; of a folder or a run all that are not whole
    trace: PathBuf,
    /// Where it goes; X.cut.mcap beside it by default
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// Exit code 3 if something was lost, 1 if nothing can be recovered.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    output_files::end_at_signals()?;
    let existing = args.force.existing();
    let named = traces::find(&args.trace)?;
    if let Named::File(from) = &named {
        let to = args.out.clone().unwrap_or_else(|| beside(from));
        let recovered = trace::recover(from, &to, existing)?;
        return Ok(ExitCode::from(print(from, &recovered)));
    }
    let paths = traces::all(std::slice::from_ref(&args.trace))?;
    let paths: Vec<PathBuf> = paths.into_iter().filter(|path| is_damaged(path)).collect();
    ensure!(
        args.out.is_none() || paths.len() == 1,
        "--out is for one trace, and {} of those in {} are to be recovered; name one",
        paths.len(),
        args.trace.display()
    );
    if paths.is_empty() {
        outln!("{}: all traces are whole", args.trace.display());
    }
    let codes = paths.iter().map(|from| {
        let to = args.out.clone().unwrap_or_else(|| beside(from));
        match trace::recover(from, &to, existing) {
            Ok(recovered) => print(from, &recovered),
            Err(error) => {
                log::warn!("{error}");
                exit::FAILED
            }
        }
    });
    Ok(ExitCode::from(exit::worst(codes)))
}

fn is_damaged(path: &Path) -> bool {
    trace::read_whole(path).is_err()
}

/// Prints what was recovered and what was lost, and returns the exit code.
fn print(from: &Path, recovered: &Recovered) -> u8 {
    let messages: u64 = recovered.messages.values().sum();
    outln!(
        "{}: {} steps, {messages} messages{}",
        recovered.path.display(),
        recovered.steps,
        match recovered.was_whole() {
            true => ", nothing was lost",
            false => "",
        }
    );
    if recovered.was_whole() {
        return 0;
    }
    let topics: Vec<String> = (recovered.messages.iter())
        .map(|(topic, count)| format!("{count} {}", topic.escape_debug()))
        .collect();
    outln!("messages kept: {}", topics.join(", "));
    let from = from.display();
    if let Some(reason) = &recovered.cut {
        log::warn!("{from} is cut off: {reason}");
    }
    for lost in &recovered.lost {
        log::warn!("{from}: {lost}");
    }
    for damage in &recovered.damage {
        log::warn!("{from}: {damage}");
    }
    exit::DAMAGED
}
