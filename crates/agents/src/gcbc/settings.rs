//! Settings of the algorithm.

use config::Table;

/// `[gcbc]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Step size of Adam.
    pub learning_rate: f32,
    /// Transitions of a gradient step.
    pub batch: usize,
    /// Gradient steps.
    pub updates: usize,
    /// Goals lie `n` steps ahead with a probability in proportion to `discount` to the `n`.
    pub discount: f32,
}

impl Settings {
    pub(super) fn read(t: &mut Table<'_, '_>) -> Self {
        Self {
            hidden: t.layers("hidden", &[256, 256]),
            learning_rate: t.number("learning_rate", 3e-4, [0.0, 1.0]) as f32,
            batch: t.count("batch", 256, [1, 65_536]),
            updates: t.count("updates", 20_000, [1, 100_000_000]),
            discount: t.number("discount", 0.99, [0.0, 0.9999]) as f32,
        }
    }
}
