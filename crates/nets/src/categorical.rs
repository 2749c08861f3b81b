//! Softmax over an allowed subset of logits: all others count as minus infinity.

use rand::{Rng, RngExt};

/// The distribution over `allowed` actions; positions below are positions in `allowed`.
#[derive(Debug, Clone)]
pub struct Masked<'a> {
    allowed: &'a [usize],
    log_probs: Vec<f32>,
}

impl<'a> Masked<'a> {
    /// None when nothing is allowed, an index lies beyond the logits, or a logit is not finite.
    #[must_use]
    pub fn new(logits: &[f32], allowed: &'a [usize]) -> Option<Self> {
        let mut log_probs = Vec::with_capacity(allowed.len());
        for &action in allowed {
            log_probs.push(*logits.get(action).filter(|logit| logit.is_finite())?);
        }
        let max = log_probs.iter().copied().reduce(f32::max)?;
        let sum: f32 = log_probs.iter().map(|logit| (logit - max).exp()).sum();
        let normaliser = max + sum.ln();
        log_probs.iter_mut().for_each(|logit| *logit -= normaliser);
        Some(Self { allowed, log_probs })
    }

    /// Log-probability of an allowed action.
    #[must_use]
    pub fn log_prob(&self, position: usize) -> f32 {
        self.log_probs[position]
    }

    /// Probabilities of the allowed actions.
    pub fn probabilities(&self) -> impl Iterator<Item = f32> + '_ {
        self.log_probs.iter().map(|log_prob| log_prob.exp())
    }

    /// Draws a position.
    pub fn sample(&self, rng: &mut impl Rng) -> usize {
        let mut left: f32 = rng.random();
        for (position, probability) in self.probabilities().enumerate() {
            left -= probability;
            if left < 0.0 {
                return position;
            }
        }
        self.best()
    }

    /// The most likely position.
    #[must_use]
    pub fn best(&self) -> usize {
        let mut best = 0;
        for (position, log_prob) in self.log_probs.iter().enumerate() {
            if *log_prob > self.log_probs[best] {
                best = position;
            }
        }
        best
    }

    /// Entropy (nats).
    #[must_use]
    pub fn entropy(&self) -> f32 {
        -self.log_probs.iter().map(|l| l.exp() * l).sum::<f32>()
    }

    /// Adds the gradient of `log_weight * log p(position) + entropy_weight * entropy` in the
    /// logits.
    pub fn add_gradient(
        &self,
        position: usize,
        log_weight: f32,
        entropy_weight: f32,
        gradient: &mut [f32],
    ) {
        let entropy = self.entropy();
        for (i, (&action, log_prob)) in self.allowed.iter().zip(&self.log_probs).enumerate() {
            let p = log_prob.exp();
            let picked = if i == position { 1.0 } else { 0.0 };
            gradient[action] +=
                log_weight * (picked - p) - entropy_weight * p * (log_prob + entropy);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn gradient_matches_finite_differences() {
        let logits = [0.3, -1.2, 2.0, 0.7, 5.0];
        let allowed = [0, 2, 3];
        let objective = |logits: &[f32]| {
            let m = Masked::new(logits, &allowed).unwrap();
            0.8 * m.log_prob(1) + 0.3 * m.entropy()
        };
        let mut gradient = [0.0; 5];
        Masked::new(&logits, &allowed)
            .unwrap()
            .add_gradient(1, 0.8, 0.3, &mut gradient);
        for i in 0..5 {
            let (mut up, mut down) = (logits, logits);
            up[i] += 1e-2;
            down[i] -= 1e-2;
            let numeric = (objective(&up) - objective(&down)) / 2e-2;
            assert!(
                (numeric - gradient[i]).abs() < 1e-3,
                "{i}: {numeric} {}",
                gradient[i]
            );
        }
    }

    #[test]
    fn only_allowed_actions_are_drawn_and_in_proportion() {
        let logits = [9.0, 0.0, 3.0_f32.ln(), 9.0];
        let allowed = [1, 2];
        let m = Masked::new(&logits, &allowed).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let seconds = (0..4000).filter(|_| m.sample(&mut rng) == 1).count();
        assert!((2850..3150).contains(&seconds), "{seconds}");
        assert_eq!(m.best(), 1);
    }

    #[test]
    fn one_allowed_action_is_certain_and_none_is_refused() {
        let m = Masked::new(&[-500.0, 3.0], &[0]).unwrap();
        assert_eq!((m.log_prob(0), m.entropy()), (0.0, 0.0));
        assert!(Masked::new(&[1.0], &[]).is_none());
        assert!(Masked::new(&[1.0], &[1]).is_none());
        assert!(Masked::new(&[f32::NAN], &[0]).is_none());
    }
}
