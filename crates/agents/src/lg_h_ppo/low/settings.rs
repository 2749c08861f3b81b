//! `[low]`

use config::Table;

/// What walks to a subgoal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// The learned low level.
    Learned,
    /// The walker that made the data: the oracle of stage 3a.
    Walker,
}

/// `[low]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hidden layers of policy and values.
    pub hidden: Vec<usize>,
    /// Step size of Adam, falling to a tenth over the updates.
    pub learning_rate: f32,
    /// Transitions of a gradient step.
    pub batch: usize,
    /// Gradient steps.
    pub updates: usize,
    /// Expectile of the value regression (tau).
    pub expectile: f32,
    /// Discount a step.
    pub discount: f32,
    /// 1 / temperature of the advantage weights.
    pub inverse_temperature: f32,
    /// Largest advantage weight.
    pub weight_clip: f32,
    /// Rate of the slow targets.
    pub target_rate: f32,
    /// Share of subgoals that are snapped to their node's centroid.
    pub snap: f64,
    /// Subgoals lie up to the graph's lag plus this many steps ahead.
    pub slack: usize,
    /// `learned` or `walker`.
    pub controller: Controller,
    /// Weights of another run's checkpoint, instead of training.
    pub from: Option<String>,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        Self {
            hidden: t.layers("hidden", &[256, 256]),
            learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]) as f32,
            batch: t.count("batch", 256, [1, 65_536]),
            updates: t.count("updates", 10_000, [1, 100_000_000]),
            expectile: t.number("expectile", 0.7, [0.5, 0.999]) as f32,
            discount: t.number("discount", 0.98, [0.0, 0.9999]) as f32,
            inverse_temperature: t.number("inverse_temperature", 3.0, [0.0, 100.0]) as f32,
            weight_clip: t.number("weight_clip", 100.0, [1.0, 1e6]) as f32,
            target_rate: t.number("target_rate", 0.005, [0.0, 1.0]) as f32,
            snap: t.number("snap", 0.5, [0.0, 1.0]),
            slack: t.count("slack", 5, [0, 1000]),
            controller: match t
                .word("controller", "learned", &["learned", "walker"])
                .as_str()
            {
                "walker" => Controller::Walker,
                _ => Controller::Learned,
            },
            from: t.file("from"),
        }
    }
}
