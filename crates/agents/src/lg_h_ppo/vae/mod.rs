//! Stage 1: the latent encoder, a conditional VAE over pairs of places (s_t, s_{t+c}).
//!
//! LG-H-PPO (Han 2026), section on latent subgoals; losses and KL balance as in gckor/Guider
//! (`algos.py`). Condition dropout is ours: with the condition replaced by a null token in half
//! of the pairs, `q(z | null, s)` encodes the place itself, while the pair's own code would
//! encode the displacement, which is no place to build a graph on.

mod encoder;
mod settings;
mod shape;
#[cfg(test)]
mod tests;

use nets::{Adam, Workspace};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::same_shape;

pub use encoder::Encoder;
pub use settings::{Latent, Settings};
pub use shape::Shape;

/// Width of a place: x, y.
pub const PLACE: usize = 2;
/// Width of a condition: a standardised place and the null flag.
const CONDITION: usize = PLACE + 1;
const LOG_STD: std::ops::RangeInclusive<f32> = -5.0..=2.0;

/// Means of one update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Losses {
    /// Mean squared error of the decoded place (standardised units).
    pub reconstruction: f32,
    /// KL(q || rho), nats.
    pub kl: f32,
}

/// All that an update changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    weights: Vec<f32>,
    adam: Adam,
}

/// The VAE in training.
pub struct Vae {
    shape: Shape,
    settings: Settings,
    /// Flat weights as [`Encoder::new`] takes them.
    pub weights: Vec<f32>,
    adam: Adam,
    gradient: Vec<f32>,
    workspaces: [Workspace; 3],
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    conditions: Vec<f32>,
    targets: Vec<f32>,
    encoder_input: Vec<f32>,
    decoder_input: Vec<f32>,
    noise: Vec<f32>,
    null: Vec<bool>,
    posterior_gradient: Vec<f32>,
    prior_gradient: Vec<f32>,
    place_gradient: Vec<f32>,
    decoder_input_gradient: Vec<f32>,
}

impl Vae {
    /// Fresh networks for places of this mean and standard deviation (m).
    pub fn new(settings: Settings, mean: [f32; 2], std: [f32; 2], rng: &mut impl Rng) -> Self {
        let shape = Shape::new(settings.latent, &settings.hidden);
        let mut weights = [mean, std.map(|s| s.max(1e-3))].concat();
        for network in [&shape.encoder, &shape.decoder, &shape.prior] {
            weights.extend(network.init(rng, 1.0));
        }
        let networks = shape.ends()[2];
        Self {
            adam: Adam::new(networks, settings.learning_rate),
            gradient: vec![0.0; networks],
            workspaces: [&shape.encoder, &shape.decoder, &shape.prior]
                .map(|network| network.workspace(settings.batch)),
            scratch: Scratch::default(),
            shape,
            settings,
            weights,
        }
    }

    /// Where the training is.
    #[must_use]
    pub fn state(&self) -> State {
        State {
            weights: self.weights.clone(),
            adam: self.adam.clone(),
        }
    }

    /// Goes on from a state; false, and nothing is changed, where it is of other networks.
    #[must_use]
    pub fn restore(&mut self, state: State) -> bool {
        let fits =
            same_shape(&[(&state.weights, &self.weights)]) && state.adam.fits(self.gradient.len());
        if fits {
            State {
                weights: self.weights,
                adam: self.adam,
            } = state;
        }
        fits
    }

    /// The networks' shapes.
    #[must_use]
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// One gradient step on pairs of places (s_t, s_{t+c}), at most `settings.batch` of them.
    pub fn update(&mut self, pairs: &[([f32; 2], [f32; 2])], rng: &mut impl Rng) -> Losses {
        let dz = self.settings.latent;
        self.scratch.noise.clear();
        self.scratch.null.clear();
        for _ in pairs {
            self.scratch
                .noise
                .extend((0..dz).map(|_| -> f32 { StandardNormal.sample(rng) }));
            self.scratch
                .null
                .push(rng.random::<f32>() < self.settings.null_condition);
        }
        self.gradient.fill(0.0);
        let losses = self.losses(pairs);
        let (_, networks) = self.weights.split_at_mut(2 * PLACE);
        self.adam.step(networks, &self.gradient);
        losses
    }

