//! Policy and critic under proximal policy optimisation, whatever the policy's distribution.
//!
//! Schulman et al., "Proximal policy optimization algorithms" (2017): the clipped surrogate (eq. 7),
//! the entropy bonus and the value loss (eq. 9), each network with an optimiser of its own.

use nets::{Adam, Mlp, Workspace, clip_global_norm};
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::ppo::{self, Estimate, Report, Settings};
use crate::same_shape;

/// A policy's distribution over the actions of a batch.
pub trait Distribution {
    /// Scores the action that was taken in sample `i`, under the network's `outputs` for it and the
    /// policy's `free` parameters. `weigh` is given the action's log-probability and the
    /// distribution's entropy (nats) and answers with a weight for each; the weighted gradients are
    /// added to `output_gradient` and `free_gradient`. False, and nothing is added, where the
    /// action cannot be taken.
    fn grade(
        &mut self,
        i: usize,
        outputs: &[f32],
        free: &[f32],
        weigh: impl FnOnce(f32, f32) -> [f32; 2],
        output_gradient: &mut [f32],
        free_gradient: &mut [f32],
    ) -> bool;
}

/// What the samples of a batch are, apart from their actions.
pub struct Samples<'a, I> {
    /// Appends the input of a sample, which policy and critic share.
    pub input: I,
    /// Log-probabilities under the behaviour policy, `[n]`.
    pub log_probs: &'a [f32],
    /// Advantages and returns, `[n]`.
    pub estimate: &'a Estimate,
}

/// All that an update changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    weights: Vec<f32>,
    value_parameters: Vec<f32>,
    policy_adam: Adam,
    value_adam: Adam,
}

/// Policy and critic in training.
pub struct ActorCritic {
    policy: Mlp,
    critic: Mlp,
    settings: Settings,
    /// The policy network's parameters, then its free ones.
    pub weights: Vec<f32>,
    /// The critic's parameters.
    pub value_parameters: Vec<f32>,
    /// Weight of the entropy bonus at the moment.
    pub entropy: f32,
    policy_adam: Adam,
    value_adam: Adam,
    policy_workspace: Workspace,
    value_workspace: Workspace,
    capacity: usize,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    input: Vec<f32>,
    output_gradient: Vec<f32>,
    policy_gradient: Vec<f32>,
    error: Vec<f32>,
    value_gradient: Vec<f32>,
}

impl ActorCritic {
    /// Fresh networks; `free` are the policy's first parameters beyond its network's. Buffers are
    /// for at most `capacity` samples at once, and a minibatch at least.
    pub fn new(
        [policy, critic]: [Mlp; 2],
        free: &[f32],
        learning_rate: f32,
        settings: Settings,
        capacity: usize,
        rng: &mut impl Rng,
    ) -> Self {
        let mut weights = policy.init(rng, 0.01);
        weights.extend_from_slice(free);
        let value_parameters = critic.init(rng, 1.0);
        let capacity = capacity.max(settings.minibatch);
        Self {
            policy_adam: Adam::new(weights.len(), learning_rate),
            value_adam: Adam::new(value_parameters.len(), learning_rate),
            policy_workspace: policy.workspace(capacity),
            value_workspace: critic.workspace(capacity),
            entropy: settings.entropy,
            policy,
            critic,
            settings,
            weights,
            value_parameters,
            capacity,
            scratch: Scratch::default(),
        }
    }

    /// Settings of an update.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
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

    /// Whether a state is of networks of these shapes, and finite.
    #[must_use]
    pub fn fits(&self, state: &State) -> bool {
        same_shape(&[
            (&state.weights, &self.weights),
            (&state.value_parameters, &self.value_parameters),
        ]) && state.policy_adam.fits(self.weights.len())
            && state.value_adam.fits(self.value_parameters.len())
    }

