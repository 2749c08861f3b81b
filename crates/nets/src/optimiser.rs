//! Adam, gradient clipping, slow targets.

use serde::{Deserialize, Serialize};

use crate::kernel;

/// Adam (Kingma and Ba 2015), without decay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    /// Step size.
    pub learning_rate: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the root of the second moment.
    pub epsilon: f32,
    /// Steps taken.
    pub updates: u32,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Adam {
    /// For `parameters` values.
    #[must_use]
    pub fn new(parameters: usize, learning_rate: f32) -> Self {
        Self {
            learning_rate,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            updates: 0,
            first: vec![0.0; parameters],
            second: vec![0.0; parameters],
        }
    }

    /// One step along a gradient.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32]) {
        self.updates += 1;
        let t = self.updates.min(100_000) as i32;
        let rates = [
            self.learning_rate / (1.0 - self.beta1.powi(t)),
            1.0 / (1.0 - self.beta2.powi(t)).sqrt(),
            self.beta1,
            self.beta2,
            self.epsilon,
        ];
        kernel::adam(
            parameters,
            gradient,
            &mut self.first,
            &mut self.second,
            rates,
        );
    }

    /// Whether it is one for so many parameters, and whole.
    #[must_use]
    pub fn fits(&self, parameters: usize) -> bool {
        let moments = [&self.first, &self.second];
        moments
            .iter()
            .all(|moment| moment.len() == parameters && moment.iter().all(|m| m.is_finite()))
    }

    /// Replaces both moments, where parameters were moved about.
    pub fn map_moments(&mut self, map: impl Fn(&[f32]) -> Vec<f32>) {
        self.first = map(&self.first);
        self.second = map(&self.second);
    }
}

/// Scales a gradient to a norm of at most `max`; returns the norm before.
pub fn clip_global_norm(gradient: &mut [f32], max: f32) -> f32 {
    let norm = gradient
        .iter()
        .map(|g| f64::from(*g) * f64::from(*g))
        .sum::<f64>()
        .sqrt() as f32;
    if norm > max {
        let scale = max / norm;
        gradient.iter_mut().for_each(|g| *g *= scale);
    }
    norm
}

/// Moves slow targets a share `rate` of the way.
pub fn polyak(target: &mut [f32], source: &[f32], rate: f32) {
    for (target, source) in target.iter_mut().zip(source) {
        *target += rate * (source - *target);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_of_adam_by_hand() {
        let mut adam = Adam::new(1, 0.1);
        let mut p = [1.0];
        adam.step(&mut p, &[0.5]);
        // The first step is the learning rate, whatever the gradient.
        assert!((p[0] - 0.9).abs() < 1e-6);
        adam.step(&mut p, &[-0.25]);
        let m: f32 = (0.9 * 0.05 - 0.1 * 0.25) / (1.0 - 0.81);
        let v: f32 = (0.999 * 0.00025 + 0.001 * 0.0625) / (1.0 - 0.998_001);
        assert!((p[0] - (0.9 - 0.1 * m / v.sqrt())).abs() < 1e-5, "{}", p[0]);
    }

    #[test]
    fn clipping_keeps_the_direction() {
        let mut g = [3.0, 4.0];
        assert_eq!(clip_global_norm(&mut g, 1.0), 5.0);
        assert!((g[0] - 0.6).abs() < 1e-6 && (g[1] - 0.8).abs() < 1e-6);
        assert_eq!(clip_global_norm(&mut [0.3], 1.0), 0.3);
    }
}
