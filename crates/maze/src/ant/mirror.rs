//! The mirror image of an ant across the x axis: y, and what turns about x and z, change sign.
//!
//! The body is its own mirror image with legs 1 and 4 and legs 2 and 3 exchanged, so what an ant
//! did is, mirrored, what the same ant can do. A maze whose map is drawn with y upwards holds the
//! mirror images of the walks in one that is drawn with y downwards.

use crate::ant::JOINT_OF_ACTUATOR;
use crate::{ACTION, Action, OBSERVATION, Observation};

/// First column of the joint angles, and of the joint velocities.
const JOINTS: [usize; 2] = [7, 21];

/// The joint that a joint becomes: legs 1 and 4, 2 and 3 change places.
const fn across(joint: usize) -> usize {
    2 * (3 - joint / 2) + joint % 2
}

/// What a joint's angle, velocity or torque is multiplied with. Hips turn about z; an ankle's axis
/// becomes the opposite of the other leg's.
const fn sign(joint: usize) -> f32 {
    if joint.is_multiple_of(2) { -1.0 } else { 1.0 }
}

/// The mirrored observation. Twice is the observation itself.
#[must_use]
pub fn mirrored(observation: &Observation) -> Observation {
    let mut mirrored = *observation;
    // y; x and z of the quaternion; y of the velocity; x and z of the angular velocity.
    for column in [1, 4, 6, 16, 18, 20] {
        mirrored[column] = -observation[column];
    }
    for first in JOINTS {
        for joint in 0..ACTION {
            mirrored[first + across(joint)] = sign(joint) * observation[first + joint];
        }
    }
    mirrored
}

/// The mirrored action. Twice is the action itself.
#[must_use]
pub fn mirrored_action(action: &Action) -> Action {
    let mut mirrored = [0.0; ACTION];
    for (actuator, joint) in JOINT_OF_ACTUATOR.into_iter().enumerate() {
        let to = JOINT_OF_ACTUATOR
            .iter()
            .position(|other| *other == across(joint))
            .unwrap_or(actuator);
        mirrored[to] = sign(joint) * action[actuator];
    }
    mirrored
}

const _: () = assert!(JOINTS[1] + ACTION == OBSERVATION);

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::ant::JOINT_RANGES;
    use crate::{AntMaze, Layout, Physics};

    #[test]
    fn twice_mirrored_is_the_same_and_ranges_fit_each_other() {
        let o: Observation = std::array::from_fn(|i| i as f32 + 1.0);
        let a: Action = std::array::from_fn(|i| i as f32 + 1.0);
        assert_eq!(mirrored(&mirrored(&o)), o);
        assert_eq!(mirrored_action(&mirrored_action(&a)), a);
        assert_ne!(mirrored_action(&a), a);
        for (joint, range) in JOINT_RANGES.iter().enumerate() {
            let mut ends = range.map(|end| sign(joint) * end);
            ends.sort_by(f32::total_cmp);
            assert_eq!(ends, JOINT_RANGES[across(joint)]);
        }
    }

    /// Differences of the mirrored walk and the walk from the mirrored start by the image of each
    /// action, by column, as shares of values beyond 1.
    fn apart(
        seed: u64,
        height: f32,
        steps: usize,
        image_of: impl Fn(&Action) -> Action,
    ) -> Observation {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let layout = Layout::from_rows(&["rg"]).unwrap();
        let mut ant = AntMaze::new(&layout, Physics::OPEN_FLOOR);
        let mut image = ant.clone();
        let mut start = ant.reset([0.3, 0.7], &mut rng).observation;
        start[2] = height;
        ant.set(&start);
        image.set(&mirrored(&start));
        for _ in 0..steps {
            let action: Action = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            ant.step(&action);
            image.step(&image_of(&action));
        }
        let (wanted, mut got) = (mirrored(&ant.observation()), image.observation());
        // A quaternion and its opposite are one rotation.
        if (3..7).map(|i| wanted[i] * got[i]).sum::<f32>() < 0.0 {
            got[3..7].iter_mut().for_each(|value| *value = -*value);
        }
        std::array::from_fn(|i| (wanted[i] - got[i]).abs() / wanted[i].abs().max(1.0))
    }

    #[test]
    fn mirrored_actions_make_the_mirrored_walk_in_the_air() {
        for seed in 0..5 {
            let apart = apart(seed, 3.0, 6, mirrored_action);
            assert!(apart.iter().all(|off| *off < 2e-3), "{apart:?}");
        }
    }

    /// On the floor the order in which the solver meets the contacts tells the legs apart, so that
    /// walks part slowly; by actions that are not mirrored they part at once.
    #[test]
    fn mirrored_actions_make_the_mirrored_walk_on_the_floor() {
        let total = |image_of: fn(&Action) -> Action| -> f32 {
            let walks = (0..40).flat_map(|seed| apart(seed, 0.75, 3, image_of));
            walks.sum()
        };
        let (mirrored, same) = (total(mirrored_action), total(|action| *action));
        assert!(mirrored < 0.2 * same, "{mirrored} against {same}");
    }
}
