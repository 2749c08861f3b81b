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
