//! The shapes of the three networks.

use nets::{Activation, Mlp};

/// Width of a place: x, y.
pub const PLACE: usize = 2;
/// Width of a condition: a standardised place and the null flag.
pub(super) const CONDITION: usize = PLACE + 1;

/// The three networks' shapes.
#[derive(Debug, Clone)]
pub struct Shape {
    pub(super) encoder: Mlp,
    pub(super) decoder: Mlp,
    pub(super) prior: Mlp,
    pub(super) latent: usize,
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

    pub(super) fn is_oracle(&self) -> bool {
        self.encoder.parameters() == 0
    }

    pub(super) fn ends(&self) -> [usize; 3] {
        let encoder = self.encoder.parameters();
        let decoder = encoder + self.decoder.parameters();
        [encoder, decoder, decoder + self.prior.parameters()]
    }
}
