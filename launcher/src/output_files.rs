//! Outputs that a command's user names.

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

/// `--force`, for commands with an output.
#[derive(clap::Args, Clone, Copy)]
pub(crate) struct Force {
    /// Replace an output that is there already
    #[arg(long)]
    force: bool,
}

impl Force {
    /// What becomes of an output that is there already.
    pub(crate) fn existing(self) -> Existing {
        if self.force {
            Existing::Replace
        } else {
            Existing::Refuse
        }
    }
}

/// Writes a page or a picture, whole or not at all, in a folder that is there.
pub(crate) fn write(path: &Path, existing: Existing, bytes: &[u8]) -> anyhow::Result<()> {
    let output = Output::file(path, existing, &[])?;
    let writing = || format!("writing {}", path.display());
    if let Some(folder) = path.parent().filter(|folder| *folder != Path::new("")) {
        // A folder that is misspelled is not made.
        std::fs::metadata(folder).with_context(writing)?;
    }
    let staged = output
        .stage::<anyhow::Error>(|file| io::Write::write_all(file, bytes).with_context(writing))?;
    Ok(staged.place()?)
}

/// Ends the process at a signal, without what it has staged: for commands that nothing else ends
/// early.
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

/// The error, as one of the user's where the output that was named cannot be written.
pub(crate) fn given(error: DatasetError) -> anyhow::Error {
    match &error {
        DatasetError::Output(OutputError::Io { .. }) => error.into(),
        DatasetError::Output(_) => Input(error.to_string()).into(),
        _ => error.into(),
    }
}

/// Whether an error is that something stands where an output was to go.
pub(crate) fn taken(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref(),
        Some(OutputError::Exists(_) | OutputError::Appeared(_))
    )
}
