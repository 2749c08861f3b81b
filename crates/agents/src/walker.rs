//! The walker: a policy of the observation alone that walks the ant towards a direction, trained
//! by PPO online. It makes the offline data, in the place of D4RL's goal-reaching policy.

use maze::{ACTION, EGOCENTRIC};
use nets::{Activation, Adam, Mlp, Workspace, clip_global_norm};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::ppo::{self, End, Report, Settings};
use crate::same_shape;

const LOG_TAU: f32 = 1.837_877; // ln(2 pi)

/// Shape of the walker's policy: features to mean action, and a free log standard deviation.
#[derive(Debug, Clone)]
pub struct Policy {
    mlp: Mlp,
}

impl Policy {
    /// A policy with these hidden layers.
    #[must_use]
    pub fn new(hidden: &[usize]) -> Self {
        let sizes = [&[EGOCENTRIC], hidden, &[ACTION]].concat();
        Self {
            mlp: Mlp::new(&sizes, Activation::Tanh, false),
        }
    }

    /// The network.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Length of the flat weights: the network's, then 8 log standard deviations.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.mlp.parameters() + ACTION
    }

    /// Fresh weights.
    pub fn init(&self, log_std: f32, rng: &mut impl Rng) -> Vec<f32> {
        let mut weights = self.mlp.init(rng, 0.01);
        weights.extend([log_std; ACTION]);
        weights
    }

    /// Mean actions `[batch, 8]` of features `[batch, 28]`, in each feature's own frame.
    pub fn mean<'w>(
        &self,
        weights: &[f32],
        features: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        self.mlp.infer(
            &weights[..self.mlp.parameters()],
            features,
            batch,
            workspace,
        )
    }

    /// The log standard deviations within flat weights.
    #[must_use]
    pub fn log_std<'w>(&self, weights: &'w [f32]) -> &'w [f32] {
        &weights[self.mlp.parameters()..]
    }
}

/// Samples an action around `mean` and returns its log-probability.
pub fn sample(mean: &[f32], log_std: &[f32], rng: &mut impl Rng, action: &mut [f32]) -> f32 {
    let mut log_prob = 0.0;
    for ((action, mean), log_std) in action.iter_mut().zip(mean).zip(log_std) {
        let noise: f32 = StandardNormal.sample(rng);
        *action = mean + log_std.exp() * noise;
        log_prob -= 0.5 * noise * noise + log_std + 0.5 * LOG_TAU;
    }
    log_prob
}

/// On-policy steps of many short records, flat.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    /// `[n, 28]`.
    pub features: Vec<f32>,
    /// Actions as sampled, in each feature's own frame, `[n, 8]`.
    pub actions: Vec<f32>,
    /// Their log-probabilities under the behaviour policy, `[n]`.
    pub log_probs: Vec<f32>,
    /// `[n]`.
    pub rewards: Vec<f32>,
    /// `[n]`.
    pub ends: Vec<End>,
    /// Features after the last step of each record, `[records, 28]`.
    pub final_features: Vec<f32>,
    /// Steps of each record.
    pub records: Vec<usize>,
}

impl Batch {
    /// Steps held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Whether no step is held.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Forgets all steps and keeps the memory.
    pub fn clear(&mut self) {
        self.features.clear();
        self.actions.clear();
        self.log_probs.clear();
        self.rewards.clear();
        self.ends.clear();
        self.final_features.clear();
        self.records.clear();
    }
}

/// All that an update changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    weights: Vec<f32>,
    value_parameters: Vec<f32>,
    policy_adam: Adam,
    value_adam: Adam,
}

/// Actor, critic and their optimisers.
pub struct Learner {
    policy: Policy,
    value: Mlp,
    settings: Settings,
    /// The policy's flat weights, as actors use them.
    pub weights: Vec<f32>,
    /// The critic's parameters.
    pub value_parameters: Vec<f32>,
    policy_adam: Adam,
    value_adam: Adam,
    policy_workspace: Workspace,
    value_workspace: Workspace,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    values: Vec<f32>,
    final_values: Vec<f32>,
    estimate: ppo::Estimate,
    features: Vec<f32>,
    policy_gradient: Vec<f32>,
    value_gradient: Vec<f32>,
    mean_gradient: Vec<f32>,
    error: Vec<f32>,
}

