//! What prepared data were made from: the data set's files, and the settings that affect the result.

use std::fs;
use std::io;
use std::path::Path;
use std::time::UNIX_EPOCH;

use config::Config;
use serde::{Deserialize, Serialize};

use crate::{Needs, minari};

/// Identifies a data set's files, by path, length and modification time, and the settings it was
/// prepared with. Targets of links within an HDF5 file are not included.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    files: Vec<Source>,
    settings: String,
}

/// A file of the data set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Source {
    path: String,
    bytes: u64,
    /// Modification time since 1970 (ns); 0 if unknown.
    modified: u64,
}

impl Stamp {
    /// Stamp of a config's data set as it is now, for an algorithm with these needs.
    ///
    /// # Errors
    /// The data set does not exist.
    pub fn of(config: &Config, needs: &Needs) -> io::Result<Self> {
        let path = std::path::absolute(&config.dataset.path)?;
        let mut files = vec![];
        if fs::metadata(&path)?.is_dir() {
            for name in minari::HOLDS.iter().chain(minari::HOLDS_ITSELF) {
                // The reader skips missing ones, too.
                files.extend(source(&path.join(name)));
            }
        } else {
            files.push(source(&path)?);
        }
        let dataset = &config.dataset;
        let settings = (
            env!("CARGO_PKG_VERSION"),
            &config.run.simulator,
            (&config.maze.layout, &config.maze.rows),
            (&dataset.leave_out, dataset.fit, dataset.on_fault),
            needs,
        );
        Ok(Self {
            files,
            settings: format!("{settings:?}"),
        })
    }
}

fn source(path: &Path) -> io::Result<Source> {
    let about = fs::metadata(path)?;
    let modified = about.modified().ok();
    let since = modified.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    Ok(Source {
        path: path.display().to_string(),
        bytes: about.len(),
        modified: since.map_or(0, |since| since.as_nanos() as u64),
    })
}
