//! Proximal policy optimisation: generalised advantages, clipped surrogate, epochs.
//!
//! Schulman et al., "Proximal policy optimization algorithms" (2017), with the defaults of
//! vwxyzjn/cleanrl (`ppo_continuous_action.py`).

use rand::Rng;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

/// Settings of an update.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Passes over the batch.
    pub epochs: usize,
    /// Transitions of a gradient step.
    pub minibatch: usize,
    /// Ratios beyond 1 +- clip earn nothing more.
    pub clip: f32,
    /// Weight of the entropy bonus.
    pub entropy: f32,
    /// Weight of the value loss.
    pub value_loss: f32,
    /// Largest norm of a gradient.
    pub max_gradient_norm: f32,
    /// Discount a step.
    pub discount: f32,
    /// Lambda of the generalised advantage estimate.
    pub gae_lambda: f32,
    /// The epochs end early beyond this divergence from the behaviour policy.
    pub target_kl: Option<f32>,
}

/// Means over an update.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Report {
    /// Clipped surrogate loss.
    pub policy_loss: f32,
    /// Mean squared error of the value.
    pub value_loss: f32,
    /// Entropy of the policy (nats).
    pub entropy: f32,
    /// Estimated divergence from the behaviour policy (nats).
    pub kl: f32,
    /// Share of ratios that were clipped.
    pub clip_fraction: f32,
    /// Gradient steps taken.
    pub minibatches: usize,
}

impl Report {
    fn add(&mut self, other: &Self) {
        self.policy_loss += other.policy_loss;
        self.value_loss += other.value_loss;
        self.entropy += other.entropy;
        self.kl += other.kl;
        self.clip_fraction += other.clip_fraction;
        self.minibatches += 1;
    }

    fn mean(mut self) -> Self {
        let scale = 1.0 / self.minibatches.max(1) as f32;
        for value in [
            &mut self.policy_loss,
            &mut self.value_loss,
            &mut self.entropy,
            &mut self.kl,
            &mut self.clip_fraction,
        ] {
            *value *= scale;
        }
        self
    }
}

/// What happened at the end of one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// The episode goes on.
    Not,
    /// It ended for good: nothing follows.
    Terminal,
    /// The record ends here, the episode does not: the next state's value stands for the rest.
    Truncated,
}

/// Generalised advantage estimates of one sequence of steps.
///
/// `next_values[t]` is the value of the state after step `t`, read where the step does not end
/// the episode; `discount` is that of a step. Advantages are written to `advantages`; returns are `advantages + values`.
pub fn advantages(
    rewards: &[f32],
    values: &[f32],
    next_values: &[f32],
    ends: &[End],
    discount: impl Fn(usize) -> f32,
    lambda: f32,
    advantages: &mut [f32],
) {
    let mut following = 0.0;
    for t in (0..rewards.len()).rev() {
        let next = if ends[t] == End::Terminal {
            0.0
        } else {
            discount(t) * next_values[t]
        };
        let delta = rewards[t] + next - values[t];
        if ends[t] != End::Not {
            following = 0.0;
        }
        following = delta + discount(t) * lambda * following;
        advantages[t] = following;
    }
}

/// Values and advantages of many short records that lie one after another, as [`estimate`] fills
/// them.
#[derive(Debug, Clone, Default)]
pub struct Estimate {
    /// Advantages, normalised, `[n]`.
    pub advantages: Vec<f32>,
    /// Targets of the value: advantages as estimated plus values, `[n]`.
    pub returns: Vec<f32>,
    next_values: Vec<f32>,
}

/// Advantages and returns of records of `lengths` steps; `final_values` are those of the states
/// that follow each record's last step. Steps that last longer than others are discounted by more:
/// `durations` are theirs in units of the discount, one each where there are none.
pub fn estimate(
    settings: &Settings,
    lengths: &[usize],
    (values, final_values): (&[f32], &[f32]),
    (rewards, ends, durations): (&[f32], &[End], Option<&[f32]>),
    out: &mut Estimate,
) {
    out.next_values.clear();
    out.advantages.resize(values.len(), 0.0);
    let mut start = 0;
    for (&steps, &last) in lengths.iter().zip(final_values) {
        let record = start..start + steps;
        start += steps;
        if steps == 0 {
            continue;
        }
        out.next_values
            .extend_from_slice(&values[record.start + 1..record.end]);
        out.next_values.push(last);
        advantages(
            &rewards[record.clone()],
            &values[record.clone()],
            &out.next_values[record.clone()],
            &ends[record.clone()],
            |t| {
                durations.map_or(settings.discount, |durations| {
                    settings.discount.powf(durations[record.start + t])
                })
            },
            settings.gae_lambda,
            &mut out.advantages[record.clone()],
        );
    }
    out.returns.clear();
    out.returns.extend(
        values
            .iter()
            .zip(&out.advantages)
            .map(|(value, gain)| value + gain),
    );
    normalise(&mut out.advantages);
}

