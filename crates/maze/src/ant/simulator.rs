//! The ant as a [`Simulator`].

use rand::Rng;
use simulator::{Body, Simulator, StateError, Step, Task, Tasks, Values};

use crate::arena::Arena;
use crate::bytes::{put_floats, take_floats, take_number};
use crate::{ACTION, AntBody, AntMaze, FALLEN, Layout, Observation, Physics, Start, upright};

/// No value of a start that can be simulated is larger.
const LARGEST: f32 = 1e6;
/// A quaternion shorter than this has no direction.
const SHORTEST: f32 = 1e-3;

/// The ant in a maze.
///
/// Its [state](Simulator::state) is known at the start of an episode only: later, rapier's caches
/// are part of it, and they cannot be written.
#[derive(Clone)]
pub struct AntSimulator {
    world: AntMaze,
    arena: Arena,
    observation: Observation,
    /// Of the episode, until its first step.
    start: Option<Start>,
}

impl AntSimulator {
    /// The ant at rest at the origin of a maze. An episode succeeds within `success_radius` (m) of
    /// its goal. A clone is cheaper than another one.
    #[must_use]
    pub fn new(layout: &Layout, success_radius: f32) -> Self {
        let world = AntMaze::new(layout, Physics::MAZE);
        Self {
            observation: world.observation(),
            world,
            arena: Arena::new(layout, success_radius),
            start: None,
        }
    }

    /// The [state](Simulator::state) at the start of an episode with a goal (m).
    #[must_use]
    pub fn state_of(start: &Start, goal: [f32; 2]) -> Vec<u8> {
        let mut bytes = vec![];
        put_floats(&mut bytes, &start.observation);
        bytes.extend(start.exits.to_le_bytes());
        put_floats(&mut bytes, &goal);
        bytes
    }
}

/// The start and the goal of a state.
fn start_of(mut bytes: &[u8]) -> Option<(Start, [f32; 2])> {
    let start = Start {
        observation: take_floats(&mut bytes)?,
        exits: take_number(&mut bytes)?,
    };
    let goal = take_floats(&mut bytes)?;
    let norm = start.observation[3..7]
        .iter()
        .map(|value| value * value)
        .sum::<f32>()
        .sqrt();
    let possible = start.observation.iter().all(|value| value.abs() <= LARGEST) && norm >= SHORTEST;
    (possible && bytes.is_empty()).then_some((start, goal))
}

