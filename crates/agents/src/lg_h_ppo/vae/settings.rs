//! `[encoder]`

use config::Table;

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
        } else if settings.null_condition == 0.0 {
            // The graph is made of codes that are taken with the null token.
            let message = "0 leaves the null token untrained, and all codes are taken with it; set \
                           it above 0, as to the default 0.5";
            t.fault("null_condition", message);
        }
        settings
    }

    /// Whether it is trained here.
    #[must_use]
    pub fn is_trained(&self) -> bool {
        self.kind == Latent::Vae && self.from.is_none()
    }
}