/// Clipped surrogate loss of one action, and its gradient in the action's new log-probability.
/// The third value says whether the ratio was beyond the clip.
#[must_use]
pub fn surrogate(log_prob: f32, behaviour: f32, advantage: f32, clip: f32) -> (f32, f32, bool) {
    let ratio = (log_prob - behaviour).clamp(-20.0, 20.0).exp();
    let clipped = ratio.clamp(1.0 - clip, 1.0 + clip);
    let (free, bound) = (ratio * advantage, clipped * advantage);
    let gradient = if free <= bound { -free } else { 0.0 };
    (-free.min(bound), gradient, (ratio - 1.0).abs() > clip)
}

/// Shifts and scales to mean 0 and standard deviation 1.
pub fn normalise(advantages: &mut [f32]) {
    let n = advantages.len().max(1) as f32;
    let mean = advantages.iter().sum::<f32>() / n;
    let variance = advantages.iter().map(|a| (a - mean).powi(2)).sum::<f32>() / n;
    let scale = 1.0 / (variance.sqrt() + 1e-8);
    advantages.iter_mut().for_each(|a| *a = (*a - mean) * scale);
}

/// Runs the epochs: shuffles the batch's indices and hands each minibatch to `step`.
pub fn epochs(
    settings: &Settings,
    batch: usize,
    rng: &mut impl Rng,
    mut step: impl FnMut(&[usize]) -> Report,
) -> Report {
    let mut order: Vec<usize> = (0..batch).collect();
    let mut total = Report::default();
    'epochs: for _ in 0..settings.epochs {
        order.shuffle(rng);
        for minibatch in order.chunks(settings.minibatch.max(1)) {
            // A short rest would weigh its few transitions too much.
            if minibatch.len() * 2 < settings.minibatch && batch > settings.minibatch {
                continue;
            }
            let report = step(minibatch);
            total.add(&report);
            if settings
                .target_kl
                .is_some_and(|limit| report.kl > 1.5 * limit)
            {
                break 'epochs;
            }
        }
    }
    total.mean()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advantages_with_lambda_one_are_returns_less_values() {
        let (rewards, values) = ([1.0, 2.0, 3.0], [0.5, 0.25, 0.125]);
        let next = [0.25, 0.125, 9.0];
        let mut out = [0.0; 3];
        let ends = [End::Not, End::Not, End::Terminal];
        advantages(&rewards, &values, &next, &ends, |_| 0.9, 1.0, &mut out);
        let returns = [1.0 + 0.9 * (2.0 + 0.9 * 3.0), 2.0 + 0.9 * 3.0, 3.0];
        for t in 0..3 {
            assert!((out[t] - (returns[t] - values[t])).abs() < 1e-6);
        }
        let ends = [End::Not, End::Not, End::Truncated];
        advantages(&rewards, &values, &next, &ends, |_| 0.9, 1.0, &mut out);
        assert!((out[2] - (3.0 + 0.9 * 9.0 - 0.125)).abs() < 1e-6);
    }

    #[test]
    fn an_end_inside_a_sequence_cuts_the_estimate() {
        let mut out = [0.0; 2];
        let ends = [End::Terminal, End::Terminal];
        advantages(
            &[0.0, 100.0],
            &[0.0; 2],
            &[0.0; 2],
            &ends,
            |_| 0.9,
            0.9,
            &mut out,
        );
        assert_eq!(out[0], 0.0);
    }

    #[test]
    fn a_step_of_twice_the_time_is_discounted_twice() {
        let settings = Settings {
            epochs: 1,
            minibatch: 1,
            clip: 0.2,
            entropy: 0.0,
            value_loss: 0.5,
            max_gradient_norm: 1.0,
            discount: 0.9,
            gae_lambda: 1.0,
            target_kl: None,
        };
        let mut out = Estimate::default();
        let (rewards, ends) = ([0.0, 1.0], [End::Not, End::Terminal]);
        let durations = Some([2.0, 1.0].as_slice());
        let values = ([0.0; 2].as_slice(), [0.0].as_slice());
        estimate(
            &settings,
            &[2],
            values,
            (&rewards, &ends, durations),
            &mut out,
        );
        assert!((out.returns[0] - 0.81).abs() < 1e-6, "{:?}", out.returns);
        estimate(&settings, &[2], values, (&rewards, &ends, None), &mut out);
        assert!((out.returns[0] - 0.9).abs() < 1e-6);
    }

    #[test]
    fn surrogate_gradient_is_its_finite_difference() {
        for advantage in [-1.5, 0.7] {
            for log_prob in [-0.5, -0.1, 0.0, 0.1, 0.5] {
                let loss = |x| surrogate(x, 0.0, advantage, 0.2).0;
                let numeric = (loss(log_prob + 1e-3) - loss(log_prob - 1e-3)) / 2e-3;
                let (_, gradient, _) = surrogate(log_prob, 0.0, advantage, 0.2);
                assert!((numeric - gradient).abs() < 1e-2, "{advantage} {log_prob}");
            }
        }
    }
}