impl Learner {
    /// A learner with fresh networks.
    pub fn new(
        hidden: &[usize],
        log_std: f32,
        learning_rate: f32,
        settings: Settings,
        rng: &mut impl Rng,
    ) -> Self {
        let policy = Policy::new(hidden);
        let sizes = [&[EGOCENTRIC], hidden, &[1]].concat();
        let value = Mlp::new(&sizes, Activation::Tanh, false);
        let weights = policy.init(log_std, rng);
        let value_parameters = value.init(rng, 1.0);
        let scratch = Scratch {
            policy_gradient: vec![0.0; weights.len()],
            value_gradient: vec![0.0; value_parameters.len()],
            ..Scratch::default()
        };
        Self {
            policy_adam: Adam::new(weights.len(), learning_rate),
            value_adam: Adam::new(value_parameters.len(), learning_rate),
            policy_workspace: policy.mlp().workspace(settings.minibatch),
            value_workspace: value.workspace(settings.minibatch),
            policy,
            value,
            settings,
            weights,
            value_parameters,
            scratch,
        }
    }

    /// The policy's shape.
    #[must_use]
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Where the training is.
    #[must_use]
    pub fn state(&self) -> State {
        State {
            weights: self.weights.clone(),
            value_parameters: self.value_parameters.clone(),
            policy_adam: self.policy_adam.clone(),
            value_adam: self.value_adam.clone(),
        }
    }

    /// Goes on from a state; false, and nothing is changed, where it is of other networks.
    #[must_use]
    pub fn restore(&mut self, state: State) -> bool {
        let fits = same_shape(&[
            (&state.weights, &self.weights),
            (&state.value_parameters, &self.value_parameters),
        ]) && state.policy_adam.fits(self.weights.len())
            && state.value_adam.fits(self.value_parameters.len());
        if fits {
            State {
                weights: self.weights,
                value_parameters: self.value_parameters,
                policy_adam: self.policy_adam,
                value_adam: self.value_adam,
            } = state;
        }
        fits
    }

    /// Sets the step size of both networks.
    pub fn set_learning_rate(&mut self, rate: f32) {
        self.policy_adam.learning_rate = rate;
        self.value_adam.learning_rate = rate;
    }

    fn evaluate(&mut self, features: &[f32], out: &mut Vec<f32>) {
        out.clear();
        for chunk in features.chunks(self.settings.minibatch * EGOCENTRIC) {
            let rows = chunk.len() / EGOCENTRIC;
            let values = self.value.infer(
                &self.value_parameters,
                chunk,
                rows,
                &mut self.value_workspace,
            );
            out.extend_from_slice(&values[..rows]);
        }
    }

    /// One PPO update on a batch of on-policy steps.
    pub fn update(&mut self, batch: &Batch, rng: &mut impl Rng) -> Report {
        let mut scratch = std::mem::take(&mut self.scratch);
        self.estimate(batch, &mut scratch);
        let settings = self.settings.clone();
        let report = ppo::epochs(&settings, batch.len(), rng, |minibatch| {
            self.step(batch, minibatch, &mut scratch)
        });
        self.scratch = scratch;
        report
    }

    /// Values and advantages of the batch.
    fn estimate(&mut self, batch: &Batch, scratch: &mut Scratch) {
        self.evaluate(&batch.features, &mut scratch.values);
        self.evaluate(&batch.final_features, &mut scratch.final_values);
        ppo::estimate(
            &self.settings,
            &batch.records,
            (&scratch.values, &scratch.final_values),
            (&batch.rewards, &batch.ends, None),
            &mut scratch.estimate,
        );
    }

