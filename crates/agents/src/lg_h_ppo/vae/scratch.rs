//! What an update of the VAE computes outside of the networks.

use super::shape::{CONDITION, PLACE};

const LOG_STD: std::ops::RangeInclusive<f32> = -5.0..=2.0;

/// Inputs of the networks and gradients of their outputs, a row for each pair of places.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) conditions: Vec<f32>,
    pub(super) targets: Vec<f32>,
    pub(super) encoder_input: Vec<f32>,
    pub(super) decoder_input: Vec<f32>,
    pub(super) noise: Vec<f32>,
    pub(super) null: Vec<bool>,
    pub(super) posterior_gradient: Vec<f32>,
    pub(super) prior_gradient: Vec<f32>,
    pub(super) place_gradient: Vec<f32>,
    pub(super) decoder_input_gradient: Vec<f32>,
}

impl Scratch {
    /// Sets conditions, targets and the encoder's input; `norm` is mean and standard deviation of places.
    pub(super) fn begin(&mut self, pairs: &[([f32; 2], [f32; 2])], norm: &[f32]) {
        let standard = |place: [f32; 2]| [0, 1].map(|k| (place[k] - norm[k]) / norm[PLACE + k]);
        self.conditions.clear();
        self.targets.clear();
        self.encoder_input.clear();
        for (&(from, to), &null) in pairs.iter().zip(&self.null) {
            let [x, y] = standard(from);
            let condition = if null { [0.0, 0.0, 1.0] } else { [x, y, 0.0] };
            self.conditions.extend(condition);
            self.encoder_input.extend(condition);
            self.encoder_input.extend(standard(to));
            self.targets.extend(standard(to));
        }
    }

    /// Sets the decoder's input: conditions, and latents of width `dz` drawn from the posterior with the noise.
    pub(super) fn draw_latents(&mut self, posterior: &[f32], dz: usize) {
        let s = self;
        s.decoder_input.clear();
        for row in 0..s.null.len() {
            s.decoder_input
                .extend_from_slice(&s.conditions[row * CONDITION..(row + 1) * CONDITION]);
            let q = &posterior[row * 2 * dz..(row + 1) * 2 * dz];
            s.decoder_input
                .extend((0..dz).map(|k| q[k] + clamp(q[dz + k]).exp() * s.noise[row * dz + k]));
        }
    }

    /// Mean squared error of the decoded places; sets their gradient.
    pub(super) fn reconstruction(&mut self, decoded: &[f32]) -> f32 {
        let n = self.null.len();
        let scale = 1.0 / n as f32;
        let mut loss = 0.0;
        self.place_gradient.clear();
        for (value, target) in decoded.iter().zip(&self.targets).take(n * PLACE) {
            let error = value - target;
            loss += scale * error * error;
            self.place_gradient.push(2.0 * scale * error);
        }
        loss
    }

    /// KL(q || rho) of posterior and prior; sets the gradients of both. `balance` is the weight of the KL and
    /// the share of it that trains the prior.
    pub(super) fn divergence(
        &mut self,
        posterior: &[f32],
        rho: &[f32],
        dz: usize,
        balance: [f32; 2],
    ) -> f32 {
        let s = self;
        let n = s.null.len();
        let scale = 1.0 / n as f32;
        let mut kl = 0.0;
        s.posterior_gradient.clear();
        s.posterior_gradient.resize(n * 2 * dz, 0.0);
        s.prior_gradient.clear();
        s.prior_gradient.resize(n * 2 * dz, 0.0);
        let [beta, kappa] = [balance[0] * scale, balance[1]];
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
                kl += scale * (l2 - l1 + (v1 + gap * gap) / (2.0 * v2) - 0.5);
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
        kl
    }
}

fn clamp(log_std: f32) -> f32 {
    log_std.clamp(*LOG_STD.start(), *LOG_STD.end())
}
