//! Makes the data set of a config.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use config::Config;
use durable::{Existing, Output};

use crate::interrupts::Interrupts;
use crate::{exit, output_files};

/// Makes the data set of a run if it is missing. Returns an exit code if a signal stopped it.
pub(crate) fn if_missing(
    config: &Config,
    interrupts: &Interrupts,
) -> anyhow::Result<Option<ExitCode>> {
    let missing = !Path::new(&config.dataset.path).exists();
    if !config.offline || config.collect.is_none() || !missing {
        return Ok(None);
    }
    let path = Path::new(&config.dataset.path);
    outln!("collect: making {}", path.display());
    let output = Output::file(path, Existing::Refuse, &[]).map_err(anyhow::Error::from);
    match output.and_then(|output| collect(config, &output, interrupts)) {
        // Another launch made it; either data set will do.
        Err(error) if output_files::taken(&error) => {
            outln!(
                "collect: another process made {} meanwhile; it is used",
                path.display()
            );
            Ok(None)
        }
        collected => collected,
    }
}

/// Makes the data set of a config. Returns an exit code if a signal stopped it.
pub(crate) fn collect(
    config: &Config,
    output: &Output,
    interrupts: &Interrupts,
) -> anyhow::Result<Option<ExitCode>> {
    let start = Instant::now();
    let mut last = Instant::now();
    let stopped = || interrupts.count() > 0;
    let collected = actor::collect::collect(config, output, &stopped, |done, total| {
        if last.elapsed() > Duration::from_secs(2) {
            last = Instant::now();
            outln!("collect: {done} of {total} transitions");
        }
    })?;
    let Some(collected) = collected else {
        outln!("collect: stopped; no data set was written");
        return Ok(Some(ExitCode::from(exit::SIGNAL)));
    };
    outln!(
        "collect: {collected} in {:.0} s",
        start.elapsed().as_secs_f64()
    );
    Ok(None)
}