    fn step(&mut self, batch: &Batch, minibatch: &[usize], scratch: &mut Scratch) -> Report {
        let n = minibatch.len();
        let scale = 1.0 / n as f32;
        let network = self.policy.mlp().parameters();
        let Scratch {
            estimate,
            features,
            policy_gradient,
            value_gradient,
            mean_gradient,
            error,
            ..
        } = scratch;
        features.clear();
        for &i in minibatch {
            features.extend_from_slice(&batch.features[i * EGOCENTRIC..(i + 1) * EGOCENTRIC]);
        }
        policy_gradient.fill(0.0);
        value_gradient.fill(0.0);
        mean_gradient.resize(n * ACTION, 0.0);
        error.resize(n, 0.0);

        let (parameters, log_std) = self.weights.split_at(network);
        let means = self
            .policy
            .mlp()
            .forward(parameters, features, n, &mut self.policy_workspace);
        let mut report = Report::default();
        for (row, &i) in minibatch.iter().enumerate() {
            let mean = &means[row * ACTION..(row + 1) * ACTION];
            let action = &batch.actions[i * ACTION..(i + 1) * ACTION];
            let mut log_prob = 0.0;
            for k in 0..ACTION {
                let noise = (action[k] - mean[k]) * (-log_std[k]).exp();
                log_prob -= 0.5 * noise * noise + log_std[k] + 0.5 * LOG_TAU;
            }
            let behaviour = batch.log_probs[i];
            let (loss, gradient, clipped) = ppo::surrogate(
                log_prob,
                behaviour,
                estimate.advantages[i],
                self.settings.clip,
            );
            for k in 0..ACTION {
                let std = log_std[k].exp();
                let noise = (action[k] - mean[k]) / std;
                mean_gradient[row * ACTION + k] = scale * gradient * noise / std;
                policy_gradient[network + k] += scale * gradient * (noise * noise - 1.0);
            }
            let shift = log_prob - behaviour;
            report.policy_loss += scale * loss;
            // Schulman's low-variance estimate of the divergence.
            report.kl += scale * (shift.exp() - 1.0 - shift);
            report.clip_fraction += scale * f32::from(u8::from(clipped));
        }
        for k in 0..ACTION {
            report.entropy += log_std[k] + 0.5 * (LOG_TAU + 1.0);
            policy_gradient[network + k] -= self.settings.entropy;
        }
        let (net_gradient, _) = policy_gradient.split_at_mut(network);
        self.policy.mlp().backward(
            parameters,
            features,
            n,
            &mut self.policy_workspace,
            mean_gradient,
            net_gradient,
            None,
        );
        clip_global_norm(policy_gradient, self.settings.max_gradient_norm);
        self.policy_adam.step(&mut self.weights, policy_gradient);
        // Without bounds on the spread a batch can make it collapse or explode.
        for log_std in &mut self.weights[network..] {
            *log_std = log_std.clamp(-2.5, 0.5);
        }

        let value_parameters = &mut self.value_parameters;
        let values = self
            .value
            .forward(value_parameters, features, n, &mut self.value_workspace);
        for (row, &i) in minibatch.iter().enumerate() {
            let difference = values[row] - estimate.returns[i];
            report.value_loss += scale * difference * difference;
            error[row] = scale * self.settings.value_loss * 2.0 * difference;
        }
        self.value.backward(
            value_parameters,
            features,
            n,
            &mut self.value_workspace,
            error,
            value_gradient,
            None,
        );
        clip_global_norm(value_gradient, self.settings.max_gradient_norm);
        self.value_adam.step(value_parameters, value_gradient);
        report
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    fn settings() -> Settings {
        Settings {
            epochs: 4,
            minibatch: 256,
            clip: 0.2,
            entropy: 0.0,
            value_loss: 0.5,
            max_gradient_norm: 0.5,
            discount: 0.9,
            gae_lambda: 0.95,
            target_kl: None,
        }
    }

    /// One-step episodes whose reward is highest at a known action.
    #[test]
    fn learns_the_best_action_of_a_bandit() {
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut learner = Learner::new(&[32], -0.5, 3e-3, settings(), &mut rng);
        let best = |features: &[f32]| 0.5 * features[0].signum();
        let mut batch = Batch::default();
        let mut rewards = vec![];
        for _ in 0..40 {
            batch.clear();
            let mut workspace = learner.policy().mlp().workspace(1);
            for _ in 0..512 {
                let features: Vec<f32> = (0..EGOCENTRIC)
                    .map(|_| rng.random_range(-1.0..1.0))
                    .collect();
                let mut action = [0.0; ACTION];
                let policy = learner.policy();
                let mean = policy.mean(&learner.weights, &features, 1, &mut workspace);
                let log_prob = sample(
                    mean,
                    policy.log_std(&learner.weights),
                    &mut rng,
                    &mut action,
                );
                let target = best(&features);
                let reward = -action.iter().map(|a| (a - target).powi(2)).sum::<f32>();
                batch.features.extend_from_slice(&features);
                batch.final_features.extend_from_slice(&features);
                batch.actions.extend_from_slice(&action);
                batch.log_probs.push(log_prob);
                batch.rewards.push(reward);
                batch.ends.push(End::Terminal);
                batch.records.push(1);
            }
            rewards.push(batch.rewards.iter().sum::<f32>() / 512.0);
            learner.update(&batch, &mut rng);
        }
        let (first, last) = (rewards[0], rewards[rewards.len() - 1]);
        assert!(
            last > 0.5 * first,
            "mean reward went from {first} to {last}"
        );
    }
}
