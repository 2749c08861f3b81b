//! Stage 3a: the low level, goal-conditioned advantage-weighted regression.
//!
//! Value: expectile regression on hindsight goals, two networks with slow targets, reward -1 a
//! step until the goal is reached (Kostrikov et al. 2021; seohongpark/HIQL,
//! `src/agents/hiql.py`). Policy: weight exp(A / temperature), clipped, with
//! A = V(s', c) - V(s, c). Half of the subgoals are snapped to their node's centroid, since at
//! run time the policy sees centroids alone.

mod policy;
mod settings;
#[cfg(test)]
mod tests;

use nets::{Activation, Adam, Mlp, Workspace, polyak};
use rand::Rng;
use serde::{Deserialize, Serialize};
use simulator::Body;

use crate::same_shape;
use policy::{VALUE_EXTRA, value_input};

pub use policy::{Policy, Subgoal};
pub use settings::{Controller, Settings};

/// One transition with its two hindsight goals.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Observation.
    pub observation: &'a [f32],
    /// Action taken, in the simulator's order.
    pub action: &'a [f32],
    /// Observation after it.
    pub next: &'a [f32],
    /// Latent of the observation's place.
    pub latent: &'a [f32],
    /// Goal of the policy: a state soon to come, or its node.
    pub subgoal: Subgoal<'a>,
    /// Goal of the value.
    pub value_goal: [f32; 2],
}

/// Means of one update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Losses {
    /// Expectile loss of the values.
    pub value_loss: f32,
    /// Mean value of the subgoals.
    pub value: f32,
    /// Weighted squared error of the policy.
    pub policy_loss: f32,
    /// Mean advantage weight.
    pub weight: f32,
}

/// All that an update changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    weights: Vec<f32>,
    values: [Vec<f32>; 2],
    targets: [Vec<f32>; 2],
    policy_adam: Adam,
    value_adams: [Adam; 2],
}

/// Values and policy in training.
pub struct Low {
    policy: Policy,
    value: Mlp,
    arrival_radius: f32,
    settings: Settings,
    /// The policy's weights, as actors use them.
    pub weights: Vec<f32>,
    /// Two values, one after the other.
    values: [Vec<f32>; 2],
    targets: [Vec<f32>; 2],
    policy_adam: Adam,
    value_adams: [Adam; 2],
    workspace: Workspace,
    policy_workspace: Workspace,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    policy_input: Vec<f32>,
    actions: Vec<f32>,
    here: Vec<f32>,
    there: Vec<f32>,
    targets: [Vec<f32>; 2],
    advantage: Vec<f32>,
    arrived: Vec<bool>,
    /// Of the value that was updated last.
    value_gradient: Vec<f32>,
    policy_gradient: Vec<f32>,
    output_gradient: Vec<f32>,
}

impl Low {
    /// Fresh networks. A hindsight transition within `arrival_radius` (m) of its goal has arrived.
    pub fn new(
        body: &'static dyn Body,
        latent: usize,
        arrival_radius: f32,
        settings: Settings,
        rng: &mut impl Rng,
    ) -> Self {
        let policy = Policy::new(body, latent, &settings.hidden);
        let inputs = body.features() + VALUE_EXTRA;
        let sizes = [&[inputs], settings.hidden.as_slice(), &[1]].concat();
        let value = Mlp::new(&sizes, Activation::Gelu, true);
        let weights = policy.mlp.init(rng, 0.01);
        let values = [value.init(rng, 1.0), value.init(rng, 1.0)];
        Self {
            policy_adam: Adam::new(weights.len(), settings.learning_rate),
            value_adams: [0, 1].map(|_| Adam::new(values[0].len(), settings.learning_rate)),
            workspace: value.workspace(settings.batch),
            policy_workspace: policy.mlp.workspace(settings.batch),
            targets: values.clone(),
            scratch: Scratch::default(),
            policy,
            value,
            arrival_radius,
            settings,
            weights,
            values,
        }
    }

    /// Where the training is.
    #[must_use]
    pub fn state(&self) -> State {
        State {
            weights: self.weights.clone(),
            values: self.values.clone(),
            targets: self.targets.clone(),
            policy_adam: self.policy_adam.clone(),
            value_adams: self.value_adams.clone(),
        }
    }

    /// Goes on from a state; false, and nothing is changed, where it is of other networks.
    #[must_use]
    pub fn restore(&mut self, state: State) -> bool {
        let value = self.values[0].len();
        let fits = same_shape(&[
            (&state.weights, &self.weights),
            (&state.values[0], &self.values[0]),
            (&state.values[1], &self.values[1]),
            (&state.targets[0], &self.targets[0]),
            (&state.targets[1], &self.targets[1]),
        ]) && state.policy_adam.fits(self.weights.len())
            && state.value_adams.iter().all(|adam| adam.fits(value));
        if fits {
            State {
                weights: self.weights,
                values: self.values,
                targets: self.targets,
                policy_adam: self.policy_adam,
                value_adams: self.value_adams,
            } = state;
        }
        fits
    }

    /// The policy's shape.
    #[must_use]
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Sets the step size of every network.
    pub fn set_learning_rate(&mut self, rate: f32) {
        self.policy_adam.learning_rate = rate;
        self.value_adams
            .iter_mut()
            .for_each(|adam| adam.learning_rate = rate);
    }

