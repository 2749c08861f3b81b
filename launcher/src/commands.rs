//! The commands.

pub(crate) mod curves;
pub(crate) mod dataset;
pub(crate) mod doctor;
pub(crate) mod inspect;
pub(crate) mod recover;
mod replay;
pub(crate) mod report;
#[cfg(feature = "live")]
pub(crate) mod watch;

use std::path::Path;
use std::process::ExitCode;

use config::Config;

use crate::cli::{Command, LaunchArgs};
use crate::interrupts::Interrupts;
use crate::supervise::{collect, launch, role};
use crate::{check, output};

/// Runs a command.
pub(crate) fn run(command: Command) -> anyhow::Result<ExitCode> {
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
            outln!(
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
            let interrupts = Interrupts::listen()?;
            let stopped = collect::collect(&config, &output, &interrupts)?;
            Ok(stopped.unwrap_or(ExitCode::SUCCESS))
        }),
        Command::Ceiling {
            config,
            episodes,
            walker,
        } => check::load(&config.config, &config.over.sets).and_then(|config| {
            let path = walker.as_deref();
            ceiling(&config, episodes, path)
        }),
        Command::Dataset(action) => dataset::run(&action),
        Command::Curves(args) => curves::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        #[cfg(feature = "live")]
        Command::Watch(args) => watch::run(&args),
        Command::Replay { trace } => replay::run(&trace),
        Command::Recover(args) => recover::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Actor(args) => {
            output::detach();
            let args = resolve(args)?;
            role::run(args.attach.is_none(), |stop| actor::run(&args, stop))
        }
        Command::Learner(args) => role::run(true, |stop| learner::run(&args, stop)),
        Command::GraphBuilder(args) => role::run(true, |stop| graph_builder::run(&args, stop)),
    }
}

/// Walks a maze with a perfect planner.
fn ceiling(config: &Config, episodes: usize, walker: Option<&Path>) -> anyhow::Result<ExitCode> {
    let result = actor::ceiling::measure(config, episodes, walker)?;
    outln!("{result}");
    Ok(ExitCode::SUCCESS)
}

/// The arguments of an actor, with the folder of the run to attach to. The actor itself reports a run
/// that is not found, unless another one has a similar name.
fn resolve(mut args: actor::Args) -> anyhow::Result<actor::Args> {
    if let Some(name) = &args.attach {
        match runs::find::find(Path::new(name)) {
            Ok(folder) => args.attach = folder.to_str().map(str::to_owned),
            Err(_) => {
                if let Some(near) = runs::find::similar(name) {
                    anyhow::bail!("there is no run '{name}'; did you mean '{near}'?");
                }
            }
        }
    }
    Ok(args)
}
