//! The command line.

use std::path::PathBuf;

use clap::{Parser, Subcommand};

#[cfg(feature = "live")]
use crate::commands::watch;
use crate::commands::{curves, dataset, doctor, inspect, recover, report};
use crate::exit;
use crate::output_files::Force;

/// Offline hierarchical reinforcement learning on a latent graph, as supervised processes.
#[derive(Parser)]
#[command(name = "formica", version, about, after_long_help = exit::EXIT_CODES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Run what a config describes: data, training, evaluation
    Launch {
        #[command(flatten)]
        config: LaunchArgs,
        /// Go on with a run that was stopped or killed, by its name or folder; --set changes what
        /// does not shape its data, weights or graph
        #[arg(long, value_name = "RUN", conflicts_with = "config")]
        resume: Option<String>,
        /// Say lines in a terminal too, instead of the live view
        #[arg(long)]
        plain: bool,
    },
    /// Name every fault of a config and what it needs, before anything starts
    Check(ConfigArgs),
    /// Make the offline data set of a config
    Collect {
        #[command(flatten)]
        config: ConfigArgs,
        #[command(flatten)]
        force: Force,
    },
    /// Look at data sets and convert them: D4RL, Minari, OGBench
    #[command(subcommand)]
    Dataset(dataset::Action),
    /// Walk the maze with the walker and a perfect planner: the ceiling of any method
    Ceiling {
        #[command(flatten)]
        config: ConfigArgs,
        /// Episodes
        #[arg(long, default_value_t = 100)]
        episodes: usize,
        /// Weights of the walker; the ones built in by default
        #[arg(long)]
        walker: Option<PathBuf>,
    },
    /// Draw learning curves of runs, with mean and spread over seeds, and print their final scores
    Curves(curves::Args),
    /// Tell what happened in a recorded episode; of a folder of traces, a table
    ///
    /// Exit code: 0 the trace is whole, 1 it cannot be read, 3 it is cut off or damaged.
    Inspect(inspect::Args),
    /// Play a run's newest traces to Foxglove or Lichtblick on this machine
    #[cfg(feature = "live")]
    Watch(watch::Args),
    /// Simulate a trace's actions again and compare every state bit by bit
    ///
    /// Exit code: 0 all states are the same, 1 one differs or the trace cannot be simulated, 3 all
    /// that is there is the same, and the rest is cut off or damaged.
    Replay {
        /// The trace; of a folder or a run all of its traces
        trace: PathBuf,
    },
    /// Make a whole trace of what is whole of one that is cut off or damaged
    ///
    /// Exit code: 0 nothing was lost, 1 nothing can be recovered, 3 something was lost; what, is said.
    Recover(recover::Args),
    /// Everything that runs have left, as one page: scores, curves, graph, paths, stages, config
    Report(report::Args),
    /// Look at this machine, and clear what dead runs left in shared memory
    Doctor(doctor::Args),
    /// An actor of a run (started by launch)
    Actor(actor::Args),
    /// The learner of a run (started by launch)
    Learner(learner::Args),
    /// The graph-builder of a run (started by launch)
    GraphBuilder(graph_builder::Args),
}

#[derive(clap::Args)]
pub(crate) struct LaunchArgs {
    /// The run file
    #[arg(required_unless_present = "resume")]
    pub(crate) config: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) over: Over,
}

#[derive(clap::Args)]
pub(crate) struct ConfigArgs {
    /// The run file
    pub(crate) config: PathBuf,
    #[command(flatten)]
    pub(crate) over: Over,
}

#[derive(clap::Args)]
pub(crate) struct Over {
    /// A value laid over the file's: --set table.key=value. Relative paths in it and in the file
    /// begin at the present folder; `~` and `$NAME` are filled in
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = pair)]
    pub(crate) sets: Vec<(String, String)>,
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected table.key=value")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}
