//! `[walker]`

use config::Table;

use crate::ppo;

/// `[walker]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Ants of each actor.
    pub environments: usize,
    /// Steps of a trajectory.
    pub segment: usize,
    /// Transitions of an update.
    pub batch: usize,
    /// PPO's own: `epochs`, `minibatch`, `clip`, `entropy`, `discount`, `gae_lambda`, and `target_kl`,
    /// beyond which epochs end early.
    pub ppo: ppo::Settings,
    /// Step size, falling to a tenth over the steps.
    pub learning_rate: f32,
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Log standard deviation of actions at the start.
    pub initial_log_std: f32,
    /// Control steps in all.
    pub steps: usize,
    /// Mean control steps between changes of direction.
    pub turn_every: f32,
    /// Share of ants that walk shortest paths in the maze instead of the open floor.
    pub maze_share: f64,
    /// Walking faster than this earns no more (m/s).
    pub top_speed: f32,
    /// What a fall costs.
    pub fall_cost: f32,
    /// What a step costs on the side (a tilt of 90 degrees); upright it is free.
    pub tilt_cost: f32,
    /// Weights to start from; fresh ones without.
    pub start: Option<String>,
    /// File that the trained walker is written to; empty for the run's folder alone.
    pub output: String,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        let environments = t.count("environments", 32, [1, 1024]);
        let segment = t.count("segment", 64, [2, 4096]);
        let batch = t.count("batch", 16_384, [64, 10_000_000]);
        let epochs = t.count("epochs", 5, [1, 100]);
        let minibatch = t.count("minibatch", 2048, [16, 1_000_000]);
        let learning_rate = t.number("learning_rate", 3e-4, [0.0, 1.0]) as f32;
        let mut ppo = ppo::Settings {
            epochs,
            minibatch,
            clip: t.number("clip", 0.2, [0.01, 1.0]) as f32,
            entropy: t.number("entropy", 0.0, [0.0, 10.0]) as f32,
            value_loss: 0.5,
            max_gradient_norm: 0.5,
            discount: t.number("discount", 0.97, [0.0, 0.9999]) as f32,
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]) as f32,
            target_kl: None,
        };
        let hidden = t.layers("hidden", &[128, 128]);
        let initial_log_std = t.number("initial_log_std", -0.5, [-2.5, 0.5]) as f32;
        ppo.target_kl = Some(t.number("target_kl", 0.02, [0.0001, 10.0]) as f32);
        if minibatch > batch {
            t.fault(
                "minibatch",
                format!("{minibatch} is more than the batch of {batch}"),
            );
        }
        Self {
            environments,
            segment,
            batch,
            ppo,
            learning_rate,
            hidden,
            initial_log_std,
            steps: t.count("steps", 10_000_000, [1, 10_000_000_000]),
            turn_every: t.number("turn_every", 60.0, [1.0, 100_000.0]) as f32,
            maze_share: t.number("maze_share", 0.5, [0.0, 1.0]),
            top_speed: t.number("top_speed", 2.0, [0.1, 10.0]) as f32,
            fall_cost: t.number("fall_cost", 3.0, [0.0, 1000.0]) as f32,
            tilt_cost: t.number("tilt_cost", 0.3, [0.0, 100.0]) as f32,
            start: t.file("start"),
            output: t.output("output", "the walker"),
        }
    }
}