    /// One gradient step of values and policy on at most `settings.batch` samples.
    pub fn update(&mut self, samples: &[Sample<'_>]) -> Losses {
        let mut losses = Losses::default();
        self.update_values(samples, &mut losses);
        self.update_policy(samples, &mut losses);
        losses
    }

    /// HIQL's value loss: the expectile weight comes from the smaller target's advantage, the
    /// regression target from each network's own.
    fn update_values(&mut self, samples: &[Sample<'_>], losses: &mut Losses) {
        let n = samples.len();
        let s = &mut self.scratch;
        let body = self.policy.body;
        s.here.clear();
        s.there.clear();
        s.arrived.clear();
        for sample in samples {
            let goal = sample.value_goal;
            value_input(body, sample.observation, goal, &mut s.here);
            value_input(body, sample.next, goal, &mut s.there);
            let [x, y] = body.place(sample.observation);
            let distance = (goal[0] - x).hypot(goal[1] - y);
            s.arrived.push(distance <= self.arrival_radius);
        }
        s.advantage.clear();
        s.advantage.resize(n, 0.0);
        for (target, parameters) in s.targets.iter_mut().zip(&self.targets) {
            target.clear();
            let next = self
                .value
                .infer(parameters, &s.there, n, &mut self.workspace);
            for (value, &arrived) in next.iter().zip(&s.arrived) {
                let follow = -1.0 + self.settings.discount * value;
                target.push(if arrived { 0.0 } else { follow });
            }
            let here = self
                .value
                .infer(parameters, &s.here, n, &mut self.workspace);
            for (advantage, value) in s.advantage.iter_mut().zip(here) {
                *advantage -= 0.5 * value;
            }
        }
        let [first, second] = &s.targets;
        for ((advantage, a), b) in s.advantage.iter_mut().zip(first).zip(second) {
            *advantage += a.min(*b);
        }
        s.value_gradient.resize(self.values[0].len(), 0.0);
        let scale = 1.0 / n as f32;
        for i in 0..2 {
            let values = self
                .value
                .forward(&self.values[i], &s.here, n, &mut self.workspace);
            s.output_gradient.clear();
            for row in 0..n {
                let error = values[row] - s.targets[i][row];
                let tau = self.settings.expectile;
                let weight = if s.advantage[row] < 0.0 {
                    1.0 - tau
                } else {
                    tau
                };
                losses.value_loss += 0.5 * scale * weight * error * error;
                s.output_gradient.push(2.0 * scale * weight * error);
            }
            s.value_gradient.fill(0.0);
            self.value.backward(
                &self.values[i],
                &s.here,
                n,
                &mut self.workspace,
                &s.output_gradient,
                &mut s.value_gradient,
                None,
            );
            self.value_adams[i].step(&mut self.values[i], &s.value_gradient);
            polyak(
                &mut self.targets[i],
                &self.values[i],
                self.settings.target_rate,
            );
        }
    }

    fn update_policy(&mut self, samples: &[Sample<'_>], losses: &mut Losses) {
        let n = samples.len();
        let scale = 1.0 / n as f32;
        let s = &mut self.scratch;
        let body = self.policy.body;
        s.here.clear();
        s.there.clear();
        s.policy_input.clear();
        s.actions.clear();
        for sample in samples {
            let place = sample.subgoal.place;
            value_input(body, sample.observation, place, &mut s.here);
            value_input(body, sample.next, place, &mut s.there);
            let frame = self.policy.input(
                sample.observation,
                sample.latent,
                sample.subgoal,
                &mut s.policy_input,
            );
            let start = s.actions.len();
            s.actions.resize(start + sample.action.len(), 0.0);
            body.from_actuators(frame, sample.action, &mut s.actions[start..]);
        }
        s.advantage.clear();
        s.advantage.resize(n, 0.0);
        for parameters in &self.values {
            for (input, sign) in [(&s.here, -0.5), (&s.there, 0.5)] {
                let values = self.value.infer(parameters, input, n, &mut self.workspace);
                for (advantage, value) in s.advantage.iter_mut().zip(values) {
                    *advantage += sign * value;
                    losses.value += if sign < 0.0 { 0.5 * scale * value } else { 0.0 };
                }
            }
        }
        let means = self.policy.mlp.forward(
            &self.weights,
            &s.policy_input,
            n,
            &mut self.policy_workspace,
        );
        s.output_gradient.clear();
        let width = self.policy.mlp.outputs();
        for row in 0..n {
            let weight = (self.settings.inverse_temperature * s.advantage[row])
                .min(self.settings.weight_clip.ln())
                .exp();
            losses.weight += scale * weight;
            for k in row * width..(row + 1) * width {
                let error = means[k] - s.actions[k];
                losses.policy_loss += 0.5 * scale * weight * error * error;
                s.output_gradient.push(scale * weight * error);
            }
        }
        s.policy_gradient.clear();
        s.policy_gradient.resize(self.weights.len(), 0.0);
        self.policy.mlp.backward(
            &self.weights,
            &s.policy_input,
            n,
            &mut self.policy_workspace,
            &s.output_gradient,
            &mut s.policy_gradient,
            None,
        );
        self.policy_adam.step(&mut self.weights, &s.policy_gradient);
    }
}
