//! What a trace's metadata records say, as strings for any tool and as types for ours.

use std::collections::BTreeMap;

/// Which episode a trace is of: the record `formica.episode`, written first. Keys of the record are
/// the fields' names unless told.
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
    /// The torso's place at the start, before reset noise: x, y (m).
    pub start: [f32; 2],
    /// The goal: x, y (m).
    pub goal: [f32; 2],
    /// Version of the low-level weights.
    pub low_version: u64,
    /// Version of the high-level weights.
    pub high_version: u64,
    /// Version of the graph.
    pub graph_version: u64,
    /// Distance to the goal that counts as success (m).
    pub success_radius: f32,
}

/// How an episode ended: the record `formica.outcome`, written last.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outcome {
    /// Whether the goal was reached; key `outcome`: `success` or `failure`.
    pub success: bool,
    /// Whether the ant lay on its back at the end.
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

fn record<const N: usize>(entries: [(&str, String); N]) -> Record {
    let entries = entries.into_iter();
    entries
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
}

impl EpisodeMeta {
    pub(crate) fn record(&self) -> Record {
        record([
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
            ("low_version", self.low_version.to_string()),
            ("high_version", self.high_version.to_string()),
            ("graph_version", self.graph_version.to_string()),
            ("success_radius", self.success_radius.to_string()),
        ])
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
            low_version: value(metadata, "low_version"),
            high_version: value(metadata, "high_version"),
            graph_version: value(metadata, "graph_version"),
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
