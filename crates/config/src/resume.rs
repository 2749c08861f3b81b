//! What a change of a key means for a run that is resumed.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::fault::shown;
use crate::key::{Key, OnResume};
use crate::sections::Config;

/// A key that has changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// `table.key`.
    pub key: String,
    /// The value that the states were made with, as TOML, shortened; none where there was no such key.
    pub old: Option<String>,
    /// The value that is asked for now.
    pub new: Option<String>,
    /// What becomes of it, in a run of this kind.
    pub on_resume: OnResume,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "nothing".to_owned());
        let (old, new) = (value(&self.old), value(&self.new));
        write!(f, "{}: {old} -> {new}", self.key)
    }
}

impl Config {
    /// The keys that have changed since a run's states were made with `made`, and what becomes of
    /// each when the run is resumed.
    #[must_use]
    pub fn changes(&self, made: &Self) -> Vec<Change> {
        let (old, new) = (flat(made.resolved()), flat(self.resolved()));
        let keys: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
        let changed = keys
            .into_iter()
            .filter(|key| old.get(*key) != new.get(*key));
        changed
            .map(|key| Change {
                key: key.clone(),
                old: old.get(key).map(|value| shown(value)),
                new: new.get(key).map(|value| shown(value)),
                on_resume: match (self.on_resume(key), made.run.deterministic) {
                    (OnResume::Rollouts | OnResume::Protocol, true) => OnResume::Fixed,
                    (on_resume, _) => on_resume,
                },
            })
            .collect()
    }

    /// Its keys, as they were read.
    #[must_use]
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// All values by `table.key`, in TOML.
    #[must_use]
    pub fn values(&self) -> BTreeMap<String, String> {
        flat(self.resolved())
    }

    /// Paths of files that a run reads, by `table.key`. What makes the data set is none of them.
    #[must_use]
    pub fn inputs(&self) -> Vec<(String, PathBuf)> {
        let values = flat_texts(self.resolved());
        let inputs = self
            .keys
            .iter()
            .filter(|key| key.on_resume == OnResume::Input);
        let inputs = inputs.filter(|key| key.table != "collect");
        let named = inputs.map(|key| format!("{}.{}", key.table, key.key));
        named
            .filter_map(|key| {
                let path = values.get(&key).filter(|path| !path.is_empty())?;
                Some((key.clone(), PathBuf::from(path)))
            })
            .collect()
    }

    /// What a change of a key means; of one that this config does not have, it is fixed.
    fn on_resume(&self, path: &str) -> OnResume {
        let (table, name) = path.split_once('.').unwrap_or((path, ""));
        let mut keys = self.keys.iter();
        let key = keys.find(|key| (key.table, key.key) == (table, name));
        key.map_or(OnResume::Fixed, |key| key.on_resume)
    }
}

/// Texts by `table.key`.
fn flat_texts(resolved: &str) -> BTreeMap<String, String> {
    let mut texts = BTreeMap::new();
    for (table, value) in toml::from_str::<toml::Table>(resolved).unwrap_or_default() {
        for (key, value) in value.as_table().into_iter().flatten() {
            if let Some(text) = value.as_str() {
                // Written so that nothing of it is filled in again.
                let path = crate::paths::expand(text, |_| None);
                texts.insert(format!("{table}.{key}"), path.unwrap_or_default());
            }
        }
    }
    texts
}

/// Values by `table.key`.
fn flat(resolved: &str) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    for (table, value) in toml::from_str::<toml::Table>(resolved).unwrap_or_default() {
        if let toml::Value::Table(keys) = value {
            for (key, value) in keys {
                flat.insert(format!("{table}.{key}"), value.to_string());
            }
        }
    }
    flat
}
