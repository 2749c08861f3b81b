//! What prepared data were made from: files, and the settings that shape what is made of them.

use std::fs;
use std::io;
use std::path::Path;
use std::time::UNIX_EPOCH;

use config::Config;
use serde::{Deserialize, Serialize};

use crate::{Needs, minari};

/// Tells data of one source and settings from others. Files that a data set's links lead to are not
/// looked at.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    files: Vec<Source>,
    settings: String,
}

/// A file that is read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Source {
    path: String,
    bytes: u64,
    /// Time of its last modification, from 1970 (ns); 0 where the system has none.
    modified: u64,
}

impl Stamp {
    /// That of a config's data set as it is now, for an algorithm with these needs.
    ///
    /// # Errors
    /// A data set that is not there.
    pub fn of(config: &Config, needs: &Needs) -> io::Result<Self> {
        let path = std::path::absolute(&config.dataset.path)?;
        let mut files = vec![];
        if fs::metadata(&path)?.is_dir() {
            for name in minari::HOLDS.iter().chain(minari::HOLDS_ITSELF) {
                // Those that are missing are not read.
                files.extend(source(&path.join(name)));
            }
        } else {
            files.push(source(&path)?);
        }
        let dataset = &config.dataset;
        let settings = (
            env!("CARGO_PKG_VERSION"),
            (&config.maze.layout, &config.maze.rows),
            (&dataset.leave_out, dataset.fit, dataset.on_fault),
            (&config.run.simulator, needs),
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
