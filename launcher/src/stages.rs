//! What each stage is worth and what it took, at the end of a run: so that a low score can be
//! traced to its cause.

mod told;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use config::{Config, Controller, Latent, Planner};
use maze::CELL_SIZE;
use serde::{Deserialize, Serialize};

pub(crate) use told::stages;

use crate::figure::figure;

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

/// What each stage is worth, from 0 to 1, as far as it was measured.
fn qualities(newest: &Newest) -> Vec<(&'static str, f64)> {
    let get = |name: &str| newest.get(name).copied();
    let walls = get("graph/edges_through_walls")
        .zip(get("graph/edges").filter(|edges| *edges > 0.0))
        .map(|(walls, edges)| 1.0 - walls / edges);
    let graph = [get("graph/connected_share"), get("graph/coverage"), walls];
    [
        // An error of a cell's size tells nothing of the place.
        (
            "encoder",
            get("encoder/place_error_m").map(|error| 1.0 - error / f64::from(CELL_SIZE)),
        ),
        ("graph", graph.into_iter().flatten().reduce(f64::min)),
        ("low", get("graph/edge_success")),
        ("high", get("high/greedy_arrived")),
    ]
    .into_iter()
    .filter_map(|(stage, quality)| Some((stage, quality?.clamp(0.0, 1.0))))
    .filter(|(_, quality)| !quality.is_nan())
    .collect()
}

/// The stage that holds a run back the most, in a line; none where nothing was measured, or
/// nothing is amiss.
pub(crate) fn weakest(newest: &Newest) -> Option<String> {
    let qualities = qualities(newest);
    let (stage, quality) = qualities.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let percent = figure(100.0 * quality, 0).filter(|_| *quality < 0.995)?;
    Some(format!(
        "the weakest stage is {stage}, at {percent}% of what it could be worth; stages.json has all"
    ))
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
        "quality": qualities(newest).into_iter().collect::<BTreeMap<_, _>>(),
        "metrics": newest,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weakest_stage_is_named_with_what_it_is_worth() {
        let mut newest = Newest::new();
        assert_eq!(weakest(&newest), None, "nothing was measured");
        newest.insert("graph/coverage".to_owned(), 1.0);
        assert_eq!(weakest(&newest), None, "nothing is amiss");
        newest.insert("encoder/place_error_m".to_owned(), 400.0);
        newest.insert("graph/edge_success".to_owned(), 0.337);
        newest.insert("high/greedy_arrived".to_owned(), f64::NAN);
        let told = weakest(&newest).unwrap();
        assert!(
            told.starts_with("the weakest stage is encoder, at 0% of"),
            "{told}"
        );
        newest.insert("encoder/place_error_m".to_owned(), 0.1);
        let told = weakest(&newest).unwrap();
        assert!(told.contains("stage is low, at 34% of"), "{told}");
        let quality = &json(&newest, &Times::default())["quality"];
        assert_eq!(quality["low"], 0.337);
        assert!(quality.get("high").is_none());
    }

    #[test]
    fn what_was_not_measured_is_left_out() {
        let mut newest = Newest::new();
        let choices = Choices::recorded(&BTreeMap::new());
        let told = |newest: &Newest| {
            let stages = stages(&choices, newest, &Times::default());
            let lines = stages
                .iter()
                .map(|stage| format!("{}: {}\n", stage.name, stage.told));
            lines.collect::<String>()
        };
        let bare = told(&newest);
        assert!(bare.contains("high: not measured\n"), "{bare}");
        for (name, value) in [
            ("high/entropy_nats", 0.5),
            ("high/kl", -1e-9),
            ("graph/nodes", 20.0),
        ] {
            newest.insert(name.to_owned(), value);
        }
        let told = told(&newest);
        assert!(
            told.contains("high: entropy 0.50 nats, KL 0.0000\n"),
            "{told}"
        );
        assert!(told.contains("graph: 20 nodes\n"), "{told}");
        for odd in ["NaN", "inf", " -", ", ,"] {
            assert!(!told.contains(odd), "{odd} in {told}");
        }
    }
}
