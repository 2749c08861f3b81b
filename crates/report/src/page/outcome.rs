//! The outcome of an evaluation, read from `score.json` and `episodes.csv`.

use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, bail};
use runs::file;
use serde::Deserialize;

/// `score.json`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct Outcome {
    pub(super) score: f64,
    pub(super) episodes: u64,
    pub(super) successes: u64,
    pub(super) fallen: u64,
    #[serde(rename = "mean_steps_of_successes")]
    pub(super) mean_steps: Option<f64>,
    /// Hash of the config.
    pub(super) config: String,
    /// Version of formica.
    pub(super) version: String,
    /// Modification time of the file.
    #[serde(skip)]
    pub(super) ended: Option<SystemTime>,
}

impl Outcome {
    /// Reads a run's outcome; `None` if it has no score yet.
    pub(super) fn read(folder: &Path) -> anyhow::Result<Option<Self>> {
        let path = folder.join("score.json");
        let Some(bytes) = file::read(&path)? else {
            return Ok(None);
        };
        let outcome: Self = serde_json::from_slice(&bytes).map_err(|error| {
            let (path, line) = (path.display(), error.line());
            anyhow::anyhow!("{path}:{line}: {error}; give the one that a run wrote")
        })?;
        let ended = path.metadata().and_then(|data| data.modified()).ok();
        Ok(Some(Self { ended, ..outcome }))
    }
}

/// The columns of `episodes.csv` that the report uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Episode {
    /// Number of chosen nodes, and of those that were reached.
    pub(super) chosen: u64,
    pub(super) reached: u64,
    /// Least distance to the goal (m).
    pub(super) nearest: f64,
}

/// All episodes; empty if there is no such file.
pub(super) fn episodes(folder: &Path) -> anyhow::Result<Vec<Episode>> {
    let path = folder.join("episodes.csv");
    match file::read(&path)? {
        Some(bytes) => parse(&String::from_utf8_lossy(&bytes), &path),
        None => Ok(vec![]),
    }
}

/// Finds columns by name, since earlier versions had other columns too.
fn parse(text: &str, path: &Path) -> anyhow::Result<Vec<Episode>> {
    let path = path.display();
    let mut lines = text.lines().enumerate();
    let header = lines.next().map_or("", |(_, line)| line);
    let names: Vec<&str> = header.split(',').collect();
    let column = |name: &str| {
        let found = names.iter().position(|other| *other == name);
        found.with_context(|| {
            format!("{path}:1: no column '{name}'; give the episodes.csv that a run wrote")
        })
    };
    let (edges, reached, nearest) = (column("edges")?, column("reached")?, column("nearest_m")?);
    let mut episodes = vec![];
    for (i, line) in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let whole = fields.len() == names.len();
        let episode = || {
            Some(Episode {
                chosen: fields.get(edges)?.parse().ok()?,
                reached: fields.get(reached)?.parse().ok()?,
                nearest: fields.get(nearest)?.parse().ok()?,
            })
        };
        match episode().filter(|_| whole) {
            Some(episode) => episodes.push(episode),
            None => {
                let shown: String = line.chars().take(80).collect();
                bail!(
                    "{path}:{}: expected '{header}', found '{}'; mend the line or take it out",
                    i + 1,
                    shown.escape_debug()
                )
            }
        }
    }
    Ok(episodes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name() {
        let read = |text: &str| parse(text, Path::new("e.csv"));
        let episode = Episode {
            chosen: 12,
            reached: 11,
            nearest: 0.5,
        };
        let older =
            "episode,actor,success,steps,fell,nearest_m,edges,reached\n0,1,1,263,0,0.5,12,11\n";
        assert_eq!(read(older).unwrap(), [episode]);
        let newer = "episode,success,steps,fell,nearest_m,edges,reached\n0,1,263,0,0.5,12,11\n";
        assert_eq!(read(newer).unwrap(), [episode]);
        let error = read("episode,success\n0,1\n").unwrap_err().to_string();
        assert!(error.starts_with("e.csv:1: no column 'edges'"), "{error}");
        for damaged in [
            "0,1,263,0,0.5,12\n",
            "0,1,263,0,0.5,12,11,1\n",
            "0,1,263,0,0.5,x,11\n",
        ] {
            let error = read(&newer.replace("0,1,263,0,0.5,12,11\n", damaged)).unwrap_err();
            assert!(
                error.to_string().starts_with("e.csv:2: expected"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_damaged_score_is_an_error_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Outcome::read(folder.path()).unwrap().is_none());
        let path = folder.path().join("score.json");
        std::fs::write(&path, "{\"score\": 99.0,\n\"episodes\": \"many\"}").unwrap();
        let error = Outcome::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("score.json:2: "), "{error}");
        std::fs::write(&path, "{\"score\": 99.0, \"successes\": 99}").unwrap();
        let outcome = Outcome::read(folder.path()).unwrap().unwrap();
        assert_eq!((outcome.score, outcome.successes), (99.0, 99));
        assert!(outcome.ended.is_some());
    }
}
