//! The learner: data set and rollouts in, weights and checkpoints out.
//!
//! Channels are the main thread's alone; it never computes for long, so that trajectories are
//! acknowledged and late joiners served at once. Each network is trained on a thread of its own
//! and reports over an in-process channel.

mod choices;
mod codes;
mod encoder;
mod high;
mod low;
mod offline;
mod save;
mod walk;

pub use offline::Diverged;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use config::{Config, Kind};
use wire::{Bus, RunDomain};

/// What the learner is told.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// The run's domain of channels (8 hexadecimal digits)
    #[arg(long)]
    pub domain: String,
    /// The run's folder
    #[arg(long)]
    pub folder: PathBuf,
}

/// Runs the learner until the launcher says that all is done, or `stop` is set.
///
/// # Errors
/// A run that is not there, a channel that cannot be used, a config or data set that cannot be
/// read.
pub fn run(args: &Args, stop: &Arc<AtomicBool>) -> anyhow::Result<()> {
    let config = Config::of_run(&args.folder)?;
    let domain = RunDomain::open(&args.domain)?;
    let bus = Bus::join(&domain, "learner")?;
    match config.run.kind {
        Kind::Walker => walk::run(&config, &args.folder, &bus, &|| {
            stop.load(Ordering::Relaxed)
        }),
        Kind::Offline => offline::run(&config, &args.folder, &bus, stop),
    }
}
