//! Stage 1: the latent encoder, a conditional VAE over pairs of places (s_t, s_{t+c}).
//!
//! LG-H-PPO (Han 2026), section on latent subgoals; losses and KL balance as in gckor/Guider
//! (`algos.py`). Condition dropout is ours: with the condition replaced by a null token in half
//! of the pairs, `q(z | null, s)` encodes the place itself, while the pair's own code would
//! encode the displacement, which is no place to build a graph on.

use config::Table;
use nets::{Activation, Adam, Mlp, Workspace};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::same_shape;

/// Width of a place: x, y.
pub const PLACE: usize = 2;
/// Width of a condition: a standardised place and the null flag.
const CONDITION: usize = PLACE + 1;
const LOG_STD: std::ops::RangeInclusive<f32> = -5.0..=2.0;

/// What a state's latent is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latent {
    /// A code of the VAE.
    Vae,
    /// The place itself: the oracle of stage 1.
    Place,
}

/// `[encoder]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// `vae`, or `place`: then a latent has two values and there are no hidden layers.
    pub kind: Latent,
    /// Width of a latent.
    pub latent: usize,
    /// Control steps between the two places of a pair.
    pub lag: usize,
    /// Weight of the KL term.
    pub beta: f32,
    /// Share of the KL gradient that trains the prior (kappa).
    pub prior_balance: f32,
    /// Probability that the condition is replaced by the null token.
    pub null_condition: f32,
    /// Hidden layers of each of the three networks.
    pub hidden: Vec<usize>,
    /// Step size of Adam.
    pub learning_rate: f32,
    /// Pairs of a gradient step.
    pub batch: usize,
    /// Gradient steps.
    pub updates: usize,
    /// Weights of another run's checkpoint, instead of training.
    pub from: Option<String>,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        let places = t.word("kind", "vae", &["vae", "place"]) == "place";
        let mut settings = Self {
            kind: if places { Latent::Place } else { Latent::Vae },
            latent: t.count("latent", if places { 2 } else { 8 }, [1, 64]),
            lag: t.count("lag", 15, [1, 1000]),
            beta: t.number("beta", 0.01, [0.0, 100.0]) as f32,
            prior_balance: t.number("prior_balance", 0.8, [0.0, 1.0]) as f32,
            null_condition: t.number("null_condition", 0.5, [0.0, 1.0]) as f32,
            hidden: t.layers("hidden", &[128, 128]),
            learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]) as f32,
            batch: t.count("batch", 256, [1, 65_536]),
            updates: t.count("updates", 10_000, [1, 100_000_000]),
            from: t.file("from"),
        };
        if places {
            if settings.latent != 2 {
                t.fault("latent", "kind = \"place\" goes with latent = 2");
            }
            settings.hidden.clear();
        }
        settings
    }

    /// Whether it is trained here.
    #[must_use]
    pub fn is_trained(&self) -> bool {
        self.kind == Latent::Vae && self.from.is_none()
    }
}

/// The three networks' shapes.
#[derive(Debug, Clone)]
pub struct Shape {
    encoder: Mlp,
    decoder: Mlp,
    prior: Mlp,
    latent: usize,
}

/// Means of one update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Losses {
    /// Mean squared error of the decoded place (standardised units).
    pub reconstruction: f32,
    /// KL(q || rho), nats.
    pub kl: f32,
}

impl Shape {
    /// Shapes for a latent width and hidden layers. Two values without any hidden layer are the
    /// standardised place itself, which needs no network: the oracle of this stage.
    #[must_use]
    pub fn new(latent: usize, hidden: &[usize]) -> Self {
        let oracle = latent == PLACE && hidden.is_empty();
        let mlp = |inputs: usize, outputs: usize| {
            let sizes = [&[inputs], hidden, &[outputs]].concat();
            let sizes = if oracle { &[] } else { sizes.as_slice() };
            Mlp::new(sizes, Activation::Gelu, false)
        };
        Self {
            encoder: mlp(CONDITION + PLACE, 2 * latent),
            decoder: mlp(CONDITION + latent, PLACE),
            prior: mlp(CONDITION, 2 * latent),
            latent,
        }
    }

    /// Width of a latent.
    #[must_use]
    pub fn latent(&self) -> usize {
        self.latent
    }

    /// Length of the flat weights: mean and standard deviation of places (4), encoder, decoder,
    /// prior.
    #[must_use]
    pub fn weights(&self) -> usize {
        2 * PLACE + self.ends()[2]
    }

    fn is_oracle(&self) -> bool {
        self.encoder.parameters() == 0
    }

