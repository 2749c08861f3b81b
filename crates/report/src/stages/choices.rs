//! Which stages of a run learn, and which are given.

use std::collections::BTreeMap;

use config::{Config, Controller, Latent, Planner};

/// What each stage uses: learned or given.
pub struct Choices {
    pub(super) latent: Latent,
    pub(super) encoder_from: bool,
    pub(super) controller: Controller,
    pub(super) low_from: bool,
    pub(super) planner: Planner,
}

impl Choices {
    /// Of a config.
    pub(super) fn of(config: &Config) -> Self {
        Self {
            latent: config.encoder.kind,
            encoder_from: config.encoder.from.is_some(),
            controller: config.low.controller,
            low_from: config.low.from.is_some(),
            planner: config.high.planner,
        }
    }

    /// From values in TOML by `table.key`, of a run that another version of formica may have written.
    pub fn recorded(config: &BTreeMap<String, String>) -> Self {
        let is = |key: &str, value: &str| {
            let text = config.get(key);
            text.is_some_and(|text| text.trim_matches(['"', '\'']) == value)
        };
        Self {
            latent: match is("encoder.kind", "place") {
                true => Latent::Place,
                false => Latent::Vae,
            },
            encoder_from: config.contains_key("encoder.from"),
            controller: match is("low.controller", "walker") {
                true => Controller::Walker,
                false => Controller::Learned,
            },
            low_from: config.contains_key("low.from"),
            planner: match is("high.planner", "search") {
                true => Planner::Search,
                false => Planner::Learned,
            },
        }
    }
}