    /// Goes on from a state; false, and nothing is changed, where it does not [fit](Self::fits).
    #[must_use]
    pub fn restore(&mut self, state: State) -> bool {
        let fits = self.fits(&state);
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

    /// Gives the policy other outputs: output `j` starts as a copy of output `sources[j]`, with
    /// what its optimiser knows of it.
    pub fn take_outputs(&mut self, sources: &[usize]) {
        let (network, free) = self.weights.split_at(self.policy.parameters());
        let old = &self.policy;
        let free = free.to_vec();
        self.weights = [old.take_outputs(network, sources), free].concat();
        self.policy_adam.map_moments(|moments| {
            let (network, free) = moments.split_at(old.parameters());
            [&old.take_outputs(network, sources), free].concat()
        });
        self.policy = old.with_outputs(sources.len());
        self.policy_workspace = self.policy.workspace(self.capacity);
    }

    /// The policy network's outputs for `rows` inputs.
    pub fn outputs(&mut self, input: &[f32], rows: usize) -> &[f32] {
        let network = &self.weights[..self.policy.parameters()];
        self.policy
            .infer(network, input, rows, &mut self.policy_workspace)
    }

    /// Appends the critic's values of `n` samples to `values`.
    pub fn values(
        &mut self,
        n: usize,
        mut input: impl FnMut(usize, &mut Vec<f32>),
        values: &mut Vec<f32>,
    ) {
        let inputs = &mut self.scratch.input;
        for first in (0..n).step_by(self.settings.minibatch.max(1)) {
            let rows = self.settings.minibatch.max(1).min(n - first);
            inputs.clear();
            (first..first + rows).for_each(|i| input(i, inputs));
            let workspace = &mut self.value_workspace;
            let out = self
                .critic
                .infer(&self.value_parameters, inputs, rows, workspace);
            values.extend_from_slice(&out[..rows]);
        }
    }

    /// One PPO update on a batch; `bound` is called with the policy's free parameters after each
    /// gradient step.
    pub fn update<I: FnMut(usize, &mut Vec<f32>), D: Distribution>(
        &mut self,
        mut samples: Samples<'_, I>,
        distribution: &mut D,
        bound: impl Fn(&mut [f32]),
        rng: &mut impl Rng,
    ) -> Report {
        let settings = self.settings.clone();
        ppo::epochs(&settings, samples.log_probs.len(), rng, |minibatch| {
            let report = self.losses(&mut samples, distribution, minibatch);
            let s = &mut self.scratch;
            clip_global_norm(&mut s.policy_gradient, settings.max_gradient_norm);
            self.policy_adam.step(&mut self.weights, &s.policy_gradient);
            bound(&mut self.weights[self.policy.parameters()..]);
            clip_global_norm(&mut s.value_gradient, settings.max_gradient_norm);
            self.value_adam
                .step(&mut self.value_parameters, &s.value_gradient);
            report
        })
    }

    /// Losses of a minibatch; their gradients are left in the scratch.
    fn losses<I: FnMut(usize, &mut Vec<f32>), D: Distribution>(
        &mut self,
        samples: &mut Samples<'_, I>,
        distribution: &mut D,
        minibatch: &[usize],
    ) -> Report {
        let n = minibatch.len();
        let scale = 1.0 / n as f32;
        let s = &mut self.scratch;
        s.input.clear();
        for &i in minibatch {
            (samples.input)(i, &mut s.input);
        }
        let width = self.policy.outputs();
        zeros(&mut s.output_gradient, n * width);
        zeros(&mut s.policy_gradient, self.weights.len());
        zeros(&mut s.value_gradient, self.value_parameters.len());
        let (network, free) = self.weights.split_at(self.policy.parameters());
        let (network_gradient, free_gradient) = s.policy_gradient.split_at_mut(network.len());
        let mut report = Report::default();
        let outputs = self
            .policy
            .forward(network, &s.input, n, &mut self.policy_workspace);
        for (row, &i) in minibatch.iter().enumerate() {
            let (behaviour, advantage) = (samples.log_probs[i], samples.estimate.advantages[i]);
            let weigh = |log_prob: f32, entropy: f32| {
                let (loss, gradient, clipped) =
                    ppo::surrogate(log_prob, behaviour, advantage, self.settings.clip);
                let shift = log_prob - behaviour;
                report.policy_loss += scale * loss;
                report.entropy += scale * entropy;
                // Schulman's low-variance estimate of the divergence.
                report.kl += scale * (shift.exp() - 1.0 - shift);
                report.clip_fraction += scale * f32::from(u8::from(clipped));
                [scale * gradient, -scale * self.entropy]
            };
            let own = row * width..(row + 1) * width;
            distribution.grade(
                i,
                &outputs[own.clone()],
                free,
                weigh,
                &mut s.output_gradient[own],
                free_gradient,
            );
        }
        self.policy.backward(
            network,
            &s.input,
            n,
            &mut self.policy_workspace,
            &s.output_gradient,
            network_gradient,
            None,
        );

        let values = self.critic.forward(
            &self.value_parameters,
            &s.input,
            n,
            &mut self.value_workspace,
        );
        s.error.clear();
        for (value, &i) in values.iter().zip(minibatch) {
            let error = value - samples.estimate.returns[i];
            report.value_loss += scale * error * error;
            s.error.push(2.0 * scale * self.settings.value_loss * error);
        }
        self.critic.backward(
            &self.value_parameters,
            &s.input,
            n,
            &mut self.value_workspace,
            &s.error,
            &mut s.value_gradient,
            None,
        );
        report
    }
}

fn zeros(values: &mut Vec<f32>, len: usize) {
    values.clear();
    values.resize(len, 0.0);
}

#[cfg(test)]
mod tests {
    use nets::Activation;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::lg_h_ppo::high;
    use crate::walker;

