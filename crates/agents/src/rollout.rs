//! What stages and graph rules see of an actor's trajectory.

use simulator::{Rows, flags};

/// Part of an episode as an actor sent it.
#[derive(Debug, Clone, Copy)]
pub struct Rollout<'a> {
    /// Its steps, the final row among them.
    pub rows: Rows<'a>,
    /// Choices that ended in it, as the policy wrote them.
    pub choices: &'a [u32],
    /// Version of the graph that was acted on, 0 for none.
    pub graph_version: u64,
    /// Its [structure](graph::Graph::structure), 0 where it is not known any more.
    pub structure: u64,
    /// The same for all parts of an episode, another one for every other episode of a run.
    pub episode: u64,
}

impl<'a> Rollout<'a> {
    /// Whether it is of a test, from which no policy learns.
    #[must_use]
    pub fn is_test(&self) -> bool {
        self.rows.iter().any(|row| row.has(flags::TEST))
    }

    /// The words of each choice; nothing where their lengths are not those of choices.
    pub fn records(&self) -> impl Iterator<Item = &'a [u32]> + use<'a> {
        let mut rest = self.choices;
        std::iter::from_fn(move || {
            let (length, words) = rest.split_first()?;
            let (record, after) = words.split_at_checked(*length as usize)?;
            rest = after;
            Some(record)
        })
    }
}

/// Appends a choice's words, behind their number.
pub fn push_record(words: &[u32], choices: &mut Vec<u32>) {
    choices.push(words.len() as u32);
    choices.extend_from_slice(words);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use simulator::{RowLayout, Space, Spaces};

    use super::*;

    fn layout() -> RowLayout {
        RowLayout::new(&Spaces {
            observation: Space::vector(4),
            action: Space::vector(2),
            goal: 2,
            control_seconds: 0.1,
        })
    }

    proptest! {
        #[test]
        fn records_come_back_and_any_words_are_read(
            records in prop::collection::vec(prop::collection::vec(any::<u32>(), 0..9), 0..9),
            words in prop::collection::vec(prop_oneof![any::<u32>(), 0..9_u32], 0..30),
        ) {
            let layout = layout();
            let rollout = |choices| Rollout {
                rows: layout.rows(&[]),
                choices,
                graph_version: 0,
                structure: 0,
                episode: 0,
            };
            let mut choices = vec![];
            records.iter().for_each(|record| push_record(record, &mut choices));
            prop_assert!(rollout(&choices).records().eq(records.iter().map(Vec::as_slice)));
            let read: usize = rollout(&words).records().map(|record| record.len() + 1).sum();
            prop_assert!(read <= words.len());
        }
    }
}
