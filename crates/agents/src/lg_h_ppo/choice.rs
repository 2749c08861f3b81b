//! A choice of the high level, from the policy that made it to the stages that learn from it.

use crate::rollout::Rollout;

/// How a choice ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The chosen node was reached.
    Reached,
    /// It was given up.
    GivenUp,
    /// The episode's goal was reached on the way.
    Arrived,
}

/// A choice that ended. Nodes are counted as in the version of the graph that it was made on.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Node chosen at.
    pub node: u32,
    /// The goal's node.
    pub goal: u32,
    /// Node chosen.
    pub subgoal: u32,
    /// Its log-probability when it was chosen.
    pub log_prob: f32,
    /// Control steps until the choice ended.
    pub steps: u32,
    /// How it ended.
    pub ending: Ending,
    /// Node where it ended.
    pub next: u32,
    /// Neighbours that it could not fall on, since they had been given up.
    pub excluded: Vec<u32>,
}

/// Words of a choice that excludes nothing.
const HEAD: usize = 7;

impl Choice {
    /// Whether the goal was reached, or its node.
    #[must_use]
    pub fn arrived(&self) -> bool {
        self.ending == Ending::Arrived || self.next == self.goal
    }

    /// Appends its record: the number of its words, then these.
    pub fn write(&self, choices: &mut Vec<u32>) {
        choices.push((HEAD + self.excluded.len()) as u32);
        choices.extend([
            self.node,
            self.goal,
            self.subgoal,
            self.log_prob.to_bits(),
            self.steps,
            self.ending as u32,
            self.next,
        ]);
        choices.extend_from_slice(&self.excluded);
    }

    /// Reads its words; `None` where they are none of a choice.
    #[must_use]
    pub fn read(words: &[u32]) -> Option<Self> {
        let (&[node, goal, subgoal, log_prob, steps, ending, next], excluded) =
            words.split_first_chunk::<HEAD>()?;
        let endings = [Ending::Reached, Ending::GivenUp, Ending::Arrived];
        let choice = Self {
            node,
            goal,
            subgoal,
            log_prob: f32::from_bits(log_prob),
            steps,
            ending: *endings.get(ending as usize)?,
            next,
            excluded: excluded.to_vec(),
        };
        let sound = choice.log_prob.is_finite() && excluded.len() <= graph::MAX_OUT_DEGREE;
        sound.then_some(choice)
    }

    /// Those of a rollout. Records that are no choice are left out.
    pub fn of<'a>(rollout: &Rollout<'a>) -> impl Iterator<Item = Self> + use<'a> {
        rollout.records().filter_map(Self::read)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn choices_come_back_and_no_words_panic(
            numbers in prop::array::uniform5(any::<u32>()),
            log_prob in -50.0..0.0_f32,
            ending in prop::sample::select(vec![Ending::Reached, Ending::GivenUp, Ending::Arrived]),
            excluded in prop::collection::vec(any::<u32>(), 0..48),
            words in prop::collection::vec(any::<u32>(), 0..60),
        ) {
            let [node, goal, subgoal, steps, next] = numbers;
            let choice = Choice {
                node, goal, subgoal, log_prob, steps, ending, next, excluded,
            };
            let mut record = vec![];
            choice.write(&mut record);
            prop_assert_eq!(record[0] as usize, record.len() - 1);
            prop_assert_eq!(Choice::read(&record[1..]), Some(choice));
            if let Some(choice) = Choice::read(&words) {
                prop_assert!(choice.log_prob.is_finite());
            }
        }
    }
}
