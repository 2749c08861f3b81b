//! Files that a command writes at a path from the user.

use std::io;
use std::path::Path;
use std::process;

use anyhow::Context;
use dataset::DatasetError;
use durable::{Existing, Output, OutputError};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::exit;
use crate::fault::Input;
use crate::interrupts::not_ignored;

/// The argument `--force`.
#[derive(clap::Args, Clone, Copy)]
pub(crate) struct Force {
    /// Replace an output that is there already
    #[arg(long)]
    force: bool,
}

impl Force {
    /// What to do with an existing output.
    pub(crate) fn existing(self) -> Existing {
        if self.force {
            Existing::Replace
        } else {
            Existing::Refuse
        }
    }
}

/// Writes a file completely or not at all. Its folder must exist.
pub(crate) fn write(path: &Path, existing: Existing, bytes: &[u8]) -> anyhow::Result<()> {
    let output = Output::file(path, existing, &[])?;
    let writing = || format!("writing {}", path.display());
    if let Some(folder) = path.parent().filter(|folder| *folder != Path::new("")) {
        // The folder is not created, since it may be misspelled.
        std::fs::metadata(folder).with_context(writing)?;
    }
    let staged = output
        .stage::<anyhow::Error>(|file| io::Write::write_all(file, bytes).with_context(writing))?;
    Ok(staged.place()?)
}

/// Ends the process at a signal and removes its temporary files, in commands that do not handle signals.
pub(crate) fn end_at_signals() -> io::Result<()> {
    let mut signals = Signals::new(not_ignored(&[SIGINT, SIGTERM, SIGHUP]))?;
    std::thread::spawn(move || {
        if signals.forever().next().is_some() {
            durable::discard_staged();
            process::exit(exit::SIGNAL.into());
        }
    });
    Ok(())
}

/// Converts an error, with a fault of the named output as [`Input`].
pub(crate) fn as_input(error: DatasetError) -> anyhow::Error {
    match &error {
        DatasetError::Output(OutputError::Io { .. }) => error.into(),
        DatasetError::Output(_) => Input(error.to_string()).into(),
        _ => error.into(),
    }
}

/// Whether the error is that the output already exists.
pub(crate) fn taken(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref(),
        Some(OutputError::Exists(_) | OutputError::Appeared(_))
    )
}
