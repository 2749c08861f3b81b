//! `formica`: launches a run and supervises its processes; the roles themselves are subcommands.
//!
//! Exit codes: 0 fine, 1 failed, 2 a fault in what the user gave, 3 done but with a trace that is
//! cut off, 130 ended by Ctrl-C.

mod accounts;
mod axis;
mod chart;
mod check;
mod children;
mod curves;
mod dataset;
mod doctor;
mod episode_picture;
mod floor_plan;
mod folder;
mod groups;
mod inspect;
mod interrupts;
mod launch;
mod live;
mod markup;
mod metrics;
mod outputs;
mod picture;
mod progress;
mod recorded;
mod recovery;
mod replay;
mod report;
mod role;
mod saved;
mod score;
mod stages;
mod story;
mod table;
mod tensorboard;
mod throughput;
#[cfg(feature = "live")]
mod watch;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Offline hierarchical reinforcement learning on a latent graph, as supervised processes.
#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run what a config describes: data, training, evaluation
    Launch {
        #[command(flatten)]
        config: LaunchArgs,
        /// Go on with a run that was stopped or killed, by its name or folder
        #[arg(long, value_name = "RUN", conflicts_with_all = ["config", "sets"])]
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
        force: outputs::Force,
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
    Inspect(inspect::Args),
    /// Play a run's newest traces to Foxglove or Lichtblick on this machine
    #[cfg(feature = "live")]
    Watch(watch::Args),
    /// Simulate a trace's actions again and compare every state bit by bit
    Replay {
        /// The trace
        trace: PathBuf,
    },
    /// Make a whole trace of what is whole of one that was cut off
    Recover {
        /// The trace, a .part or a damaged one
        trace: PathBuf,
        /// Where it goes; X.cut.mcap beside it by default
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Everything that runs have left, as one page: scores, curves, graph, paths, stages, config
    Report(report::Args),
    /// Look at this machine, and clear what dead runs left in shared memory
    Doctor,
    /// An actor of a run (started by launch)
    Actor(actor::Args),
    /// The learner of a run (started by launch)
    Learner(learner::Args),
    /// The graph-builder of a run (started by launch)
    GraphBuilder(graph_builder::Args),
}

#[derive(clap::Args)]
struct LaunchArgs {
    /// The run file
    #[arg(required_unless_present = "resume")]
    config: Option<PathBuf>,
    #[command(flatten)]
    over: Over,
}

#[derive(clap::Args)]
struct ConfigArgs {
    /// The run file
    config: PathBuf,
    #[command(flatten)]
    over: Over,
}

#[derive(clap::Args)]
struct Over {
    /// A value laid over the file's: --set table.key=value
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = pair)]
    sets: Vec<(String, String)>,
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected table.key=value")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Launch {
            config: LaunchArgs { config, over },
            resume,
            plain,
        } => match (config, resume) {
            (Some(path), _) => {
                check::load(&path, &over.sets).and_then(|config| launch::launch(&config, plain))
            }
            (None, Some(run)) => launch::resume(&run, plain),
            (None, None) => Err(anyhow::anyhow!("name a run file, or a run to --resume")),
        },
        Command::Check(args) => check::load(&args.config, &args.over.sets).map(|_| {
            println!("{}: no fault found", args.config.display());
            ExitCode::SUCCESS
        }),
        Command::Collect {
            config: args,
            force,
        } => check::load(&args.config, &args.over.sets).and_then(|config| {
            let path = Path::new(&config.dataset.path);
            let output = dataset::output(path, force, &[&args.config])?;
            let interrupts = interrupts::Interrupts::listen()?;
            let stopped = role::collect(&config, &output, &interrupts)?;
            Ok(stopped.unwrap_or(ExitCode::SUCCESS))
        }),
        Command::Ceiling {
            config,
            episodes,
            walker,
        } => check::load(&config.config, &config.over.sets).and_then(|config| {
            let path = walker.as_deref();
            role::ceiling(&config, episodes, path).map(|()| ExitCode::SUCCESS)
        }),
        Command::Dataset(action) => dataset::run(&action),
        Command::Curves(args) => curves::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        #[cfg(feature = "live")]
        Command::Watch(args) => watch::run(&args),
        Command::Replay { trace } => replay::run(&trace),
        Command::Recover { trace, out } => recovery::run(&trace, out.as_deref()),
        Command::Report(args) => report::run(&args),
        Command::Doctor => doctor::doctor(),
        Command::Actor(args) => role::run(|stop| actor::run(&args, stop)),
        Command::Learner(args) => role::run(|stop| learner::run(&args, stop)),
        Command::GraphBuilder(args) => role::run(|stop| graph_builder::run(&args, stop)),
    };
    result.unwrap_or_else(|error| {
        // A terminal that is gone is no reason to panic.
        let _ = writeln!(std::io::stderr(), "formica: {error:#}");
        let given = error.is::<config::Faults>() || error.is::<dataset::Refused>();
        ExitCode::from(if given { 2 } else { 1 })
    })
}
