//! What a trajectory tells of the high level's choices.

use agents::high::Settled;
use wire::{Transition, flags};

/// The choices of a trajectory that were settled, and the node after the last. Tests have none.
pub(crate) fn of(record: &[Transition]) -> (Vec<Settled>, u32) {
    if record.iter().any(|step| step.has(flags::TEST)) {
        return (vec![], 0);
    }
    let (mut found, mut last) = (vec![], 0);
    for (at, t) in wire::settled(record) {
        let (start, end) = (&record[at], &record[t]);
        if start.goal_node < 0 {
            continue;
        }
        let arrived = end.has(flags::SUCCESS) || end.node == start.goal_node;
        found.push(Settled {
            node: start.node.max(0) as u32,
            goal: start.goal_node.max(0) as u32,
            subgoal: start.subgoal.max(0) as u32,
            log_prob: start.log_prob,
            steps: (t - at) as u32,
            arrived,
        });
        last = end.node.max(0) as u32;
        if arrived {
            break;
        }
    }
    (found, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(node: i32, subgoal: i32, flags: u32) -> Transition {
        Transition {
            node,
            subgoal,
            goal_node: 9,
            log_prob: -0.5,
            flags,
            ..Transition::default()
        }
    }

    #[test]
    fn choices_are_settled_one_by_one_and_the_last_open_one_is_left_out() {
        let mut record = [
            step(1, 2, flags::CHOICE),
            step(1, 2, 0),
            step(2, 3, flags::REACHED | flags::CHOICE),
            step(2, 3, 0),
            step(2, 4, flags::FAILED | flags::CHOICE),
        ];
        let (found, last) = of(&record);
        let told: Vec<_> = found
            .iter()
            .map(|c| (c.node, c.subgoal, c.steps, c.arrived))
            .collect();
        assert_eq!(told, [(1, 2, 2, false), (2, 3, 2, false)]);
        assert_eq!(last, 2);
        record[0].flags |= flags::TEST;
        assert!(of(&record).0.is_empty());
    }

    #[test]
    fn the_final_row_settles_the_last_choice() {
        let record = [
            step(1, 2, flags::CHOICE),
            step(9, -1, flags::REACHED | flags::FINAL),
        ];
        let (found, last) = of(&record);
        assert!(found[0].arrived);
        assert_eq!((found[0].steps, last), (1, 9));
    }
}