impl Simulator for AntSimulator {
    fn body(&self) -> &'static dyn Body {
        &AntBody
    }

    fn draw(&self, tasks: Tasks, rng: &mut dyn Rng) -> Task {
        self.arena.draw(tasks, rng)
    }

    fn reset(&mut self, task: &Task, rng: &mut dyn Rng) {
        self.start = Some(self.world.reset(task.start, rng));
        self.arena.set_goal(&task.goal);
        self.observation = self.world.observation();
    }

    fn step(&mut self, action: &[f32]) -> Step {
        let mut torques = [0.0; ACTION];
        for (torque, value) in torques.iter_mut().zip(action) {
            *torque = *value;
        }
        self.start = None;
        self.world.step(&torques);
        self.observation = self.world.observation();
        let [x, y, ..] = self.observation;
        self.arena.step([x, y], upright(&self.observation) < FALLEN)
    }

    fn observation(&self) -> Values<'_> {
        Values::F32(&self.observation)
    }

    fn goal(&self) -> &[f32] {
        self.arena.goal()
    }

    fn goal_of(&self, observation: Values<'_>, goal: &mut Vec<f32>) {
        goal.extend(observation.floats().into_iter().flatten().take(2));
    }

    fn state(&self) -> Option<Vec<u8>> {
        self.start
            .map(|start| Self::state_of(&start, *self.arena.goal()))
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), StateError> {
        let (start, goal) = start_of(state).ok_or(StateError)?;
        self.world.begin(&start);
        self.arena.set_goal(&goal);
        self.observation = self.world.observation();
        self.start = Some(start);
        Ok(())
    }

    fn poses(&self, poses: &mut Vec<[f32; 7]>) {
        poses.extend(self.world.body_poses());
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::SUCCESS_RADIUS;

    fn ant(maze: &str) -> AntSimulator {
        AntSimulator::new(&Layout::named(maze).unwrap(), SUCCESS_RADIUS)
    }

    /// What random actions of a seed lead to, bit by bit.
    fn played(ant: &mut AntSimulator, seed: u64) -> Vec<[u32; 29]> {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        (0..40)
            .map(|_| {
                let action: Vec<f32> = (0..8).map(|_| rng.random_range(-1.5..=1.5)).collect();
                ant.step(&action);
                ant.observation.map(f32::to_bits)
            })
            .collect()
    }

    #[test]
    fn a_restored_start_leads_to_the_same_bits() {
        for maze in ["medium", "teleport"] {
            let (mut one, mut rng) = (ant(maze), Pcg64Mcg::seed_from_u64(3));
            let layout = one.arena.layout.clone();
            let mut task = one.draw(Tasks::Evaluation, &mut rng);
            // Beside the first inlet, where there is one.
            if let Some(inlet) = layout.inlets().first() {
                let [x, y] = layout.centre(*inlet);
                task.start = [x + 1.3, y];
            }
            one.reset(&task, &mut rng);
            let state = one.state().unwrap();
            let first = played(&mut one, 8);
            assert_eq!(one.state(), None, "rapier's caches cannot be written");
            let mut other = ant(maze);
            played(&mut other, 9);
            other.restore(&state).unwrap();
            assert_eq!(other.state().as_ref(), Some(&state));
            assert_eq!(played(&mut other, 8), first, "{maze}");
        }
    }

    #[test]
    fn it_is_the_same_ant_as_without_the_trait() {
        let (mut ant, mut rng) = (ant("large"), Pcg64Mcg::seed_from_u64(5));
        let task = ant.draw(Tasks::Training, &mut rng);
        let mut world = AntMaze::new(&ant.arena.layout, Physics::MAZE);
        let mut same = rng.clone();
        ant.reset(&task, &mut rng);
        world.reset(task.start, &mut same);
        for _ in 0..40 {
            let action: [f32; 8] = std::array::from_fn(|_| rng.random_range(-1.0..=1.0));
            ant.step(&action);
            world.step(&action);
            assert_eq!(ant.observation, world.observation());
        }
        let mut poses = vec![];
        ant.poses(&mut poses);
        assert_eq!(poses, world.body_poses());
        assert_eq!(poses.len(), ant.body().parts().len());
    }

    #[test]
    fn the_goal_gives_the_only_reward_and_a_fall_is_seen() {
        let (mut ant, mut rng) = (ant("medium"), Pcg64Mcg::seed_from_u64(1));
        let near = Task {
            start: [0.0, 0.0],
            goal: vec![0.1, 0.1],
        };
        ant.reset(&near, &mut rng);
        assert_eq!(
            ant.step(&[0.0; 8]),
            Step {
                reward: 1.0,
                success: true,
                terminated: true,
                fell: false
            }
        );
        let mut back = ant.observation;
        back[2..7].copy_from_slice(&[0.4, 0.0, 1.0, 0.0, 0.0]);
        let start = Start {
            observation: back,
            exits: 0,
        };
        ant.restore(&AntSimulator::state_of(&start, [9.0, 9.0]))
            .unwrap();
        assert_eq!(
            ant.step(&[]),
            Step {
                reward: 0.0,
                success: false,
                terminated: false,
                fell: true
            }
        );
        let mut goal = vec![];
        ant.goal_of(ant.observation(), &mut goal);
        assert_eq!(goal, ant.observation[..2]);
    }

    #[test]
    fn bytes_that_are_no_state_are_refused_and_change_nothing() {
        let (mut ant, mut rng) = (ant("umaze"), Pcg64Mcg::seed_from_u64(1));
        let task = ant.draw(Tasks::Evaluation, &mut rng);
        ant.reset(&task, &mut rng);
        let state = ant.state().unwrap();
        let with = |at: usize, value: f32| {
            let mut bytes = state.clone();
            bytes[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
            bytes
        };
        let mut flat = state.clone();
        flat[12..28].fill(0);
        for bytes in [
            &state[1..],
            &[],
            &[&state[..], &[0]].concat(),
            &with(0, f32::NAN),
        ]
        .into_iter()
        .chain([&*with(9, 1e30), &flat])
        {
            assert_eq!(ant.restore(bytes), Err(StateError));
        }
        assert_eq!(ant.state(), Some(state));
    }
}
