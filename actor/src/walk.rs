//! Rollouts for the walker's training: many ants, each towards a direction that changes.

use std::time::{Duration, Instant};

use agents::walker::{Policy, sample};
use config::Config;
use maze::{
    ACTION, AntMaze, EGOCENTRIC, Egocentric, Layout, Observation, Physics, Route, Style,
    TIPPED_OVER, random_task, upright,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use wire::{
    Bus, Claim, DirectiveSubscriber, Drained, Module, Phase, Reporter, Role, State, Status,
    TrajectoryHeader, TrajectorySender, Transition, WeightsSubscriber, flags,
};

use crate::PULSE;

/// Cost of the mean squared action.
const EFFORT_COST: f32 = 0.02;
/// Control steps of an episode at most.
const EPISODE_STEPS: u32 = 1000;

/// One ant with its way and the record of its steps.
struct Walker {
    world: AntMaze,
    rng: Pcg64Mcg,
    /// In the maze, a shortest path to a random goal; else the floor is open.
    route: Option<Route>,
    in_maze: bool,
    direction: [f32; 2],
    episode: u64,
    step: u32,
    record: Vec<Transition>,
    frame: Egocentric,
    observation: Observation,
}

impl Walker {
    fn new(world: AntMaze, layout: &Layout, in_maze: bool, seed: u64, segment: usize) -> Self {
        let observation = world.observation();
        let mut walker = Self {
            world,
            rng: Pcg64Mcg::seed_from_u64(seed),
            route: None,
            in_maze,
            direction: [1.0, 0.0],
            episode: 0,
            step: 0,
            record: Vec::with_capacity(segment + 1),
            frame: Egocentric::new(&observation, [1.0, 0.0]),
            observation,
        };
        walker.begin(layout);
        walker
    }

    fn begin(&mut self, layout: &Layout) {
        let task = random_task(layout, Style::Diverse, &mut self.rng);
        self.world.reset(task.start, &mut self.rng);
        // Any heading, so that no direction of the world is special.
        let mut turned = self.world.observation();
        let half = self.rng.random_range(-1.0..1.0_f32) * std::f32::consts::FRAC_PI_2;
        turned[3..7].copy_from_slice(&[half.cos(), 0.0, 0.0, half.sin()]);
        self.world.set(&turned);
        self.route = self
            .in_maze
            .then(|| Route::new(layout, task.goal, task.goal_cell));
        self.turn();
        self.step = 0;
        self.episode += 1;
        self.observe(layout);
    }

    fn turn(&mut self) {
        let angle = self.rng.random_range(0.0..std::f32::consts::TAU);
        self.direction = [angle.cos(), angle.sin()];
    }

    /// Sees where it is and where to go.
    fn observe(&mut self, layout: &Layout) {
        self.observation = self.world.observation();
        let place = [self.observation[0], self.observation[1]];
        if let Some(route) = &self.route {
            let [x, y] = route.direction(layout, place);
            let length = x.hypot(y).max(1e-6);
            self.direction = [x / length, y / length];
        }
        self.frame = Egocentric::new(&self.observation, self.direction);
    }

    /// Takes one step; whether the record must be sent.
    fn act(&mut self, egocentric: &[f32], log_prob: f32, layout: &Layout, w: &Settings) -> bool {
        let action = self.frame.to_actuators(egocentric);
        let before = self.observation;
        self.world.step(&action);
        self.step += 1;
        let after = self.world.observation();
        let ahead =
            (after[0] - before[0]) * self.direction[0] + (after[1] - before[1]) * self.direction[1];
        let speed = ahead / maze::CONTROL_SECONDS;
        let effort = action
            .iter()
            .map(|a| a.clamp(-1.0, 1.0).powi(2))
            .sum::<f32>()
            / 8.0;
        let up = upright(&after);
        let fell = up < TIPPED_OVER;
        let reward = speed.min(w.top_speed)
            - EFFORT_COST * effort
            - w.tilt_cost * (1.0 - up)
            - if fell { w.fall_cost } else { 0.0 };
        let cut = self.step >= EPISODE_STEPS;
        let mut bits = if fell {
            flags::TERMINAL | flags::FELL
        } else {
            0
        };
        if cut && !fell {
            bits |= flags::TRUNCATED;
        }
        self.record.push(Transition {
            observation: before,
            action,
            goal: self.direction,
            reward,
            log_prob,
            flags: bits,
            ..Transition::default()
        });
        let place = [after[0], after[1]];
        let arrived = |route: &Route| {
            let [x, y] = route.goal();
            (x - place[0]).hypot(y - place[1]) < 1.0
        };
        if self.route.as_ref().is_some_and(arrived) {
            let task = random_task(layout, Style::Diverse, &mut self.rng);
            self.route = Some(Route::new(layout, task.goal, task.goal_cell));
        } else if self.route.is_none() && self.rng.random::<f32>() * w.turn_every < 1.0 {
            self.turn();
        }
        self.observe(layout);
        let ended = fell || cut;
        if ended || self.record.len() >= w.segment {
            self.record.push(Transition {
                observation: self.observation,
                goal: self.direction,
                flags: flags::FINAL,
                ..Transition::default()
            });
            if ended {
                self.begin(layout);
            }
            return true;
        }
        false
    }
}

struct Settings {
    top_speed: f32,
    fall_cost: f32,
    tilt_cost: f32,
    turn_every: f32,
    segment: usize,
}

pub(crate) fn run(
    config: &Config,
    layout: &Layout,
    bus: &Bus,
    claim: Claim,
    stopped: &dyn Fn() -> bool,
) -> anyhow::Result<Drained> {
    let id = claim.actor;
    let w = &config.walker;
    let settings = Settings {
        top_speed: w.top_speed as f32,
        fall_cost: w.fall_cost as f32,
        tilt_cost: w.tilt_cost as f32,
        turn_every: w.turn_every as f32,
        segment: w.segment,
    };
    let reporter = Reporter::new(bus)?;
    let mut directives = DirectiveSubscriber::new(bus)?;
    let mut status = Status {
        role: Role::Actor as u32,
        id,
        ..Status::default()
    };
    reporter.status(&status);
    let sender = TrajectorySender::connect(bus, claim, Duration::from_secs(60), stopped)?;
    let Some(mut sender) = sender else {
        return Ok(Drained::NOTHING);
    };
    let mut subscriber = WeightsSubscriber::new(bus, Module::Walker)?;

    let policy = Policy::new(&w.hidden);
    let count = w.environments;
    let mut workspace = policy.mlp().workspace(count);
    let in_maze = (w.maze_share * count as f64).round() as usize;
    let seed = config.run.seed.wrapping_mul(1_000_003) + u64::from(id) * 4096;
    let floor = AntMaze::new(layout, Physics::OPEN_FLOOR);
    let maze = AntMaze::new(layout, Physics::MAZE);
    let mut walkers: Vec<Walker> = (0..count)
        .map(|i| {
            let walled = i < in_maze;
            let world = if walled { &maze } else { &floor }.clone();
            Walker::new(world, layout, walled, seed + i as u64, w.segment)
        })
        .collect();
    let mut rng = Pcg64Mcg::seed_from_u64(seed + 4095);
    let mut features = Vec::with_capacity(count * EGOCENTRIC);
    let mut weights = None;
    let mut pulse = Instant::now();
    status.state = State::Waiting as u32;
    while !stopped() && directives.latest().phase() == Phase::Train {
        if let Some(newer) = subscriber.latest()
            && newer.values.len() == policy.weights()
        {
            status.versions[0] = newer.version;
            weights = Some(newer);
        }
        if pulse.elapsed() > PULSE {
            // The first ants are those in the maze.
            if let Some(walker) = walkers.first().filter(|walker| walker.in_maze) {
                status.place = [walker.observation[0], walker.observation[1]];
            }
            status.sent = sender.transitions();
            status.acknowledged = sender.acknowledged();
            status.refused = sender.refused() + subscriber.refused() + directives.refused();
            reporter.status(&status);
            pulse = Instant::now();
        }
        let Some(current) = &weights else {
            sender.wait(Duration::from_millis(100));
            continue;
        };
        status.state = State::Working as u32;
        features.clear();
        for walker in &walkers {
            features.extend_from_slice(&walker.frame.features);
        }
        let means = policy.mean(&current.values, &features, count, &mut workspace);
        let log_std = policy.log_std(&current.values);
        for (i, walker) in walkers.iter_mut().enumerate() {
            let mut action = [0.0; ACTION];
            let mean = &means[i * ACTION..(i + 1) * ACTION];
            let log_prob = sample(mean, log_std, &mut rng, &mut action);
            if !walker.act(&action, log_prob, layout, &settings) {
                continue;
            }
            while !sender.wait_credit(Duration::from_millis(200)) {
                if stopped() || directives.latest().phase() != Phase::Train {
                    break;
                }
                reporter.status(&status);
            }
            if sender.credit() {
                let header = TrajectoryHeader {
                    episode: walker.episode,
                    environment: i as u32,
                    weights_version: current.version,
                    ..TrajectoryHeader::default()
                };
                let record = &walker.record;
                sender.send_with(header, record.len(), |step| record[step])?;
            }
            walker.record.clear();
        }
        status.steps += count as u64;
    }
    let drained = sender.drain(Duration::from_secs(3));
    status.sent = drained.transitions;
    status.acknowledged = sender.acknowledged();
    if drained.acknowledged {
        status.state = State::Finished as u32;
    }
    reporter.status(&status);
    if !stopped() {
        anyhow::ensure!(
            drained.acknowledged,
            "the learner did not acknowledge all trajectories"
        );
    }
    Ok(drained)
}
