//! Stage 3a: the low level, goal-conditioned advantage-weighted regression.
//!
//! Value: expectile regression on hindsight goals, two networks with slow targets, reward -1 a
//! step until the goal is reached (Kostrikov et al. 2021; seohongpark/HIQL,
//! `src/agents/hiql.py`). Policy: weight exp(A / temperature), clipped, with
//! A = V(s', c) - V(s, c). Half of the subgoals are snapped to their node's centroid, since at
//! run time the policy sees centroids alone.

use maze::{ACTION, EGOCENTRIC, Egocentric, SUCCESS_RADIUS};
use nets::{Activation, Adam, Mlp, Workspace, polyak};
use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::same_shape;

/// Settings of the low level.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hidden layers of policy and values.
    pub hidden: Vec<usize>,
    /// Step size of Adam.
    pub learning_rate: f32,
    /// Transitions of a gradient step.
    pub batch: usize,
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
}

/// A subgoal: a place and its latent.
#[derive(Debug, Clone, Copy)]
pub struct Subgoal<'a> {
    /// World x, y (m).
    pub place: [f32; 2],
    /// Its latent.
    pub latent: &'a [f32],
}

/// Distances are seen up to this one (m).
const FAR: f32 = 5.0;
/// Features of the values: the policy's view without latents, nearness, absolute places.
const VALUE_INPUT: usize = EGOCENTRIC + 3 + 4;

/// The policy's shape: egocentric features, distance, and the latent step to the subgoal.
#[derive(Debug, Clone)]
pub struct Policy {
    mlp: Mlp,
    latent: usize,
}

impl Policy {
    /// A policy for latents of this width.
    #[must_use]
    pub fn new(latent: usize, hidden: &[usize]) -> Self {
        let sizes = [&[EGOCENTRIC + 1 + latent], hidden, &[ACTION]].concat();
        Self {
            mlp: Mlp::new(&sizes, Activation::Gelu, false),
            latent,
        }
    }

    /// The network; its parameters are the policy's weights.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Appends the input of one state and subgoal to `input`; `latent` is the state's own.
    pub fn input(
        &self,
        observation: &[f32],
        latent: &[f32],
        subgoal: Subgoal<'_>,
        input: &mut Vec<f32>,
    ) -> Egocentric {
        let (dx, dy) = (
            subgoal.place[0] - observation[0],
            subgoal.place[1] - observation[1],
        );
        let frame = Egocentric::new(observation, [dx, dy]);
        input.extend_from_slice(&frame.features);
        input.push(dx.hypot(dy).min(FAR) / FAR);
        let step = || {
            subgoal
                .latent
                .iter()
                .zip(latent)
                .map(|(goal, here)| goal - here)
        };
        let scale = 1.0 / step().map(|d| d * d).sum::<f32>().sqrt().max(0.1);
        input.extend(step().map(|d| d * scale).take(self.latent));
        frame
    }

    /// Mean actions of inputs `[batch, inputs]`, each in its own frame, clipped by the simulator.
    pub fn act<'w>(
        &self,
        weights: &[f32],
        input: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        self.mlp.infer(weights, input, batch, workspace)
    }
}

/// One transition with its two hindsight goals.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Observation, 29 values.
    pub observation: &'a [f32],
    /// Action taken, 8 values, actuator order.
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
    gradient: Vec<f32>,
    output_gradient: Vec<f32>,
}

fn value_input(observation: &[f32], goal: [f32; 2], input: &mut Vec<f32>) {
    let (dx, dy) = (goal[0] - observation[0], goal[1] - observation[1]);
    let distance = dx.hypot(dy);
    input.extend_from_slice(&Egocentric::new(observation, [dx, dy]).features);
    input.extend([
        distance.min(FAR) / FAR,
        (-distance).exp(),
        0.3 * distance.ln_1p(),
    ]);
    input.extend([
        observation[0] / 10.0,
        observation[1] / 10.0,
        goal[0] / 10.0,
        goal[1] / 10.0,
    ]);
}

fn near(observation: &[f32], goal: [f32; 2]) -> bool {
    (goal[0] - observation[0]).hypot(goal[1] - observation[1]) <= SUCCESS_RADIUS
}

