//! An actor: weights and graph in, rollouts and traces out.
//!
//! An actor simulates ants and sends what happened. It never waits for the learner's arithmetic:
//! it acts with the newest weights it has, and waits only when its window of unacknowledged
//! trajectories is full.

pub mod ceiling;
pub mod collect;
mod inbox;
mod navigate;
mod walk;
mod walker;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use config::{Config, Kind};
use maze::Layout;
use wire::{Bus, RunDomain};

/// Rows of a trajectory of the hierarchy, its final row included.
pub const TRAJECTORY_STEPS: usize = navigate::TRAJECTORY_STEPS;

/// What every role is told.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// The run's domain of channels (8 hexadecimal digits)
    #[arg(long)]
    pub domain: String,
    /// The run's folder
    #[arg(long)]
    pub folder: PathBuf,
    /// This actor's number
    #[arg(long, default_value_t = 0)]
    pub id: u32,
}

/// Runs an actor until the launcher says that all is done, or `stop` is set.
///
/// # Errors
/// A run that is not there, a channel that cannot be used, a config that cannot be read.
pub fn run(args: &Args, stop: &Arc<AtomicBool>) -> anyhow::Result<()> {
    let config = Config::load(&args.folder.join("config.toml"), &[])?;
    let layout = layout(&config)?;
    let domain = RunDomain::open(&args.domain)?;
    let bus = Bus::join(&domain, &format!("actor-{}", args.id))?;
    let stopped = || stop.load(Ordering::Relaxed);
    match config.run.kind {
        Kind::Walker => walk::run(&config, &layout, &bus, args.id, &stopped),
        Kind::Offline => navigate::run(&config, &layout, &args.folder, &bus, args.id, &stopped),
    }
}

/// The config's maze.
///
/// # Errors
/// What is wrong with the map.
pub fn layout(config: &Config) -> anyhow::Result<Layout> {
    let layout = Layout::of(&config.maze.layout, &config.maze.rows);
    layout.context("maze")
}
