//! A key of a run file, and what a change of it means for a run that is resumed.

/// What becomes of a key that has changed since a run's states were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OnResume {
    /// Taken: it says how processes are run and watched, not what they make.
    Free,
    /// Taken, but not in a deterministic run, whose result follows from its first config: it says
    /// what is played in training.
    Rollouts,
    /// Taken: episodes of the evaluation that were played count, those that are missing are
    /// played.
    Episodes,
    /// Taken, but not in a deterministic run: it says what an episode is, so the evaluation is
    /// played anew.
    Protocol,
    /// A file that was read: taken where its content is the same, as when it was moved.
    Input,
    /// Refused: it shapes the data, the weights or the graph.
    Fixed,
}

/// A key of a run file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// Its table.
    pub table: &'static str,
    /// Its name.
    pub key: &'static str,
    /// What a change of it means for a run that is resumed.
    pub on_resume: OnResume,
}

/// Tables that have a key of this name, each once.
pub(crate) fn tables_with(keys: &[Key], name: &str) -> Vec<&'static str> {
    let with = keys.iter().filter(|key| key.key == name);
    let mut tables: Vec<&'static str> = vec![];
    for key in with {
        if !tables.contains(&key.table) {
            tables.push(key.table);
        }
    }
    tables
}
