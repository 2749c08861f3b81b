//! A trace's metadata records, as strings for any tool and as types for ours.

use std::collections::BTreeMap;

use simulator::Spaces;

/// The simulator of traces that do not name one.
const FIRST_SIMULATOR: &str = "ant";
/// Keys of versions in traces of older versions, and their names now.
const OLD_VERSIONS: [(&str, &str); 3] = [
    ("low_version", "low"),
    ("high_version", "high"),
    ("graph_version", "graph"),
];
/// What keys of versions begin with.
const VERSION: &str = "version.";

/// Which episode a trace is of: the record `formica.episode`, written first. Keys of the record are
/// the fields' names unless stated.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EpisodeMeta {
    /// Version of Formica; key `formica`.
    pub version: String,
    /// Name of the run.
    pub run: String,
    /// Hash of the resolved configuration; key `config`.
    pub config_hash: String,
    /// The resolved configuration: the attachment `config.toml`, not in the record.
    pub config_toml: String,
    /// `evaluation`, `test` or `training`.
    pub purpose: String,
    /// Number of the actor.
    pub actor: u32,
    /// Number of the episode; key `episode`.
    pub episode_index: u64,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the maze's layout.
    pub maze: String,
    /// Name of the simulator; empty in older traces, see [`simulator`](Self::simulator).
    pub simulator: String,
    /// What is observed and done; none in older traces.
    pub spaces: Option<Spaces>,
    /// The place of the start, before reset noise: x, y (m).
    pub start: [f32; 2],
    /// The goal: x, y (m).
    pub goal: [f32; 2],
    /// Versions of the networks and the graph that the episode is played with, by name; keys
    /// `version.NAME`.
    pub versions: BTreeMap<String, u64>,
    /// Distance to the goal that counts as success (m).
    pub success_radius: f32,
}

/// How an episode ended: the record `formica.outcome`, written last.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outcome {
    /// Whether the goal was reached; key `outcome`: `success` or `failure`.
    pub success: bool,
    /// Whether the body had fallen at the end.
    pub fell: bool,
    /// Control steps.
    pub steps: u32,
    /// Undiscounted sum of rewards; key `return`. A hundred times it is the episode's normalized
    /// score, key `score`, since D4RL's references for antmaze are 0 and 1.
    pub episode_return: f32,
}

type Record = BTreeMap<String, String>;

fn place([x, y]: [f32; 2]) -> String {
    format!("[{x}, {y}]")
}

/// The value of a key; the type's default when it is missing or not of its type.
fn value<T: std::str::FromStr + Default>(record: &Record, key: &str) -> T {
    let value = record.get(key).and_then(|value| value.parse().ok());
    value.unwrap_or_default()
}

fn place_of(record: &Record, key: &str) -> Option<[f32; 2]> {
    let (x, y) = record
        .get(key)?
        .strip_prefix('[')?
        .strip_suffix(']')?
        .split_once(',')?;
    Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
}

fn record(entries: impl IntoIterator<Item = (&'static str, String)>) -> Record {
    let entries = entries.into_iter();
    entries
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
}

/// The versions of a record, whatever version of Formica wrote it.
fn versions(metadata: &Record) -> BTreeMap<String, u64> {
    let entries = metadata.iter().filter_map(|(key, value)| {
        let old = || {
            OLD_VERSIONS
                .iter()
                .find(|(old, _)| *old == key)
                .map(|(_, name)| *name)
        };
        let name = key.strip_prefix(VERSION).or_else(old)?;
        Some((name.to_owned(), value.parse().ok()?))
    });
    entries.collect()
}

impl EpisodeMeta {
    /// Name of the simulator; `ant` where the trace is from before there were others.
    #[must_use]
    pub fn simulator(&self) -> &str {
        match &*self.simulator {
            "" => FIRST_SIMULATOR,
            name => name,
        }
    }

    pub(crate) fn record(&self) -> Record {
        let mut record = record([
            ("formica", self.version.clone()),
            ("run", self.run.clone()),
            ("config", self.config_hash.clone()),
            ("purpose", self.purpose.clone()),
            ("actor", self.actor.to_string()),
            ("episode", self.episode_index.to_string()),
            ("seed", self.seed.to_string()),
            ("maze", self.maze.clone()),
            ("start", place(self.start)),
            ("goal", place(self.goal)),
            ("simulator", self.simulator.clone()),
            ("success_radius", self.success_radius.to_string()),
        ]);
        let spaces = self.spaces.iter();
        record.extend(spaces.map(|spaces| ("spaces".to_owned(), spaces.to_string())));
        let versions = self.versions.iter();
        record.extend(versions.map(|(name, n)| (format!("{VERSION}{name}"), n.to_string())));
        record
    }

    /// Reads the record back; a key that is missing or unreadable gives the type's default, for
    /// the strings themselves are at hand in [`Trace::metadata`](crate::Trace::metadata).
    pub(crate) fn of(metadata: &Record, config: String) -> Self {
        Self {
            version: value(metadata, "formica"),
            run: value(metadata, "run"),
            config_hash: value(metadata, "config"),
            config_toml: config,
            purpose: value(metadata, "purpose"),
            actor: value(metadata, "actor"),
            episode_index: value(metadata, "episode"),
            seed: value(metadata, "seed"),
            maze: value(metadata, "maze"),
            start: place_of(metadata, "start").unwrap_or_default(),
            goal: place_of(metadata, "goal").unwrap_or_default(),
            simulator: value(metadata, "simulator"),
            spaces: metadata
                .get("spaces")
                .and_then(|text| Spaces::parse(text).ok()),
            versions: versions(metadata),
            success_radius: value(metadata, "success_radius"),
        }
    }
}

impl Outcome {
    pub(crate) fn record(self) -> Record {
        let outcome = if self.success { "success" } else { "failure" };
        record([
            ("outcome", outcome.to_owned()),
            ("fell", self.fell.to_string()),
            ("steps", self.steps.to_string()),
            ("return", self.episode_return.to_string()),
            ("score", (100.0 * self.episode_return).to_string()),
        ])
    }

    /// None when the record does not say success or failure.
    pub(crate) fn of(metadata: &Record) -> Option<Self> {
        let success = match metadata.get("outcome")?.as_str() {
            "success" => true,
            "failure" => false,
            _ => return None,
        };
        Some(Self {
            success,
            fell: value(metadata, "fell"),
            steps: metadata.get("steps")?.parse().ok()?,
            episode_return: value(metadata, "return"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_by_their_old_names_too() {
        let metadata = record([
            ("low_version", "4".to_owned()),
            ("graph_version", "6".to_owned()),
            ("version.encoder", "9".to_owned()),
            ("version.high", "none".to_owned()),
        ]);
        let meta = EpisodeMeta::of(&metadata, String::new());
        let expected = [("encoder", 9), ("graph", 6), ("low", 4)];
        assert_eq!(
            meta.versions,
            expected.map(|(name, n)| (name.to_owned(), n)).into()
        );
        assert_eq!((meta.simulator(), &meta.spaces), ("ant", &None));
    }

    #[test]
    fn a_record_is_read_back() {
        let meta = EpisodeMeta {
            simulator: "point".to_owned(),
            spaces: Spaces::parse("u8:64x64x3 f32:2 2 0.05").ok(),
            versions: [("low".to_owned(), 7)].into(),
            goal: [1.5, -2.0],
            ..EpisodeMeta::default()
        };
        let record = meta.record();
        assert_eq!(
            (&*record["version.low"], &*record["goal"]),
            ("7", "[1.5, -2]")
        );
        assert_eq!(EpisodeMeta::of(&record, String::new()), meta);
    }
}