impl Low {
    /// Fresh networks.
    pub fn new(latent: usize, settings: Settings, rng: &mut impl Rng) -> Self {
        let policy = Policy::new(latent, &settings.hidden);
        let sizes = [&[VALUE_INPUT], settings.hidden.as_slice(), &[1]].concat();
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
        s.here.clear();
        s.there.clear();
        s.arrived.clear();
        for sample in samples {
            value_input(sample.observation, sample.value_goal, &mut s.here);
            value_input(sample.next, sample.value_goal, &mut s.there);
            s.arrived.push(near(sample.observation, sample.value_goal));
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
        s.gradient.resize(self.values[0].len(), 0.0);
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
            s.gradient.fill(0.0);
            self.value.backward(
                &self.values[i],
                &s.here,
                n,
                &mut self.workspace,
                &s.output_gradient,
                &mut s.gradient,
                None,
            );
            self.value_adams[i].step(&mut self.values[i], &s.gradient);
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
        s.here.clear();
        s.there.clear();
        s.policy_input.clear();
        s.actions.clear();
        for sample in samples {
            let place = sample.subgoal.place;
            value_input(sample.observation, place, &mut s.here);
            value_input(sample.next, place, &mut s.there);
            let frame = self.policy.input(
                sample.observation,
                sample.latent,
                sample.subgoal,
                &mut s.policy_input,
            );
            s.actions.extend(frame.from_actuators(sample.action));
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
        for row in 0..n {
            let weight = (self.settings.inverse_temperature * s.advantage[row])
                .min(self.settings.weight_clip.ln())
                .exp();
            losses.weight += scale * weight;
            for k in 0..ACTION {
                let error = means[row * ACTION + k] - s.actions[row * ACTION + k];
                losses.policy_loss += 0.5 * scale * weight * error * error;
                s.output_gradient.push(scale * weight * error);
            }
        }
        s.gradient.clear();
        s.gradient
            .resize(self.weights.len().max(self.values[0].len()), 0.0);
        self.policy.mlp.backward(
            &self.weights,
            &s.policy_input,
            n,
            &mut self.policy_workspace,
            &s.output_gradient,
            &mut s.gradient[..self.weights.len()],
            None,
        );
        let own = self.weights.len();
        self.policy_adam.step(&mut self.weights, &s.gradient[..own]);
        s.gradient.truncate(self.values[0].len());
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn a_training_goes_on_from_its_state_as_if_nothing_had_been() {
        let settings = |hidden| Settings {
            hidden,
            learning_rate: 1e-3,
            batch: 8,
            expectile: 0.7,
            discount: 0.95,
            inverse_temperature: 3.0,
            weight_clip: 100.0,
            target_rate: 0.02,
        };
        let fresh = |hidden| Low::new(2, settings(hidden), &mut Pcg64Mcg::seed_from_u64(1));
        let train = |low: &mut Low| {
            for update in 0..3 {
                let mut observation = [0.1 * update as f32; 29];
                observation[3] = 1.0;
                let sample = Sample {
                    observation: &observation,
                    action: &[0.5; 8],
                    next: &observation,
                    latent: &[0.0; 2],
                    subgoal: Subgoal {
                        place: [1.0, 2.0],
                        latent: &[0.5, -0.5],
                    },
                    value_goal: [3.0, 0.0],
                };
                low.update(&[sample; 8]);
            }
        };
        let mut low = fresh(vec![16, 16]);
        train(&mut low);
        let state = low.state();
        train(&mut low);
        let mut again = fresh(vec![16, 16]);
        assert!(again.restore(state.clone()));
        train(&mut again);
        assert_eq!(again.state(), low.state());
        assert!(!fresh(vec![16, 8]).restore(state), "of other networks");
    }

    /// A toy ant that slides: its first actuator is its speed along x. Rows where it goes towards
    /// the goal and away from it are equally many; the policy must take after the former.
    #[test]
    fn the_policy_prefers_actions_that_approach_the_subgoal() {
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let settings = Settings {
            hidden: vec![32, 32],
            learning_rate: 1e-3,
            batch: 64,
            expectile: 0.7,
            discount: 0.95,
            inverse_temperature: 3.0,
            weight_clip: 100.0,
            target_rate: 0.02,
        };
        let mut low = Low::new(2, settings, &mut rng);
        let mut policy_error = (0.0, 0.0);
        for update in 0..3000 {
            let rows: Vec<_> = (0..64)
                .map(|_| {
                    let mut observation = [0.0_f32; 29];
                    observation[3] = 1.0;
                    observation[0] = rng.random_range(-3.0..3.0);
                    let speed = if rng.random::<bool>() { 1.0 } else { -1.0_f32 };
                    let mut next = observation;
                    next[0] += 0.4 * speed;
                    let mut action = [0.0; 8];
                    action[0] = speed;
                    let goal = [observation[0] + rng.random_range(1.0..3.0), 0.0];
                    (observation, action, next, goal)
                })
                .collect();
            let samples: Vec<Sample<'_>> = rows
                .iter()
                .map(|(observation, action, next, goal)| Sample {
                    observation,
                    action,
                    next,
                    latent: &[0.0, 0.0],
                    subgoal: Subgoal {
                        place: *goal,
                        latent: &[1.0, 0.0],
                    },
                    value_goal: *goal,
                })
                .collect();
            low.update(&samples);
            if update >= 2900 {
                let policy = low.policy().clone();
                let mut workspace = policy.mlp().workspace(1);
                let mut input = vec![];
                let s = &samples[0];
                let frame = policy.input(s.observation, s.latent, s.subgoal, &mut input);
                let mean = policy.act(&low.weights, &input, 1, &mut workspace);
                policy_error.0 += frame.to_actuators(mean)[0];
                policy_error.1 += 1.0;
            }
        }
        let speed = policy_error.0 / policy_error.1;
        assert!(
            speed > 0.3,
            "the mean speed towards the goal is {speed}; the data's is 0"
        );
    }
}
