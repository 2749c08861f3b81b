//! The learner: data set and rollouts in, weights and checkpoints out.
//!
//! Channels are the main thread's alone; it never computes for long, so that trajectories are
//! acknowledged and late joiners served at once. Each stage of the algorithm is trained on a thread of
//! its own and reports over an in-process channel.

mod commands;
mod main_loop;
mod policy_lag;
mod save;
mod stage;
mod stages;

pub use main_loop::Diverged;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context;
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
    let config = agents::CONFIGS.of_run(&args.folder)?;
    let plan = agents::plan(&config).context("the config's algorithm is unknown")?;
    let domain = RunDomain::open(&args.domain)?;
    let bus = Bus::join(&domain, "learner")?;
    main_loop::run(&config, &*plan, &args.folder, &bus, stop)
}
