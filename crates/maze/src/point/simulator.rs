//! The point mass as a [`Simulator`].

use rand::{Rng, RngExt};
use simulator::{Body, Simulator, StateError, Step, Task, Tasks, Values};

use super::body::{PointBody, RADIUS, STRIDE};
use crate::arena::Arena;
use crate::bytes::{put_floats, take_floats, take_number};
use crate::teleport::Teleports;
use crate::{CONTROL_SECONDS, Layout};

/// Reset noise: up to this far from the start in each axis (m).
const NOISE: f32 = 0.1;
/// A place of a state may be this deep in a wall by rounding (m).
const ROUNDING: f32 = 1e-3;
/// No velocity is larger (m/s).
const FASTEST: f32 = 10.0;

/// The point mass in a maze. Its [state](Simulator::state) is known at any time.
#[derive(Debug, Clone)]
pub struct PointSimulator {
    arena: Arena,
    teleports: Teleports,
    /// x, y (m), vx, vy (m/s).
    observation: [f32; 4],
}

impl PointSimulator {
    /// The point at rest in the start cell of a maze. An episode succeeds within `success_radius`
    /// (m) of its goal.
    #[must_use]
    pub fn new(layout: &Layout, success_radius: f32) -> Self {
        Self {
            arena: Arena::new(layout, success_radius),
            teleports: Teleports::new(layout),
            observation: [0.0; 4],
        }
    }

    /// Place, velocity, goal, and the state of the teleports.
    fn read(&self, mut bytes: &[u8]) -> Option<([f32; 4], [f32; 2], [u64; 2])> {
        let observation: [f32; 4] = take_floats(&mut bytes)?;
        let goal = take_floats(&mut bytes)?;
        let teleports = [take_number(&mut bytes)?, take_number(&mut bytes)?];
        let [x, y, velocity @ ..] = observation;
        let [out_x, out_y] = self.arena.layout.pushed_out([x, y], RADIUS);
        let possible = (out_x - x).hypot(out_y - y) <= ROUNDING
            && velocity.iter().all(|axis| axis.abs() <= FASTEST);
        (possible && bytes.is_empty()).then_some((observation, goal, teleports))
    }
}