    const INPUTS: usize = 5;
    const SAMPLES: usize = 12;

    fn settings() -> Settings {
        Settings {
            epochs: 1,
            minibatch: SAMPLES,
            clip: 0.2,
            entropy: 0.03,
            value_loss: 0.7,
            max_gradient_norm: 0.5,
            discount: 0.9,
            gae_lambda: 0.95,
            target_kl: None,
        }
    }

    /// Compares the gradients of policy and critic with central differences of the losses that are
    /// reported.
    fn check(outputs: usize, free: &[f32], distribution: &mut impl Distribution) {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let mlp = |outputs| Mlp::new(&[INPUTS, 7, outputs], Activation::Tanh, false);
        let networks = [mlp(outputs), mlp(1)];
        let mut agent = ActorCritic::new(networks, free, 1e-3, settings(), SAMPLES, &mut rng);
        // The last layer begins near zero, where every action is as likely as any other.
        for weight in &mut agent.weights {
            *weight += 0.3 * rng.random_range(-1.0..1.0_f32);
        }
        let mut random =
            |n: usize| -> Vec<f32> { (0..n).map(|_| rng.random_range(-1.0..1.0_f32)).collect() };
        let inputs = random(SAMPLES * INPUTS);
        let mut estimate = Estimate::default();
        estimate.advantages = random(SAMPLES);
        estimate.returns = random(SAMPLES);
        let minibatch: Vec<usize> = (0..SAMPLES).collect();
        // Ratios within the clip and beyond it, none near its corners at 0.8 and 1.2.
        let mut log_probs = vec![];
        for i in 0..SAMPLES {
            let out = agent
                .outputs(&inputs[i * INPUTS..(i + 1) * INPUTS], 1)
                .to_vec();
            let free = agent.weights[agent.policy.parameters()..].to_vec();
            let mut found = 0.0;
            let note = |log_prob, _| {
                found = log_prob;
                [0.0; 2]
            };
            let (mut a, mut b) = (vec![0.0; outputs], vec![0.0; free.len()]);
            assert!(distribution.grade(i, &out, &free, note, &mut a, &mut b));
            log_probs.push(found + 0.1 * (i as f32 - 5.5));
        }
        let mut losses = |agent: &mut ActorCritic| {
            let mut samples = Samples {
                input: |i: usize, input: &mut Vec<f32>| {
                    input.extend_from_slice(&inputs[i * INPUTS..(i + 1) * INPUTS]);
                },
                log_probs: &log_probs,
                estimate: &estimate,
            };
            let report = agent.losses(&mut samples, distribution, &minibatch);
            [
                report.policy_loss - settings().entropy * report.entropy,
                settings().value_loss * report.value_loss,
            ]
        };
        losses(&mut agent);
        let gradients = [
            agent.scratch.policy_gradient.clone(),
            agent.scratch.value_gradient.clone(),
        ];
        for which in 0..2 {
            for k in 0..gradients[which].len() {
                let mut at = |change: f32| {
                    let values = match which {
                        0 => &mut agent.weights,
                        _ => &mut agent.value_parameters,
                    };
                    let before = values[k];
                    values[k] += change;
                    let loss = losses(&mut agent)[which];
                    match which {
                        0 => agent.weights[k] = before,
                        _ => agent.value_parameters[k] = before,
                    }
                    loss
                };
                let numeric = (at(4e-3) - at(-4e-3)) / 8e-3;
                let exact = gradients[which][k];
                assert!(
                    (numeric - exact).abs() < 2e-3 + 2e-2 * exact.abs(),
                    "{which} {k}: {numeric} {exact}"
                );
            }
        }
    }

    #[test]
    fn the_gradients_over_neighbours_are_finite_differences() {
        let allowed: Vec<Vec<usize>> = (0..SAMPLES).map(|i| vec![i % 3, 3 + i % 2, 5]).collect();
        let picked: Vec<usize> = (0..SAMPLES).map(|i| allowed[i][i % 3]).collect();
        let neighbours = |i: usize, out: &mut Vec<usize>| out.extend_from_slice(&allowed[i]);
        check(
            6,
            &[],
            &mut high::Neighbours::new(neighbours, |i| picked[i]),
        );
    }

    #[test]
    fn the_gradients_of_a_gaussian_are_finite_differences() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let actions: Vec<f32> = (0..SAMPLES * 2)
            .map(|_| rng.random_range(-1.0..1.0_f32))
            .collect();
        check(2, &[-0.5, 0.1], &mut walker::Gaussian::new(&actions));
    }
}
