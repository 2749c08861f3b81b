//! The stages in words. What was not measured is left out.

use config::{Controller, Latent, Planner};

use super::{Choices, Newest, Stage, Times};
use crate::figure::{figure, listed};

/// Newest values of metrics, as parts of a sentence.
struct Told<'n>(&'n Newest);

impl Told<'_> {
    /// A metric in a phrase, where it was measured: its value stands for the braces.
    fn part(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 1.0, decimals)
    }

    /// The same of a share, in percent.
    fn percent(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 100.0, decimals)
    }

    fn scaled(&self, phrase: &str, name: &str, scale: f64, decimals: usize) -> Option<String> {
        let value = self.0.get(name)?;
        Some(phrase.replace("{}", &figure(scale * value, decimals)?))
    }
}

/// Every stage, and all of them together.
pub(crate) fn stages(choices: &Choices, newest: &Newest, times: &Times) -> Vec<Stage> {
    let told = Told(newest);
    let took = |name: &str| newest.get(name).copied();
    let collect = times.collect.as_secs_f64();
    let all = times.collect + times.train + times.rollouts + times.evaluate;
    [
        ("data", Some(collect), data(&told)),
        ("encoder", took("time/encoder_s"), encoder(choices, &told)),
        ("graph", took("time/graph_s"), graph(&told)),
        ("low", took("time/low_s"), low(choices, &told)),
        ("high", took("time/high_s"), high(choices, &told)),
        ("time", Some(all.as_secs_f64()), time(times)),
    ]
    .into_iter()
    .map(|(name, seconds, told)| Stage {
        name,
        seconds: seconds.filter(|seconds| seconds.is_finite()),
        told: match told.is_empty() {
            true => "not measured".to_owned(),
            false => told,
        },
    })
    .collect()
}

fn data(told: &Told) -> String {
    let rows = told.part("{} rows", "data/rows", 0);
    let episodes = told.part(" in {} episodes", "data/episodes", 0);
    let rows = rows.map(|rows| rows + &episodes.unwrap_or_default());
    let phrase = "{}% of the episodes go from the start's cell to the goal's";
    listed([rows, told.percent(phrase, "data/start_to_goal", 1)])
}

fn encoder(choices: &Choices, told: &Told) -> String {
    match choices.latent {
        Latent::Place => "latents are the places".to_owned(),
        Latent::Vae if choices.encoder_from => "of another run".to_owned(),
        Latent::Vae => listed([
            told.part("places come back within {} m", "encoder/place_error_m", 2),
            told.part("reconstruction {}", "encoder/reconstruction", 4),
            told.part("KL {} nats", "encoder/kl_nats", 2),
        ]),
    }
}

fn graph(told: &Told) -> String {
    let nodes = told.part("{} nodes", "graph/nodes", 0);
    let connected = told.percent(" ({}% of all, connected)", "graph/connected_share", 0);
    listed([
        nodes.map(|nodes| nodes + &connected.unwrap_or_default()),
        told.part("{} edges", "graph/edges", 0),
        told.part("{} through walls", "graph/edges_through_walls", 0),
        told.percent("{}% of free cells covered", "graph/coverage", 0),
        told.percent("{}% of tries reached", "graph/edge_success", 1),
    ])
}

fn low(choices: &Choices, told: &Told) -> String {
    let policy = match choices.controller {
        Controller::Walker => "the walker walks".to_owned(),
        Controller::Learned if choices.low_from => "of another run".to_owned(),
        Controller::Learned => listed([
            told.part("policy loss {}", "low/policy_loss", 3),
            told.part("mean weight {}", "low/mean_weight", 2),
        ]),
    };
    let walks = listed([
        told.percent("{}% of neighbours reached", "graph/edge_success", 1),
        told.part("in {} times the data's best time", "low/steps_over_best", 2),
    ]);
    let parts = [policy, walks].into_iter().filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("; ")
}

fn high(choices: &Choices, told: &Told) -> String {
    if choices.planner == Planner::Search {
        return "a search plans".to_owned();
    }
    let learned = listed([
        told.part("return {}", "high/return", 3),
        told.part("entropy {} nats", "high/entropy_nats", 2),
        told.part("clip fraction {}", "high/clip_fraction", 3),
        told.part("KL {}", "high/kl", 4),
    ]);
    let paths = listed([
        told.percent("greedy paths arrive in {}%", "high/greedy_arrived", 1),
        told.part("{} times the cheapest cost", "high/path_over_cheapest", 2),
    ]);
    let parts = [learned, paths].into_iter().filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("; ")
}

fn time(times: &Times) -> String {
    format!(
        "{:.0} s until trained, {:.0} s of rollouts, {:.0} s of evaluation",
        times.train.as_secs_f64(),
        times.rollouts.as_secs_f64(),
        times.evaluate.as_secs_f64()
    )
}