impl Simulator for PointSimulator {
    fn body(&self) -> &'static dyn Body {
        &PointBody
    }

    fn draw(&self, tasks: Tasks, rng: &mut dyn Rng) -> Task {
        self.arena.draw(tasks, rng)
    }

    fn reset(&mut self, task: &Task, rng: &mut dyn Rng) {
        let place = task
            .start
            .map(|axis| axis + rng.random_range(-NOISE..=NOISE));
        let [x, y] = self.arena.layout.pushed_out(place, RADIUS);
        self.observation = [x, y, 0.0, 0.0];
        self.arena.set_goal(&task.goal);
        let exits = self.teleports.draw(rng);
        self.teleports.begin(exits);
    }

    fn step(&mut self, action: &[f32]) -> Step {
        let [x, y, ..] = self.observation;
        let stride = [0, 1].map(|axis| {
            let share = action.get(axis).copied().filter(|share| share.is_finite());
            STRIDE * share.unwrap_or(0.0).clamp(-1.0, 1.0)
        });
        let mut place = self
            .arena
            .layout
            .pushed_out([x + stride[0], y + stride[1]], RADIUS);
        let velocity = [place[0] - x, place[1] - y].map(|way| way / CONTROL_SECONDS);
        if let Some(outlet) = self.teleports.exit(place) {
            place = outlet;
        }
        self.observation = [place[0], place[1], velocity[0], velocity[1]];
        self.arena.step(place, false)
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
        let mut bytes = vec![];
        put_floats(&mut bytes, &self.observation);
        put_floats(&mut bytes, self.arena.goal());
        bytes.extend(
            self.teleports
                .state()
                .into_iter()
                .flat_map(u64::to_le_bytes),
        );
        Some(bytes)
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), StateError> {
        let (observation, goal, teleports) = self.read(state).ok_or(StateError)?;
        if !self.teleports.restore(teleports) {
            return Err(StateError);
        }
        self.observation = observation;
        self.arena.set_goal(&goal);
        Ok(())
    }

    fn poses(&self, poses: &mut Vec<[f32; 7]>) {
        let [x, y, ..] = self.observation;
        poses.push([x, y, RADIUS, 1.0, 0.0, 0.0, 0.0]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::{Route, SUCCESS_RADIUS, evaluation_task};

    fn point(maze: &str) -> PointSimulator {
        PointSimulator::new(&Layout::named(maze).unwrap(), SUCCESS_RADIUS)
    }

    /// Distance to the nearest wall's surface (m); negative within a wall.
    fn gap(layout: &Layout, [x, y]: [f32; 2]) -> f32 {
        let gaps = layout
            .boxes()
            .into_iter()
            .map(|[centre_x, centre_y, half_x, half_y]| {
                let [dx, dy] = [(x - centre_x).abs() - half_x, (y - centre_y).abs() - half_y];
                match dx > 0.0 || dy > 0.0 {
                    true => dx.max(0.0).hypot(dy.max(0.0)),
                    false => dx.max(dy),
                }
            });
        gaps.fold(f32::INFINITY, f32::min)
    }

    fn any_value() -> impl Strategy<Value = f32> {
        prop_oneof![
            -1.2_f32..1.2,
            Just(1.0),
            Just(-1.0),
            any::<f32>(),
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(f32::NEG_INFINITY),
        ]
    }

    fn any_maze() -> impl Strategy<Value = &'static str> {
        prop::sample::select(Layout::NAMES.to_vec())
    }

    /// Runs of one action, long enough to reach walls and corners.
    fn any_actions() -> impl Strategy<Value = Vec<([f32; 2], usize)>> {
        prop::collection::vec(([any_value(), any_value()], 1_usize..60), 1..40)
    }

    proptest! {
        #[test]
        fn it_is_never_in_a_wall_and_always_finite(
            maze in any_maze(), actions in any_actions(), seed in any::<u64>(),
        ) {
            let (mut point, mut rng) = (point(maze), Pcg64Mcg::seed_from_u64(seed));
            let task = point.draw(Tasks::Training, &mut rng);
            point.reset(&task, &mut rng);
            let layout = point.arena.layout.clone();
            for (action, times) in actions {
                for _ in 0..times {
                    point.step(&action);
                    let [x, y, vx, vy] = point.observation;
                    prop_assert!(gap(&layout, [x, y]) >= RADIUS - 1e-4, "{x} {y}");
                    // Round a corner it may be faster than its top speed.
                    prop_assert!(vx.abs() <= 5.0 && vy.abs() <= 5.0, "{vx} {vy}");
                }
            }
        }

        #[test]
        fn a_restored_state_replays_bit_by_bit(
            maze in any_maze(), actions in any_actions(), seed in any::<u64>(), at in 0_usize..20,
        ) {
            let (mut one, mut rng) = (point(maze), Pcg64Mcg::seed_from_u64(seed));
            let task = one.draw(Tasks::Evaluation, &mut rng);
            one.reset(&task, &mut rng);
            let all = || actions.iter().flat_map(|(action, n)| std::iter::repeat_n(action, *n));
            for action in all().take(at) { one.step(action); }
            let mut other = point(maze);
            other.restore(&one.state().unwrap()).unwrap();
            for action in all().skip(at) {
                prop_assert_eq!(one.step(action), other.step(action));
                prop_assert_eq!(one.state(), other.state());
            }
        }

        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let mut point = point("umaze");
            let _ = point.restore(&bytes);
            point.step(&[1.0, 1.0]);
            prop_assert!(point.observation.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn it_slides_along_a_wall_and_round_a_corner() {
        let mut point = point("medium");
        let layout = point.arena.layout.clone();
        // South-east against the wall south of the start; y grows to the south.
        for _ in 0..40 {
            point.step(&[0.0, -1.0]);
        }
        assert_eq!(point.observation[1], RADIUS - 2.0);
        let before = point.observation[0];
        let step = point.step(&[0.5, -1.0]);
        assert!((point.observation[0] - before - 0.1).abs() < 1e-6 && !step.success);
        assert_eq!(point.observation[3], 0.0);
        assert!(gap(&layout, [point.observation[0], point.observation[1]]) >= RADIUS - 1e-4);
    }

    #[test]
    fn a_straight_policy_takes_about_two_hundred_steps_through_medium() {
        let (mut point, mut rng) = (point("medium"), Pcg64Mcg::seed_from_u64(2));
        let layout = point.arena.layout.clone();
        for _ in 0..20 {
            let task = evaluation_task(&layout, &mut rng);
            let route = Route::new(&layout, task.goal, task.goal_cell);
            point.reset(&task.into(), &mut rng);
            let mut steps = 0;
            loop {
                let [x, y, ..] = point.observation;
                let way = route.direction(&layout, [x, y]).map(|axis| axis / STRIDE);
                steps += 1;
                if point.step(&way).success {
                    break;
                }
                assert!(steps < 300, "at {:?}", point.observation);
            }
            assert!((100..250).contains(&steps), "{steps} steps");
        }
    }

    #[test]
    fn an_inlet_takes_it_to_an_outlet() {
        let (mut point, mut rng) = (point("teleport"), Pcg64Mcg::seed_from_u64(0));
        let layout = point.arena.layout.clone();
        let [x, y] = layout.centre(layout.inlets()[0]);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..20 {
            point.reset(
                &Task {
                    start: [x, y + 1.75],
                    goal: vec![0.0, 0.0],
                },
                &mut rng,
            );
            // Two steps lead from outside into the circle about the inlet.
            point.step(&[0.0, -1.0]);
            point.step(&[0.0, -1.0]);
            let [x, y, ..] = point.observation;
            seen.insert(layout.cell_at([x, y]).unwrap());
        }
        assert!(
            seen.iter().all(|cell| layout.outlets().contains(cell)),
            "{seen:?}"
        );
        assert!(seen.len() > 1);
    }

    #[test]
    fn a_start_in_a_wall_and_states_that_are_none_are_refused_or_mended() {
        let (mut point, mut rng) = (point("umaze"), Pcg64Mcg::seed_from_u64(0));
        let layout = point.arena.layout.clone();
        point.reset(
            &Task {
                start: [0.0, 4.0],
                goal: vec![],
            },
            &mut rng,
        );
        assert!(gap(&layout, [point.observation[0], point.observation[1]]) > RADIUS);
        assert!(!point.step(&[0.0, 0.0]).success, "no goal is never reached");
        let state = point.state().unwrap();
        for (at, value) in [(0, f32::NAN), (1, 4.0), (2, 1e9)] {
            let mut bytes = state.clone();
            bytes[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
            assert_eq!(point.restore(&bytes), Err(StateError));
        }
        assert_eq!(point.restore(&state[1..]), Err(StateError));
        assert_eq!(point.state(), Some(state));
    }
}
