//! What the walker is trained in: an ant that is to walk in a direction, which changes.

use maze::{
    ACTION, AntBody, AntMaze, CONTROL_SECONDS, Layout, Observation, Physics, Route, Style,
    TIPPED_OVER, random_task, upright,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use simulator::{Body, Simulator, StateError, Step, Task, Tasks, Values};

use super::settings::Settings;

/// Cost of the mean squared action.
const EFFORT_COST: f32 = 0.02;
/// Control steps of an episode at most.
pub(super) const EPISODE_STEPS: usize = 1000;
/// A route's goal is reached within this distance (m).
const ARRIVED: f32 = 1.0;

/// An ant whose goal is a unit direction. On the open floor the direction is drawn anew now and then,
/// in the maze it is that of a shortest path to a random goal.
pub(super) struct Stroll {
    world: AntMaze,
    layout: Layout,
    settings: Settings,
    /// In the maze, the path walked on.
    route: Option<Route>,
    in_maze: bool,
    direction: [f32; 2],
    observation: Observation,
    rng: Pcg64Mcg,
}

impl Stroll {
    pub(super) fn new(layout: &Layout, settings: &Settings, in_maze: bool) -> Self {
        let physics = if in_maze {
            Physics::MAZE
        } else {
            Physics::OPEN_FLOOR
        };
        let world = AntMaze::new(layout, physics);
        Self {
            observation: world.observation(),
            world,
            layout: layout.clone(),
            settings: settings.clone(),
            route: None,
            in_maze,
            direction: [1.0, 0.0],
            rng: Pcg64Mcg::seed_from_u64(0),
        }
    }

    fn turn(&mut self) {
        let angle = self.rng.random_range(0.0..std::f32::consts::TAU);
        self.direction = [angle.cos(), angle.sin()];
    }

    fn take_route(&mut self) {
        let task = random_task(&self.layout, Style::Diverse, &mut self.rng);
        self.route = Some(Route::new(&self.layout, task.goal, task.goal_cell));
    }

    /// Follows the route, or turns now and then.
    fn head(&mut self) {
        let place = [self.observation[0], self.observation[1]];
        let arrived = |route: &Route| {
            let [x, y] = route.goal();
            (x - place[0]).hypot(y - place[1]) < ARRIVED
        };
        if self.route.as_ref().is_some_and(arrived) {
            self.take_route();
        } else if self.route.is_none() && self.rng.random::<f32>() * self.settings.turn_every < 1.0
        {
            self.turn();
        }
        if let Some(route) = &self.route {
            let [x, y] = route.direction(&self.layout, place);
            let length = x.hypot(y).max(1e-6);
            self.direction = [x / length, y / length];
        }
    }

    fn reward(&self, before: &Observation, action: &[f32; ACTION], stumbled: bool) -> f32 {
        let s = &self.settings;
        let o = &self.observation;
        let ahead = (o[0] - before[0]) * self.direction[0] + (o[1] - before[1]) * self.direction[1];
        let speed = ahead / CONTROL_SECONDS;
        let squares = action.iter().map(|a| a.clamp(-1.0, 1.0).powi(2));
        let effort = squares.sum::<f32>() / ACTION as f32;
        speed.min(s.top_speed)
            - EFFORT_COST * effort
            - s.tilt_cost * (1.0 - upright(o))
            - if stumbled { s.fall_cost } else { 0.0 }
    }
}

impl Simulator for Stroll {
    fn body(&self) -> &'static dyn Body {
        &AntBody
    }

    fn draw(&self, _: Tasks, rng: &mut dyn Rng) -> Task {
        let task = random_task(&self.layout, Style::Diverse, rng);
        Task {
            start: task.start,
            goal: vec![1.0, 0.0],
        }
    }

    fn reset(&mut self, task: &Task, rng: &mut dyn Rng) {
        self.rng = Pcg64Mcg::seed_from_u64(rng.next_u64());
        self.world.reset(task.start, rng);
        // Any heading, so that no direction of the world is special.
        let mut turned = self.world.observation();
        let half = self.rng.random_range(-1.0..1.0_f32) * std::f32::consts::FRAC_PI_2;
        turned[3..7].copy_from_slice(&[half.cos(), 0.0, 0.0, half.sin()]);
        self.world.set(&turned);
        self.observation = self.world.observation();
        self.route = None;
        if self.in_maze {
            self.take_route();
        }
        self.turn();
        self.head();
    }

    fn step(&mut self, action: &[f32]) -> Step {
        let mut torques = [0.0; ACTION];
        for (torque, value) in torques.iter_mut().zip(action) {
            *torque = *value;
        }
        let before = self.observation;
        self.world.step(&torques);
        self.observation = self.world.observation();
        let stumbled = upright(&self.observation) < TIPPED_OVER;
        let reward = self.reward(&before, &torques, stumbled);
        self.head();
        Step {
            reward,
            success: false,
            terminated: stumbled,
            fell: stumbled,
        }
    }

    fn observation(&self) -> Values<'_> {
        Values::F32(&self.observation)
    }

    fn goal(&self) -> &[f32] {
        &self.direction
    }

    fn goal_of(&self, _: Values<'_>, goal: &mut Vec<f32>) {
        goal.extend(self.direction);
    }

    fn state(&self) -> Option<Vec<u8>> {
        None
    }

    fn restore(&mut self, _: &[u8]) -> Result<(), StateError> {
        Err(StateError)
    }

    fn poses(&self, poses: &mut Vec<[f32; 7]>) {
        poses.extend(self.world.body_poses());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        let config = crate::CONFIGS
            .parse("[run]\nalgorithm = \"walker\"\n", "x.toml", "x", &[])
            .unwrap();
        config.settings.get::<Settings>().unwrap().clone()
    }

    #[test]
    fn directions_are_unit_vectors_that_change_on_the_open_floor_and_in_the_maze() {
        let layout = Layout::named("umaze").unwrap();
        for in_maze in [false, true] {
            let mut stroll = Stroll::new(&layout, &settings(), in_maze);
            let mut rng = Pcg64Mcg::seed_from_u64(3);
            let mut directions = vec![];
            for _ in 0..4 {
                let task = stroll.draw(Tasks::Training, &mut rng);
                stroll.reset(&task, &mut rng);
                for _ in 0..60 {
                    let step = stroll.step(&[0.1; ACTION]);
                    assert!(step.reward.is_finite() && step.terminated == step.fell);
                    directions.push([stroll.goal()[0], stroll.goal()[1]]);
                }
            }
            let unit = |[x, y]: &[f32; 2]| (x.hypot(*y) - 1.0).abs() < 1e-5;
            assert!(directions.iter().all(unit));
            assert!(directions.iter().any(|other| *other != directions[0]));
        }
    }

    #[test]
    fn walking_in_the_direction_earns_what_walking_against_it_costs() {
        let layout = Layout::named("umaze").unwrap();
        let mut stroll = Stroll::new(&layout, &settings(), false);
        let before = stroll.observation;
        stroll.direction = [1.0, 0.0];
        stroll.observation[0] += 0.1;
        let with = stroll.reward(&before, &[0.0; ACTION], false);
        stroll.direction = [-1.0, 0.0];
        let against = stroll.reward(&before, &[0.0; ACTION], false);
        assert!(
            (with + against).abs() < 0.1 && with > 0.9,
            "{with} {against}"
        );
    }
}
