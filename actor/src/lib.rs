//! An actor: weights and graph in, rollouts and traces out.
//!
//! An actor simulates ants and sends what happened. It never waits for the learner's arithmetic:
//! it acts with the newest weights it has, and waits only when its window of unacknowledged
//! trajectories is full.

mod attach;
pub mod ceiling;
pub mod collect;
mod drive;
mod episode;
mod inbox;
mod player;
mod traces;
mod walker;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use config::Config;
use maze::Layout;
use wire::{Bus, RunDomain};

/// What an actor is told: by the launcher, its place in a run; by anyone else, a run to attach to.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// Join this run, by its name or folder, as one more actor, until Ctrl-C
    #[arg(long, value_name = "RUN", conflicts_with_all = ["domain", "folder", "id"])]
    pub attach: Option<String>,
    /// The run's domain of channels (8 hexadecimal digits; set by launch)
    #[arg(long, required_unless_present = "attach")]
    pub domain: Option<String>,
    /// The run's folder (set by launch)
    #[arg(long, required_unless_present = "attach")]
    pub folder: Option<PathBuf>,
    /// This actor's number (set by launch)
    #[arg(long, default_value_t = 0)]
    pub id: u32,
}

/// Runs an actor until the launcher says that all is done, or `stop` is set.
///
/// # Errors
/// A run that is not there, a channel that cannot be used, a config that cannot be read.
pub fn run(args: &Args, stop: &Arc<AtomicBool>) -> anyhow::Result<()> {
    let (folder, domain) = match (&args.attach, &args.domain, &args.folder) {
        (Some(run), ..) => attach::find(run)?,
        (None, Some(domain), Some(folder)) => (folder.clone(), RunDomain::open(domain)?),
        _ => anyhow::bail!("give --attach RUN; --domain and --folder are for launch"),
    };
    let config = agents::CONFIGS.of_run(&folder)?;
    let plan = agents::plan(&config).context("the config's algorithm is unknown")?;
    let layout = layout(&config)?;
    let stopped = || stop.load(Ordering::Relaxed);
    let attached = args.attach.is_some();
    let name = if attached { "attached" } else { "actor" };
    let bus = Bus::join(&domain, name)?;
    let claim = if attached {
        bus.claim_any(config.topology.actors as u32)?
    } else {
        bus.claim(args.id)?
    };
    let ended = attached.then(|| attach::watch(domain, stop)).transpose();
    let ended = ended.context("starting a thread")?;
    if attached {
        log::info!(
            "attached to {} as actor {}; Ctrl-C to leave",
            folder.display(),
            claim.actor
        );
    }
    let places = (&layout, folder.as_path());
    let sent = player::run(&config, &*plan, places, &bus, claim, &stopped)?;
    if let Some(ended) = ended {
        let sound = if sent.acknowledged { "all" } else { "not all" };
        log::info!(
            "left after {} transitions, {sound} acknowledged",
            sent.transitions
        );
        anyhow::ensure!(
            !ended.load(Ordering::Relaxed),
            "the run in {} is no longer alive",
            folder.display()
        );
    }
    Ok(())
}

/// The config's maze.
///
/// # Errors
/// What is wrong with the map.
pub fn layout(config: &Config) -> anyhow::Result<Layout> {
    let layout = Layout::of(&config.maze.layout, &config.maze.rows);
    layout.context("maze")
}

#[cfg(test)]
mod tests {
    /// `config` depends on no other crate, so its default is a number of its own.
    #[test]
    fn the_default_success_radius_is_the_mazes() {
        let config = agents::CONFIGS
            .parse(
                "[collect]\ntransitions = 1000\n[dataset]\npath = \"x\"\n",
                "x.toml",
                "x",
                &[],
            )
            .unwrap();
        let radius = config.evaluation.success_radius;
        assert_eq!(radius as f32, maze::SUCCESS_RADIUS);
    }
}
