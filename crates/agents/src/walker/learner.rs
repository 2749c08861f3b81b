//! PPO of the walker's policy.

use maze::{ACTION, EGOCENTRIC};
use nets::{Activation, Mlp};
use rand::Rng;

use super::gaussian::Gaussian;
use super::policy::Policy;
use crate::actor_critic::{ActorCritic, Samples, State};
use crate::ppo::{self, End, Report, Settings};

/// On-policy steps of many short records, flat.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    /// `[n, 28]`.
    pub(super) features: Vec<f32>,
    /// Actions as sampled, in each feature's own frame, `[n, 8]`.
    pub(super) actions: Vec<f32>,
    /// Their log-probabilities under the behaviour policy, `[n]`.
    pub(super) log_probs: Vec<f32>,
    /// `[n]`.
    pub(super) rewards: Vec<f32>,
    /// `[n]`.
    pub(super) ends: Vec<End>,
    /// Features after the last step of each record, `[records, 28]`.
    pub(super) final_features: Vec<f32>,
    /// Steps of each record.
    pub(super) records: Vec<usize>,
}

impl Batch {
    /// Steps held.
    #[must_use]
    pub(super) fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Forgets all steps and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.features.clear();
        self.actions.clear();
        self.log_probs.clear();
        self.rewards.clear();
        self.ends.clear();
        self.final_features.clear();
        self.records.clear();
    }
}

/// Actor, critic and their optimisers.
pub(super) struct Learner {
    #[cfg(test)]
    policy: Policy,
    networks: ActorCritic,
    values: Vec<f32>,
    final_values: Vec<f32>,
    estimate: ppo::Estimate,
}

/// Without bounds on the spread a batch can make it collapse or explode.
const LOG_STD: [f32; 2] = [-2.5, 0.5];

impl Learner {
    /// A learner with fresh networks.
    pub(super) fn new(
        hidden: &[usize],
        log_std: f32,
        learning_rate: f32,
        settings: Settings,
        rng: &mut impl Rng,
    ) -> Self {
        let policy = Policy::new(hidden);
        let sizes = [&[EGOCENTRIC], hidden, &[1]].concat();
        let networks = [
            policy.mlp().clone(),
            Mlp::new(&sizes, Activation::Tanh, false),
        ];
        Self {
            networks: ActorCritic::new(
                networks,
                &[log_std; ACTION],
                learning_rate,
                settings,
                0,
                rng,
            ),
            #[cfg(test)]
            policy,
            values: vec![],
            final_values: vec![],
            estimate: ppo::Estimate::default(),
        }
    }

    /// The policy's flat weights, as actors use them.
    #[must_use]
    pub(super) fn weights(&self) -> &[f32] {
        &self.networks.weights
    }

    /// Begins with these weights instead; false, and nothing is changed, where their number is
    /// wrong.
    #[must_use]
    pub(super) fn set_weights(&mut self, weights: Vec<f32>) -> bool {
        let fits = weights.len() == self.networks.weights.len();
        if fits {
            self.networks.weights = weights;
        }
        fits
    }

    /// Where the training is.
    #[must_use]
    pub(super) fn state(&self) -> State {
        self.networks.state()
    }

    /// Goes on from a state; false, and nothing is changed, where it is of other networks.
    #[must_use]
    pub(super) fn restore(&mut self, state: State) -> bool {
        self.networks.restore(state)
    }

    /// The policy's shape.
    #[cfg(test)]
    pub(super) fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Sets the step size of both networks.
    pub(super) fn set_learning_rate(&mut self, rate: f32) {
        self.networks.set_learning_rate(rate);
    }

    /// One PPO update on a batch of on-policy steps.
    pub(super) fn update(&mut self, batch: &Batch, rng: &mut impl Rng) -> Report {
        let row = |features: &[f32], i: usize, input: &mut Vec<f32>| {
            input.extend_from_slice(&features[i * EGOCENTRIC..(i + 1) * EGOCENTRIC]);
        };
        self.values.clear();
        self.final_values.clear();
        let networks = &mut self.networks;
        let steps = |i: usize, input: &mut Vec<f32>| row(&batch.features, i, input);
        networks.values(batch.len(), steps, &mut self.values);
        let finals = |i: usize, input: &mut Vec<f32>| row(&batch.final_features, i, input);
        networks.values(batch.records.len(), finals, &mut self.final_values);
        ppo::estimate(
            networks.settings(),
            &batch.records,
            (&self.values, &self.final_values),
            (&batch.rewards, &batch.ends, None),
            &mut self.estimate,
        );
        let samples = Samples {
            input: steps,
            log_probs: &batch.log_probs,
            estimate: &self.estimate,
        };
        let bound = |log_std: &mut [f32]| {
            for value in log_std {
                *value = value.clamp(LOG_STD[0], LOG_STD[1]);
            }
        };
        networks.update(samples, &mut Gaussian::new(&batch.actions), bound, rng)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::walker::policy::sample;

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
                let mean = policy.mean(learner.weights(), &features, 1, &mut workspace);
                let log_prob = sample(
                    mean,
                    policy.log_std(learner.weights()),
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
