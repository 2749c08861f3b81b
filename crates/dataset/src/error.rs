//! What can be wrong with a data set.

use std::io;
use std::path::PathBuf;

/// Why a data set could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The system refused.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Where it should be written, something stands that is not to be replaced, or the system refused.
    #[error(transparent)]
    Output(#[from] durable::OutputError),
    /// Not a file of a format that is known, a damaged one, or one without episodes.
    #[error("{path}: {reason}", path = .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A key of the layout is not there or cannot be read.
    #[error("{path}: '{key}': {reason}", path = .path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// The key, by its whole path within the file.
        key: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A key of another shape than the layout has, or of another length than the first key.
    #[error("{path}: '{key}' has shape {got:?}, expected {expected}", path = .path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// The key, by its whole path within the file.
        key: String,
        /// The shape found.
        got: Vec<u64>,
        /// The shape wanted.
        expected: String,
    },
    /// Rows of a key that cannot be decoded.
    #[error("{path}: '{key}': rows {first} to {last}: {reason}", path = .path.display())]
    Rows {
        /// The file.
        path: PathBuf,
        /// The key, by its whole path within the file.
        key: String,
        /// The first such row.
        first: usize,
        /// The last one that is known to be damaged.
        last: usize,
        /// What is wrong with them.
        reason: String,
    },
    /// Too many episodes are faulty to leave them out.
    #[error(
        "{path}: {episodes} of {of} episodes are faulty, more than half, so they are not left out; \
         the first: {first}",
        path = .path.display()
    )]
    Faulty {
        /// The file.
        path: PathBuf,
        /// Faulty episodes.
        episodes: usize,
        /// Episodes in all.
        of: usize,
        /// What is wrong with the first.
        first: String,
    },
    /// An episode is faulty, and could be left out.
    #[error(
        "{0}; dataset.on_fault = \"drop-episode\" in a config, or --on-fault drop-episode, leaves \
         such episodes out"
    )]
    Episode(Box<DatasetError>),
    /// A value that is NaN or infinite.
    #[error("{path}: '{key}' holds a value that is not finite in row {row}", path = .path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The key, by its whole path within the file.
        key: String,
        /// The first such row.
        row: usize,
    },
}

impl DatasetError {
    /// The error with its remedy, where leaving the faulty episodes out may be one.
    pub(crate) fn with_remedy(self) -> Self {
        let episode = match &self {
            // Flags that end episodes are no fault of one episode.
            Self::NotFinite { key, .. } | Self::Rows { key, .. } => {
                key != "timeouts" && key != "terminals"
            }
            Self::Key { key, .. } | Self::Shape { key, .. } => key.starts_with("episode_"),
            _ => false,
        };
        if episode {
            Self::Episode(Box::new(self))
        } else {
            self
        }
    }

    /// What is wrong, without the file's path.
    pub(crate) fn reason(&self) -> String {
        let text = self.to_string();
        let (Self::Io { path, .. }
        | Self::Format { path, .. }
        | Self::Key { path, .. }
        | Self::Shape { path, .. }
        | Self::Rows { path, .. }
        | Self::Faulty { path, .. }
        | Self::NotFinite { path, .. }) = self
        else {
            return text;
        };
        let path = format!("{}: ", path.display());
        text.strip_prefix(&path).unwrap_or(&text).to_owned()
    }
}

/// What the system refused about a file.
pub(crate) fn io_error(path: &std::path::Path, source: io::Error) -> DatasetError {
    DatasetError::Io {
        path: path.to_path_buf(),
        source,
    }
}
