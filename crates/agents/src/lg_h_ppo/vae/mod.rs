//! Stage 1: the latent encoder, a conditional VAE over pairs of places (s_t, s_{t+c}).
//!
//! LG-H-PPO (Han 2026), section on latent subgoals; losses and KL balance as in gckor/Guider
//! (`algos.py`). Condition dropout is ours: with the condition replaced by a null token in half
//! of the pairs, `q(z | null, s)` encodes the place itself, while the pair's own code would
//! encode the displacement, which is no place to build a graph on.

mod encoder;
mod scratch;
mod settings;
mod shape;
#[cfg(test)]
mod tests;

use nets::{Adam, Workspace};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::same_shape;
use scratch::Scratch;
use shape::CONDITION;

pub use encoder::Encoder;
pub use settings::{Latent, Settings};
pub use shape::{PLACE, Shape};

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
        s.begin(pairs, norm);
        let posterior = self
            .shape
            .encoder
            .forward(encoder, &s.encoder_input, n, encoder_ws);
        let rho = self.shape.prior.forward(prior, &s.conditions, n, prior_ws);
        s.draw_latents(posterior, dz);
        let decoded = self
            .shape
            .decoder
            .forward(decoder, &s.decoder_input, n, decoder_ws);
        let reconstruction = s.reconstruction(decoded);
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

        let balance = [self.settings.beta, self.settings.prior_balance];
        let kl = s.divergence(posterior, rho, dz, balance);
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
        Losses { reconstruction, kl }
    }
}