    fn ends(&self) -> [usize; 3] {
        let encoder = self.encoder.parameters();
        let decoder = encoder + self.decoder.parameters();
        [encoder, decoder, decoder + self.prior.parameters()]
    }
}

/// A trained encoder at work: places to latents and back.
#[derive(Clone)]
pub struct Encoder {
    shape: Shape,
    weights: Vec<f32>,
    encoder_workspace: Workspace,
    decoder_workspace: Workspace,
    input: Vec<f32>,
    output: Vec<f32>,
}

/// Rows handled at once.
const CHUNK: usize = 512;

impl Encoder {
    /// An encoder from flat weights; none when their number is wrong.
    #[must_use]
    pub fn new(shape: Shape, weights: &[f32]) -> Option<Self> {
        (weights.len() == shape.weights()).then(|| Self {
            encoder_workspace: shape.encoder.workspace(CHUNK),
            decoder_workspace: shape.decoder.workspace(CHUNK),
            input: vec![],
            output: vec![],
            weights: weights.to_vec(),
            shape,
        })
    }

    /// Width of a latent.
    #[must_use]
    pub fn latent(&self) -> usize {
        self.shape.latent
    }

    /// Codes of places, appended to `latents` (`[n, latent]`): the mean of q(z | null, s).
    pub fn encode(&mut self, places: impl Iterator<Item = [f32; 2]>, latents: &mut Vec<f32>) {
        let (norm, networks) = self.weights.split_at(2 * PLACE);
        if self.shape.is_oracle() {
            let standard = |place: [f32; 2], k: usize| (place[k] - norm[k]) / norm[PLACE + k];
            latents.extend(places.flat_map(|place| [0, 1].map(|k| standard(place, k))));
            return;
        }
        let parameters = &networks[..self.shape.ends()[0]];
        let mut places = places.peekable();
        while places.peek().is_some() {
            self.input.clear();
            for place in places.by_ref().take(CHUNK) {
                self.input.extend([0.0, 0.0, 1.0]);
                self.input
                    .extend((0..PLACE).map(|k| (place[k] - norm[k]) / norm[PLACE + k]));
            }
            let rows = self.input.len() / (CONDITION + PLACE);
            let workspace = &mut self.encoder_workspace;
            let out = self
                .shape
                .encoder
                .infer(parameters, &self.input, rows, workspace);
            for row in out.chunks_exact(2 * self.shape.latent).take(rows) {
                latents.extend_from_slice(&row[..self.shape.latent]);
            }
        }
    }

    /// The code of one place.
    pub fn encode_one(&mut self, place: [f32; 2]) -> &[f32] {
        let mut latent = std::mem::take(&mut self.output);
        latent.clear();
        self.encode(std::iter::once(place), &mut latent);
        self.output = latent;
        &self.output
    }

    /// Places (m) of latents `[n, latent]`, without a condition.
    pub fn decode(&mut self, latents: &[f32]) -> Vec<[f32; 2]> {
        let (norm, networks) = self.weights.split_at(2 * PLACE);
        if self.shape.is_oracle() {
            let place = |z: &[f32]| [0, 1].map(|k| z[k] * norm[PLACE + k] + norm[k]);
            return latents.chunks_exact(PLACE).map(place).collect();
        }
        let ends = self.shape.ends();
        let parameters = &networks[ends[0]..ends[1]];
        let mut places = vec![];
        for chunk in latents.chunks(CHUNK * self.shape.latent) {
            self.input.clear();
            for latent in chunk.chunks_exact(self.shape.latent) {
                self.input.extend([0.0, 0.0, 1.0]);
                self.input.extend_from_slice(latent);
            }
            let rows = chunk.len() / self.shape.latent;
            let workspace = &mut self.decoder_workspace;
            let out = self
                .shape
                .decoder
                .infer(parameters, &self.input, rows, workspace);
            for row in out.chunks_exact(PLACE).take(rows) {
                places.push(std::array::from_fn(|k| row[k] * norm[PLACE + k] + norm[k]));
            }
        }
        places
    }
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

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    fn settings() -> Settings {
        Settings {
            latent: 4,
            hidden: vec![32, 32],
            beta: 0.01,
            prior_balance: 0.8,
            null_condition: 0.5,
            learning_rate: 2e-3,
            batch: 128,
        }
    }

