//! What each stage achieved, in a sentence. What was not measured is left out.

use config::{Controller, Latent, Planner};
use plot::number::{fixed, listed};
use runs::metrics::Newest;
use runs::times::Times;

use super::choices::Choices;

/// A stage of a run.
pub struct Stage {
    /// Its name.
    pub name: &'static str,
    /// Time that it took, if known (s).
    pub seconds: Option<f64>,
    /// What it achieved.
    pub text: String,
}

/// Newest values of metrics, as parts of a sentence.
struct Phrases<'n>(&'n Newest);

impl Phrases<'_> {
    /// A phrase with the value of a metric in place of `{}`; `None` if it was not measured.
    fn part(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 1.0, decimals)
    }

    /// The same for a share, in percent.
    fn percent(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 100.0, decimals)
    }

    fn scaled(&self, phrase: &str, name: &str, scale: f64, decimals: usize) -> Option<String> {
        let value = self.0.get(name)?;
        Some(phrase.replace("{}", &fixed(scale * value, decimals)?))
    }
}

/// All stages, and the whole run as the last one.
pub fn stages(choices: &Choices, newest: &Newest, times: &Times) -> Vec<Stage> {
    let phrases = Phrases(newest);
    let seconds = |name: &str| newest.get(name).copied();
    let collect = times.collect.as_secs_f64();
    let all = times.collect + times.train + times.rollouts + times.evaluate;
    [
        ("data", Some(collect), data(&phrases)),
        (
            "encoder",
            seconds("time/encoder_s"),
            encoder(choices, &phrases),
        ),
        ("graph", seconds("time/graph_s"), graph(&phrases)),
        ("low", seconds("time/low_s"), low(choices, &phrases)),
        ("high", seconds("time/high_s"), high(choices, &phrases)),
        ("time", Some(all.as_secs_f64()), time(times)),
    ]
    .into_iter()
    .map(|(name, seconds, text)| Stage {
        name,
        seconds: seconds.filter(|seconds| seconds.is_finite()),
        text: match text.is_empty() {
            true => "not measured".to_owned(),
            false => text,
        },
    })
    .collect()
}

fn data(phrases: &Phrases) -> String {
    let rows = phrases.part("{} rows", "data/rows", 0);
    let episodes = phrases.part(" in {} episodes", "data/episodes", 0);
    let rows = rows.map(|rows| rows + &episodes.unwrap_or_default());
    let phrase = "{}% of the episodes go from the start's cell to the goal's";
    listed([rows, phrases.percent(phrase, "data/start_to_goal", 1)])
}

fn encoder(choices: &Choices, phrases: &Phrases) -> String {
    match choices.latent {
        Latent::Place => "latents are the places".to_owned(),
        Latent::Vae if choices.encoder_from => "of another run".to_owned(),
        Latent::Vae => listed([
            phrases.part("places come back within {} m", "encoder/place_error_m", 2),
            phrases.part("reconstruction {}", "encoder/reconstruction", 4),
            phrases.part("KL {} nats", "encoder/kl_nats", 2),
        ]),
    }
}

fn graph(phrases: &Phrases) -> String {
    let nodes = phrases.part("{} nodes", "graph/nodes", 0);
    let connected = phrases.percent(" ({}% of all, connected)", "graph/connected_share", 0);
    listed([
        nodes.map(|nodes| nodes + &connected.unwrap_or_default()),
        phrases.part("{} edges", "graph/edges", 0),
        phrases.part("{} through walls", "graph/edges_through_walls", 0),
        phrases.percent("{}% of free cells covered", "graph/coverage", 0),
        phrases.percent("{}% of tries reached", "graph/edge_success", 1),
    ])
}

fn low(choices: &Choices, phrases: &Phrases) -> String {
    let policy = match choices.controller {
        Controller::Walker => "the walker walks".to_owned(),
        Controller::Learned if choices.low_from => "of another run".to_owned(),
        Controller::Learned => listed([
            phrases.part("policy loss {}", "low/policy_loss", 3),
            phrases.part("mean weight {}", "low/mean_weight", 2),
        ]),
    };
    let walks = listed([
        phrases.percent("{}% of neighbours reached", "graph/edge_success", 1),
        phrases.part("in {} times the data's best time", "low/steps_over_best", 2),
    ]);
    let parts = [policy, walks].into_iter().filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("; ")
}

fn high(choices: &Choices, phrases: &Phrases) -> String {
    if choices.planner == Planner::Search {
        return "a search plans".to_owned();
    }
    let learned = listed([
        phrases.part("return {}", "high/return", 3),
        phrases.part("entropy {} nats", "high/entropy_nats", 2),
        phrases.part("clip fraction {}", "high/clip_fraction", 3),
        phrases.part("KL {}", "high/kl", 4),
    ]);
    let paths = listed([
        phrases.percent("greedy paths arrive in {}%", "high/greedy_arrived", 1),
        phrases.part("{} times the cheapest cost", "high/path_over_cheapest", 2),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_measured_is_left_out() {
        let mut newest = Newest::new();
        let choices = Choices::recorded(&std::collections::BTreeMap::new());
        let text = |newest: &Newest| {
            let stages = stages(&choices, newest, &Times::default());
            let lines = stages
                .iter()
                .map(|stage| format!("{}: {}\n", stage.name, stage.text));
            lines.collect::<String>()
        };
        let bare = text(&newest);
        assert!(bare.contains("high: not measured\n"), "{bare}");
        for (name, value) in [
            ("high/entropy_nats", 0.5),
            ("high/kl", -1e-9),
            ("graph/nodes", 20.0),
        ] {
            newest.insert(name.to_owned(), value);
        }
        let text = text(&newest);
        assert!(
            text.contains("high: entropy 0.50 nats, KL 0.0000\n"),
            "{text}"
        );
        assert!(text.contains("graph: 20 nodes\n"), "{text}");
        for odd in ["NaN", "inf", " -", ", ,"] {
            assert!(!text.contains(odd), "{odd} in {text}");
        }
    }
}
