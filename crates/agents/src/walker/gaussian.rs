//! The walker's distribution.

use crate::actor_critic;

/// ln(2 pi)
pub(super) const LOG_TAU: f32 = 1.837_877;

/// A diagonal Gaussian around the network's outputs; its log standard deviations are free
/// parameters.
pub(crate) struct Gaussian<'a> {
    actions: &'a [f32],
}

impl<'a> Gaussian<'a> {
    /// Of actions `[n, outputs]`.
    pub(crate) fn new(actions: &'a [f32]) -> Self {
        Self { actions }
    }
}

impl actor_critic::Distribution for Gaussian<'_> {
    fn grade(
        &mut self,
        i: usize,
        mean: &[f32],
        log_std: &[f32],
        weigh: impl FnOnce(f32, f32) -> [f32; 2],
        mean_gradient: &mut [f32],
        log_std_gradient: &mut [f32],
    ) -> bool {
        let width = mean.len();
        let action = &self.actions[i * width..(i + 1) * width];
        let (mut log_prob, mut entropy) = (0.0, 0.0);
        for k in 0..width {
            let noise = (action[k] - mean[k]) * (-log_std[k]).exp();
            log_prob -= 0.5 * noise * noise + log_std[k] + 0.5 * LOG_TAU;
            entropy += log_std[k] + 0.5 * (LOG_TAU + 1.0);
        }
        let [log_weight, entropy_weight] = weigh(log_prob, entropy);
        for k in 0..width {
            let std = log_std[k].exp();
            let noise = (action[k] - mean[k]) / std;
            mean_gradient[k] += log_weight * noise / std;
            log_std_gradient[k] += log_weight * (noise * noise - 1.0) + entropy_weight;
        }
        true
    }
}
