//! `formica dataset`: shows and converts data sets.

mod visit_map;

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::dataset::{Dataset, Format, OnFault, Opened};
use clap::{Subcommand, ValueEnum};
use durable::Output;
use maze::Layout;

use crate::fault::Input;
use crate::output;
use crate::output_files::{self, Force};
use visit_map::visit_map;

#[derive(Subcommand)]
pub(crate) enum Action {
    /// Print what a data set of any format is: episodes, lengths, returns, coverage of the maze
    Info {
        /// A D4RL HDF5 file, a Minari folder or main_data.hdf5, or an OGBench npz
        file: PathBuf,
        /// The maze to draw the walls of: umaze, medium, large, giant or teleport
        #[arg(long)]
        maze: Option<String>,
        /// What becomes of episodes that break the format's rules
        #[arg(long, default_value = "refuse")]
        on_fault: Faulty,
    },
    /// Write a data set in another format
    Convert {
        /// A data set of any format
        input: PathBuf,
        /// Where to: a file, or for Minari a folder
        output: PathBuf,
        /// The format to write
        #[arg(long)]
        to: Target,
        /// Share of the episodes, the last ones, that go to OUTPUT-val.npz (OGBench only)
        #[arg(long, default_value_t = 0.0)]
        val_share: f64,
        /// What becomes of episodes that break the format's rules
        #[arg(long, default_value = "refuse")]
        on_fault: Faulty,
        #[command(flatten)]
        force: Force,
    },
}

/// `dataset.on_fault`, as an argument.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Faulty {
    /// The data set is refused
    Refuse,
    /// They are left out whole, unless they are more than half
    DropEpisode,
}

impl From<Faulty> for OnFault {
    fn from(faulty: Faulty) -> Self {
        match faulty {
            Faulty::Refuse => Self::Refuse,
            Faulty::DropEpisode => Self::DropEpisode,
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Target {
    D4rl,
    Minari,
    Ogbench,
}

impl Target {
    fn format(self) -> Format {
        match self {
            Self::D4rl => Format::D4rl,
            Self::Minari => Format::Minari,
            Self::Ogbench => Format::Ogbench,
        }
    }
}

/// A fault in what the user gave.
fn refused(reason: impl Display) -> anyhow::Error {
    Input(reason.to_string()).into()
}

pub(crate) fn run(action: &Action) -> anyhow::Result<ExitCode> {
    match action {
        Action::Info {
            file,
            maze,
            on_fault,
        } => info(file, maze.as_deref(), *on_fault)?,
        Action::Convert {
            input,
            output: output_path,
            to,
            val_share,
            on_fault,
            force,
        } => {
            if !(0.0..1.0).contains(val_share) {
                return Err(refused("--val-share is not in 0 to 1, 1 excluded"));
            }
            if *val_share > 0.0 && *to != Target::Ogbench {
                return Err(refused("--val-share is for --to ogbench alone"));
            }
            let output = |path: &Path| {
                let format = to.format();
                let existing = force.existing();
                format
                    .output(path, existing, &[input])
                    .map_err(output_files::as_input)
            };
            let training = output(output_path)?;
            let validation = (*val_share > 0.0)
                .then(|| output(&::dataset::ogbench::validation_path(training.path())))
                .transpose()?;
            let source = open(input, *on_fault)?;
            convert(
                &source,
                to.format(),
                *val_share,
                &training,
                validation.as_ref(),
            )?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The output of `collect`.
pub(crate) fn output(path: &Path, force: Force, inputs: &[&Path]) -> anyhow::Result<Output> {
    let output = Format::D4rl.output(path, force.existing(), inputs);
    output.map_err(output_files::as_input)
}

/// Reads a data set, and warns about episodes that are left out.
fn open(path: &Path, on_fault: Faulty) -> anyhow::Result<Opened> {
    let opened = ::dataset::open_with(path, on_fault.into()).map_err(refused)?;
    if opened.dropped.episodes > 0 {
        log::warn!("{}", opened.dropped);
    }
    Ok(opened)
}

fn info(file: &Path, maze: Option<&str>, on_fault: Faulty) -> anyhow::Result<()> {
    let layout = maze.map(Layout::named).transpose().map_err(refused)?;
    let Opened { format, data, .. } = open(file, on_fault)?;
    outln!("format        {format}");
    outln!("{}", data.summary());
    output::text(format!("\n{}", visit_map(&data, layout.as_ref())));
    Ok(())
}

/// Writes a data set in another format. The last episodes go to the `validation` file if there is one.
fn convert(
    source: &Opened,
    to: Format,
    val_share: f64,
    training: &Output,
    validation: Option<&Output>,
) -> anyhow::Result<()> {
    output_files::end_at_signals()?;
    let Opened { format, data, .. } = source;
    let total = data.episodes.len();
    let kept = total - (val_share * total as f64).ceil() as usize;
    if kept == 0 {
        return Err(refused(format!(
            "--val-share {val_share} of {total} episodes leaves none for training"
        )));
    }
    let parts: Vec<(&Output, Dataset)> = match validation {
        Some(validation) => vec![
            (training, data.select(0..kept)),
            (validation, data.select(kept..total)),
        ],
        None => vec![(training, data.clone())],
    };
    // All files are written before any is moved to its path.
    let staged: Result<Vec<_>, _> = parts
        .iter()
        .map(|(output, data)| to.stage(output, data).map_err(output_files::as_input))
        .collect();
    for (staged, (output, data)) in staged?.into_iter().zip(&parts) {
        staged
            .place()
            .map_err(|error| output_files::as_input(error.into()))?;
        let (rows, episodes) = (data.len(), data.episodes.len());
        let path = output.path().display();
        outln!("{path}: {rows} rows in {episodes} episodes, {to} from {format}");
    }
    Ok(())
}
