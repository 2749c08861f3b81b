//! What each stage is worth and what it took, at the end of a run: so that a low score can be
//! traced to its cause.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use config::{Config, Controller, Latent, Planner};
use serde::{Deserialize, Serialize};

/// Wall-clock time of a run's parts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Times {
    /// Making the data set; zero where it was there.
    pub(crate) collect: Duration,
    /// From the first process to the last weights.
    pub(crate) train: Duration,
    /// Rollouts after that, or rounds.
    pub(crate) rollouts: Duration,
    pub(crate) evaluate: Duration,
}

/// Newest value of each metric, by name.
pub(crate) type Newest = BTreeMap<String, f64>;

/// Who does the work of the stages.
pub(crate) struct Choices {
    latent: Latent,
    encoder_from: bool,
    controller: Controller,
    low_from: bool,
    planner: Planner,
}

impl Choices {
    fn of(config: &Config) -> Self {
        Self {
            latent: config.encoder.kind,
            encoder_from: config.encoder.from.is_some(),
            controller: config.low.controller,
            low_from: config.low.from.is_some(),
            planner: config.high.planner,
        }
    }

    /// Of a run that another version of formica may have made: by `table.key`, in TOML.
    pub(crate) fn recorded(config: &BTreeMap<String, String>) -> Self {
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

/// What is told of a stage.
pub(crate) struct Stage {
    pub(crate) name: &'static str,
    /// What it took, where that is known (s).
    pub(crate) seconds: Option<f64>,
    pub(crate) told: String,
}

/// A line for each stage.
pub(crate) fn table(config: &Config, newest: &Newest, times: &Times) -> String {
    let mut text = String::new();
    for stage in stages(&Choices::of(config), newest, times) {
        let seconds = match stage.seconds {
            Some(seconds) => format!("{seconds:.0} s"),
            None => "-".to_owned(),
        };
        let _ = writeln!(text, "{:<9}{seconds:>8}  {}", stage.name, stage.told);
    }
    text.trim_end().to_owned()
}

/// Every stage, and all of them together.
pub(crate) fn stages(choices: &Choices, newest: &Newest, times: &Times) -> Vec<Stage> {
    let get = |name: &str| newest.get(name).copied().unwrap_or(f64::NAN);
    let percent = |name: &str| 100.0 * get(name);
    let mut stages = vec![];
    let mut line = |name: &'static str, seconds: f64, told: String| {
        let seconds = Some(seconds).filter(|seconds| seconds.is_finite());
        // What was not measured is no number.
        let told = told.replace("NaN", "-");
        stages.push(Stage {
            name,
            seconds,
            told,
        });
    };
    line(
        "data",
        times.collect.as_secs_f64(),
        format!(
            "{} rows in {} episodes, {:.1}% of which go from the start's cell to the goal's",
            get("data/rows"),
            get("data/episodes"),
            percent("data/start_to_goal"),
        ),
    );
    let encoder = match choices.latent {
        Latent::Place => "latents are the places".to_owned(),
        Latent::Vae if choices.encoder_from => "of another run".to_owned(),
        Latent::Vae => format!(
            "places come back within {:.2} m, reconstruction {:.4}, KL {:.2} nats",
            get("encoder/place_error_m"),
            get("encoder/reconstruction"),
            get("encoder/kl_nats"),
        ),
    };
    line("encoder", get("time/encoder_s"), encoder);
    line(
        "graph",
        get("time/graph_s"),
        format!(
            "{} nodes ({:.0}% of all, connected), {} edges, {} through walls, {:.0}% of free \
             cells covered, {:.1}% of tries reached",
            get("graph/nodes"),
            percent("graph/connected_share"),
            get("graph/edges"),
            get("graph/edges_through_walls"),
            percent("graph/coverage"),
            percent("graph/edge_success"),
        ),
    );
    let low = match choices.controller {
        Controller::Walker => "the walker walks; ".to_owned(),
        Controller::Learned if choices.low_from => "of another run; ".to_owned(),
        Controller::Learned => format!(
            "policy loss {:.3}, mean weight {:.2}; ",
            get("low/policy_loss"),
            get("low/mean_weight")
        ),
    };
    let over = get("low/steps_over_best");
    let reached = percent("graph/edge_success");
    line(
        "low",
        get("time/low_s"),
        format!(
            "{low}{reached:.1}% of neighbours reached, in {over:.2} times the data's best time"
        ),
    );
    let high = match choices.planner {
        Planner::Search => "a search plans".to_owned(),
        Planner::Learned => format!(
            "return {:.3}, entropy {:.2} nats, clip fraction {:.3}, KL {:.4}; greedy paths \
             arrive in {:.1}%, {:.2} times the cheapest cost",
            get("high/return"),
            get("high/entropy_nats"),
            get("high/clip_fraction"),
            get("high/kl"),
            percent("high/greedy_arrived"),
            get("high/path_over_cheapest"),
        ),
    };
    line("high", get("time/high_s"), high);
    let Times {
        train,
        rollouts,
        evaluate,
        collect,
    } = times;
    let all = *collect + *train + *rollouts + *evaluate;
    line(
        "time",
        all.as_secs_f64(),
        format!(
            "{:.0} s until trained, {:.0} s of rollouts, {:.0} s of evaluation",
            train.as_secs_f64(),
            rollouts.as_secs_f64(),
            evaluate.as_secs_f64()
        ),
    );
    stages
}

/// The same for programs.
pub(crate) fn json(newest: &Newest, times: &Times) -> serde_json::Value {
    serde_json::json!({
        "seconds": {
            "collect": times.collect.as_secs_f64(),
            "train": times.train.as_secs_f64(),
            "rollouts": times.rollouts.as_secs_f64(),
            "evaluate": times.evaluate.as_secs_f64(),
        },
        "metrics": newest,
    })
}