    /// Losses of the pairs under the noise drawn, their gradient added to `self.gradient`.
    fn losses(&mut self, pairs: &[([f32; 2], [f32; 2])]) -> Losses {
        let (dz, n) = (self.settings.latent, pairs.len());
        let ends = self.shape.ends();
        let (norm, networks) = self.weights.split_at(2 * PLACE);
        let (encoder, rest) = networks.split_at(ends[0]);
        let (decoder, prior) = rest.split_at(ends[1] - ends[0]);
        let [encoder_ws, decoder_ws, prior_ws] = &mut self.workspaces;
        let s = &mut self.scratch;
        let standard = |place: [f32; 2]| [0, 1].map(|k| (place[k] - norm[k]) / norm[PLACE + k]);

        s.conditions.clear();
        s.targets.clear();
        s.encoder_input.clear();
        for (&(from, to), &null) in pairs.iter().zip(&s.null) {
            let [x, y] = standard(from);
            let condition = if null { [0.0, 0.0, 1.0] } else { [x, y, 0.0] };
            s.conditions.extend(condition);
            s.encoder_input.extend(condition);
            s.encoder_input.extend(standard(to));
            s.targets.extend(standard(to));
        }
        let posterior = self
            .shape
            .encoder
            .forward(encoder, &s.encoder_input, n, encoder_ws);
        let rho = self.shape.prior.forward(prior, &s.conditions, n, prior_ws);
        s.decoder_input.clear();
        for row in 0..n {
            s.decoder_input
                .extend_from_slice(&s.conditions[row * CONDITION..(row + 1) * CONDITION]);
            let q = &posterior[row * 2 * dz..(row + 1) * 2 * dz];
            s.decoder_input
                .extend((0..dz).map(|k| q[k] + clamp(q[dz + k]).exp() * s.noise[row * dz + k]));
        }
        let decoded = self
            .shape
            .decoder
            .forward(decoder, &s.decoder_input, n, decoder_ws);
        let mut losses = Losses::default();
        let scale = 1.0 / n as f32;
        s.place_gradient.clear();
        for (value, target) in decoded.iter().zip(&s.targets).take(n * PLACE) {
            let error = value - target;
            losses.reconstruction += scale * error * error;
            s.place_gradient.push(2.0 * scale * error);
        }
        s.decoder_input_gradient.resize(n * (CONDITION + dz), 0.0);
        let (encoder_gradient, rest) = self.gradient.split_at_mut(ends[0]);
        let (decoder_gradient, prior_gradient) = rest.split_at_mut(ends[1] - ends[0]);
        self.shape.decoder.backward(
            decoder,
            &s.decoder_input,
            n,
            decoder_ws,
            &s.place_gradient,
            decoder_gradient,
            Some(&mut s.decoder_input_gradient),
        );

        s.posterior_gradient.clear();
        s.posterior_gradient.resize(n * 2 * dz, 0.0);
        s.prior_gradient.clear();
        s.prior_gradient.resize(n * 2 * dz, 0.0);
        let beta = self.settings.beta * scale;
        let kappa = self.settings.prior_balance;
        for row in 0..n {
            let at = row * 2 * dz;
            for k in 0..dz {
                let (m1, raw1) = (posterior[at + k], posterior[at + dz + k]);
                let l1 = clamp(raw1);
                // Without a condition the prior is the standard normal and is not trained.
                let (m2, l2) = if s.null[row] {
                    (0.0, 0.0)
                } else {
                    (rho[at + k], clamp(rho[at + dz + k]))
                };
                let (v1, v2) = ((2.0 * l1).exp(), (2.0 * l2).exp());
                let gap = m1 - m2;
                losses.kl += scale * (l2 - l1 + (v1 + gap * gap) / (2.0 * v2) - 0.5);
                let z_gradient = s.decoder_input_gradient[row * (CONDITION + dz) + CONDITION + k];
                // The null pairs have no prior to train: all of their KL is the posterior's.
                let share = if s.null[row] {
                    beta
                } else {
                    beta * (1.0 - kappa)
                };
                let inside = f32::from(u8::from(LOG_STD.contains(&raw1)));
                s.posterior_gradient[at + k] = z_gradient + share * gap / v2;
                s.posterior_gradient[at + dz + k] = inside
                    * (z_gradient * l1.exp() * s.noise[row * dz + k] + share * (v1 / v2 - 1.0));
                if !s.null[row] {
                    let inside = f32::from(u8::from(LOG_STD.contains(&rho[at + dz + k])));
                    s.prior_gradient[at + k] = -beta * kappa * gap / v2;
                    s.prior_gradient[at + dz + k] =
                        inside * beta * kappa * (1.0 - (v1 + gap * gap) / v2);
                }
            }
        }
        self.shape.encoder.backward(
            encoder,
            &s.encoder_input,
            n,
            encoder_ws,
            &s.posterior_gradient,
            encoder_gradient,
            None,
        );
        self.shape.prior.backward(
            prior,
            &s.conditions,
            n,
            prior_ws,
            &s.prior_gradient,
            prior_gradient,
            None,
        );
        losses
    }
}

fn clamp(log_std: f32) -> f32 {
    log_std.clamp(*LOG_STD.start(), *LOG_STD.end())
}