    #[test]
    fn a_training_goes_on_from_its_state_as_if_nothing_had_been() {
        let train = |vae: &mut Vae, rng: &mut Pcg64Mcg| {
            for _ in 0..3 {
                let pairs = pairs(rng, 16);
                vae.update(&pairs, rng);
            }
        };
        let fresh = |settings| {
            Vae::new(
                settings,
                [0.0; 2],
                [4.0; 2],
                &mut Pcg64Mcg::seed_from_u64(3),
            )
        };
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let mut vae = fresh(settings());
        train(&mut vae, &mut rng);
        let (state, at) = (vae.state(), rng.clone());
        train(&mut vae, &mut rng);
        let mut again = fresh(settings());
        assert!(again.restore(state.clone()));
        train(&mut again, &mut at.clone());
        assert_eq!(again.weights, vae.weights);
        let mut other = fresh(Settings {
            hidden: vec![8],
            ..settings()
        });
        assert!(!other.restore(state), "of other networks");
    }

    fn pairs(rng: &mut Pcg64Mcg, n: usize) -> Vec<([f32; 2], [f32; 2])> {
        (0..n)
            .map(|_| {
                let from = [rng.random_range(-8.0..8.0), rng.random_range(-8.0..8.0_f32)];
                (
                    from,
                    from.map(|axis| axis + rng.random_range(-2.0..2.0_f32)),
                )
            })
            .collect()
    }

    /// Without the KL's split between posterior and prior (kappa = 1/2 gives both half of it)
    /// the gradient is that of reconstruction + beta KL.
    #[test]
    fn the_oracles_latents_are_places() {
        let mut encoder = Encoder::new(Shape::new(2, &[]), &[1.0, 2.0, 2.0, 4.0]).unwrap();
        assert_eq!(encoder.encode_one([3.0, 10.0]), [1.0, 2.0]);
        assert_eq!(encoder.decode(&[1.0, 2.0]), [[3.0, 10.0]]);
    }

    #[test]
    fn gradient_matches_finite_differences() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let mut vae = Vae::new(settings(), [0.0; 2], [5.0; 2], &mut rng);
        vae.settings.prior_balance = 0.5;
        vae.settings.beta = 0.7;
        let pairs = pairs(&mut rng, 16);
        vae.scratch.null = vec![false; 16];
        vae.scratch.noise = (0..64).map(|_| rng.random_range(-1.0..1.0)).collect();
        vae.gradient.fill(0.0);
        vae.losses(&pairs);
        let gradient = vae.gradient.clone();
        let ends = vae.shape.ends();
        let objective = |vae: &mut Vae, kl: f32| {
            vae.gradient.fill(0.0);
            let losses = vae.losses(&pairs);
            f64::from(losses.reconstruction) + f64::from(kl * losses.kl)
        };
        // Posterior and prior see half of the KL, the decoder none.
        for (range, kl) in [
            (0..ends[0], 0.5 * 0.7),
            (ends[0]..ends[1], 0.0),
            (ends[1]..ends[2], 0.5 * 0.7),
        ] {
            let direction: Vec<f32> = range
                .clone()
                .map(|_| rng.random_range(-1.0..1.0_f32))
                .collect();
            let analytic: f64 = range
                .clone()
                .zip(&direction)
                .map(|(i, d)| f64::from(gradient[i]) * f64::from(*d))
                .sum();
            let step = 2e-3;
            let mut shifted = |sign: f32| {
                let before = vae.weights.clone();
                for (i, d) in range.clone().zip(&direction) {
                    vae.weights[2 * PLACE + i] += sign * step * d;
                }
                let value = objective(&mut vae, kl);
                vae.weights = before;
                value
            };
            let numeric = (shifted(1.0) - shifted(-1.0)) / f64::from(2.0 * step);
            let error = (numeric - analytic).abs() / analytic.abs().max(0.05);
            assert!(error < 0.03, "{range:?}: {analytic} against {numeric}");
        }
    }

    #[test]
    fn codes_of_places_decode_to_the_places() {
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut vae = Vae::new(settings(), [0.0; 2], [5.0; 2], &mut rng);
        for _ in 0..1500 {
            let batch = pairs(&mut rng, 128);
            vae.update(&batch, &mut rng);
        }
        let mut encoder = Encoder::new(vae.shape().clone(), &vae.weights).unwrap();
        let places: Vec<[f32; 2]> = pairs(&mut rng, 100).into_iter().map(|p| p.0).collect();
        let mut latents = vec![];
        encoder.encode(places.iter().copied(), &mut latents);
        let decoded = encoder.decode(&latents);
        let error = places
            .iter()
            .zip(&decoded)
            .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
            .sum::<f32>()
            / 100.0;
        assert!(error < 1.0, "mean error {error} m");
    }
}
