//! What an evaluation came to: `score.json` and `episodes.csv`, read back.

use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, bail};
use serde::Deserialize;

use crate::recorded::if_there;

/// `score.json`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Outcome {
    pub(crate) score: f64,
    pub(crate) episodes: u64,
    pub(crate) successes: u64,
    pub(crate) fallen: u64,
    #[serde(rename = "mean_steps_of_successes")]
    pub(crate) mean_steps: Option<f64>,
    /// Hash of the config.
    pub(crate) config: String,
    /// Of formica.
    pub(crate) version: String,
    /// When it was written, as far as the file tells.
    #[serde(skip)]
    pub(crate) ended: Option<SystemTime>,
}

impl Outcome {
    /// None where the run has no score yet.
    pub(crate) fn read(folder: &Path) -> anyhow::Result<Option<Self>> {
        let path = folder.join("score.json");
        let Some(bytes) = if_there(&path)? else {
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

/// An episode of `episodes.csv`, as far as the report tells of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Episode {
    /// Nodes chosen, and reached of these.
    pub(crate) chosen: u64,
    pub(crate) reached: u64,
    /// The least distance to the goal (m).
    pub(crate) nearest: f64,
}

/// All of them; none where there is no such file.
pub(crate) fn episodes(folder: &Path) -> anyhow::Result<Vec<Episode>> {
    let path = folder.join("episodes.csv");
    match if_there(&path)? {
        Some(bytes) => parse(&String::from_utf8_lossy(&bytes), &path),
        None => Ok(vec![]),
    }
}

/// Columns are found by their names: earlier versions had others beside them.
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
    fn episodes_are_read_by_the_names_of_their_columns() {
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
    fn a_score_that_is_damaged_is_named_with_its_line() {
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
