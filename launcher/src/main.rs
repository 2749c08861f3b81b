//! `formica`: launches a run and supervises its processes; the roles themselves are subcommands.
//!
//! Exit codes: see [`EXIT_CODES`].

#[macro_use]
mod output;

mod accounts;
mod allowance;
mod axis;
mod chart;
mod check;
mod children;
mod clock;
mod curves;
mod dataset;
mod doctor;
mod episode_picture;
mod fault;
mod figure;
mod floor_plan;
mod folder;
mod groups;
mod inputs;
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
mod resume;
mod role;
mod runs;
mod saved;
mod score;
mod stages;
mod story;
mod table;
mod tensorboard;
mod throughput;
mod traces;
#[cfg(feature = "live")]
mod watch;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Told by `formica --help`.
const EXIT_CODES: &str = "\
Exit codes:
  0    done
  1    failed; doctor: a run may not start or not last
  2    a fault in what was given: arguments, config, data
  3    done, but a trace is cut off or damaged (inspect, replay, recover)
  130  ended by Ctrl-C, SIGTERM or SIGHUP

A signal that was ignored from the start, as by nohup, stays ignored. A reader of the output that is
gone changes neither work nor exit code; output that cannot be written for another reason, such as a
full disk, makes 1 of 0, but not of launch and collect.";

/// Offline hierarchical reinforcement learning on a latent graph, as supervised processes.
#[derive(Parser)]
#[command(name = "formica", version, about, after_long_help = EXIT_CODES)]
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
    Recover(recovery::Args),
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
    /// A value laid over the file's: --set table.key=value. Relative paths in it and in the file
    /// begin at the present folder; `~` and `$NAME` are filled in
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = pair)]
    sets: Vec<(String, String)>,
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected table.key=value")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

fn main() -> ExitCode {
    // Where it cannot be done, such a file ends the process as it would have.
    let _ = allowance::outlive_small_files();
    output::listen();
    let code = match Cli::try_parse() {
        Ok(cli) => run(cli.command).unwrap_or_else(|error| {
            log::error!("{}", fault::sentence(&error));
            ExitCode::from(if fault::is_input(&error) { 2 } else { 1 })
        }),
        Err(told) => help(&told),
    };
    output::end(code)
}

/// Prints help, the version, or what is wrong with the arguments.
fn help(told: &clap::Error) -> ExitCode {
    let printed = told.print();
    if told.use_stderr() {
        return ExitCode::from(2);
    }
    if let Err(error) = printed {
        output::fail(&error);
    }
    ExitCode::SUCCESS
}

fn run(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Launch {
            config: LaunchArgs { config, over },
            resume,
            plain,
        } => match (config, resume) {
            (Some(path), _) => {
                let config = check::load(&path, &over.sets);
                config.and_then(|config| {
                    let data = check::data(&config)?;
                    launch::launch(&config, data, plain)
                })
            }
            (None, Some(run)) => launch::resume(&run, &over.sets, plain),
            (None, None) => Err(anyhow::anyhow!("name a run file, or a run to --resume")),
        },
        Command::Check(args) => check::load(&args.config, &args.over.sets).and_then(|config| {
            check::resources(&config)?;
            check::data(&config)?;
            say!(
                "{}: no fault found; the run's name is {}",
                args.config.display(),
                config.run.name
            );
            Ok(ExitCode::SUCCESS)
        }),
        Command::Collect {
            config: args,
            force,
        } => check::load(&args.config, &args.over.sets).and_then(|config| {
            output::detach();
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
        Command::Recover(args) => recovery::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Doctor(args) => doctor::doctor(&args),
        Command::Actor(args) => {
            output::detach();
            let args = runs::resolve(args)?;
            role::run(args.attach.is_none(), |stop| actor::run(&args, stop))
        }
        Command::Learner(args) => role::run(true, |stop| learner::run(&args, stop)),
        Command::GraphBuilder(args) => role::run(true, |stop| graph_builder::run(&args, stop)),
    }
}
