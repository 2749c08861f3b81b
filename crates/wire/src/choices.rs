//! The high level's choices within a trajectory, and where they were settled.

use crate::records::{Transition, flags};

/// Pairs of rows: of a choice, and of its end, where the chosen node was reached or given up or the
/// goal reached. A choice that is open at the trajectory's end is left out.
pub fn settled(record: &[Transition]) -> impl Iterator<Item = (usize, usize)> + '_ {
    let mut open = None;
    record.iter().enumerate().filter_map(move |(t, step)| {
        let ends = flags::REACHED | flags::FAILED | flags::SUCCESS;
        let ended = if step.has(ends) { open.take() } else { None };
        if step.has(flags::CHOICE) && step.node >= 0 && step.subgoal >= 0 {
            open = Some(t);
        }
        ended.map(|at| (at, t))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_may_end_one_choice_and_begin_the_next() {
        let step = |node, flags| Transition {
            node,
            subgoal: 2,
            flags,
            ..Transition::default()
        };
        let record = [
            step(1, flags::CHOICE),
            step(1, 0),
            step(2, flags::REACHED | flags::CHOICE),
            step(3, flags::FAILED),
            step(-1, flags::CHOICE),
            step(3, flags::REACHED),
            step(3, flags::CHOICE),
            step(4, flags::SUCCESS),
            step(4, flags::CHOICE),
        ];
        let pairs: Vec<_> = settled(&record).collect();
        assert_eq!(pairs, [(0, 2), (2, 3), (6, 7)]);
    }
}
