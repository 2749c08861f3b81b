//! What an episode's metadata record says, as strings for any tool and as types for ours.

use std::collections::BTreeMap;

/// Which episode a trace is of. Keys of the record are the fields' names unless told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EpisodeMeta {
    /// Name of the run.
    pub run: String,
    /// Hash of the resolved configuration; key `config`.
    pub config_hash: String,
    /// The resolved configuration: the attachment `config.toml`, not in the record.
    pub config_toml: String,
    /// Number of the actor.
    pub actor: u32,
    /// Number of the episode; key `episode`.
    pub episode_index: u32,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the maze's layout.
    pub maze: String,
    /// Where the torso starts: x, y (m).
    pub start: [f32; 2],
    /// The goal: x, y (m).
    pub goal: [f32; 2],
    /// Version of the low-level weights at the start.
    pub low_version: u64,
    /// Version of the high-level weights at the start.
    pub high_version: u64,
    /// Version of the graph at the start.
    pub graph_version: u64,
    /// Distance to the goal that counts as success (m).
    pub success_radius: f32,
}

/// How an episode ended.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outcome {
    /// Whether the goal was reached; key `outcome`: `success` or `failure`.
    pub success: bool,
    /// Whether the ant lay on its back at the end.
    pub fell: bool,
    /// Control steps. The writer counts them itself: its count is what the file says.
    pub steps: u32,
    /// Undiscounted sum of rewards; key `return`.
    pub episode_return: f32,
}

fn place([x, y]: [f32; 2]) -> String {
    format!("[{x}, {y}]")
}

/// The value of a key; none when it is missing or not of its type.
fn value<T: std::str::FromStr>(metadata: &BTreeMap<String, String>, key: &str) -> Option<T> {
    metadata.get(key)?.parse().ok()
}

fn place_of(metadata: &BTreeMap<String, String>, key: &str) -> Option<[f32; 2]> {
    let (x, y) = metadata
        .get(key)?
        .strip_prefix('[')?
        .strip_suffix(']')?
        .split_once(',')?;
    Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
}

impl EpisodeMeta {
    pub(crate) fn record(&self) -> BTreeMap<String, String> {
        let entries = [
            ("run", self.run.clone()),
            ("config", self.config_hash.clone()),
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
        ];
        entries
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect()
    }

    /// Reads the record back; a key that is missing or unreadable gives the type's default, for
    /// the strings themselves are at hand in [`Summary::metadata`](crate::Summary::metadata).
    pub(crate) fn of(metadata: &BTreeMap<String, String>, config: String) -> Self {
        let text = |key: &str| metadata.get(key).cloned().unwrap_or_default();
        Self {
            run: text("run"),
            config_hash: text("config"),
            config_toml: config,
            actor: value(metadata, "actor").unwrap_or_default(),
            episode_index: value(metadata, "episode").unwrap_or_default(),
            seed: value(metadata, "seed").unwrap_or_default(),
            maze: text("maze"),
            start: place_of(metadata, "start").unwrap_or_default(),
            goal: place_of(metadata, "goal").unwrap_or_default(),
            low_version: value(metadata, "low_version").unwrap_or_default(),
            high_version: value(metadata, "high_version").unwrap_or_default(),
            graph_version: value(metadata, "graph_version").unwrap_or_default(),
            success_radius: value(metadata, "success_radius").unwrap_or_default(),
        }
    }
}

impl Outcome {
    pub(crate) fn record(self) -> BTreeMap<String, String> {
        let entries = [
            (
                "outcome",
                if self.success { "success" } else { "failure" }.to_owned(),
            ),
            ("fell", self.fell.to_string()),
            ("return", self.episode_return.to_string()),
        ];
        entries
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect()
    }

    /// None when the record does not say success or failure.
    pub(crate) fn of(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let success = match metadata.get("outcome")?.as_str() {
            "success" => true,
            "failure" => false,
            _ => return None,
        };
        Some(Self {
            success,
            fell: value(metadata, "fell").unwrap_or_default(),
            steps: value(metadata, "steps")?,
            episode_return: value(metadata, "return").unwrap_or_default(),
        })
    }
}
