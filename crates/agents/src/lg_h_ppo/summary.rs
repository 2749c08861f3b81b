//! What is shown of a run: labels, and what each stage came to.

use crate::summary::{Label, Lookup, Rate, Summary, listed};

const fn label(metric: &'static str, label: &'static str, decimals: usize) -> Label {
    Label {
        metric,
        label,
        decimals,
        rate: None,
    }
}

const fn with_rate(label: Label, metric: &'static str, unit: &'static str) -> Label {
    Label {
        rate: Some(Rate { metric, unit }),
        ..label
    }
}

pub(super) const LABELS: &[Label] = &[
    with_rate(
        label("low/policy_loss", "low policy loss", 3),
        "throughput/low_updates_per_s",
        "updates",
    ),
    label("low/value_loss", "low value loss", 4),
    label("high/value_loss", "high value loss", 4),
    with_rate(
        label("high/entropy_nats", "high entropy (nats)", 2),
        "throughput/high_steps_per_s",
        "steps",
    ),
    label("high/return", "high return", 2),
    label("high/kl", "high KL (nats)", 4),
    with_rate(
        label("encoder/reconstruction", "encoder loss", 4),
        "throughput/encoder_updates_per_s",
        "updates",
    ),
    label("encoder/kl_nats", "encoder KL (nats)", 2),
];

/// An error of a cell's size (m) says nothing of the place.
const WORTHLESS_ERROR: f64 = 4.0;

/// Newest values of metrics, as parts of a sentence.
struct Parts<'a>(Lookup<'a, f64>);

impl Parts<'_> {
    /// A metric in a phrase, where it was measured: its value stands for the braces.
    fn part(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 1.0, decimals)
    }

    /// The same of a share, in percent.
    fn percent(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 100.0, decimals)
    }

    fn scaled(&self, phrase: &str, name: &str, scale: f64, decimals: usize) -> Option<String> {
        let value = scale * (self.0)(name)?;
        let text = format!("{value:.decimals$}");
        // A value that rounds to nothing has no sign.
        let zero = text
            .trim_start_matches('-')
            .chars()
            .all(|c| "0.".contains(c));
        let text = if zero {
            text.trim_start_matches('-')
        } else {
            &text
        };
        value.is_finite().then(|| phrase.replace("{}", text))
    }
}

pub(super) fn summary(setting: Lookup<'_, String>, metric: Lookup<'_, f64>) -> Vec<Summary> {
    let is = |key: &str, value: &str| {
        setting(key).is_some_and(|text| text.trim_matches(['"', '\'']) == value)
    };
    let from =
        |key: &str| setting(key).is_some_and(|text| !text.trim_matches(['"', '\'']).is_empty());
    let walls = metric("graph/edges_through_walls")
        .zip(metric("graph/edges").filter(|edges| *edges > 0.0))
        .map(|(walls, edges)| 1.0 - walls / edges);
    let graph = [
        metric("graph/connected_share"),
        metric("graph/coverage"),
        walls,
    ];
    let parts = Parts(metric);
    let stage = |name, title, time: &str, text, quality: Option<f64>| Summary {
        name,
        title,
        seconds: metric(time).filter(|seconds| seconds.is_finite()),
        text,
        quality: quality.filter(|quality| !quality.is_nan()),
    };
    vec![
        stage(
            "encoder",
            "encoder",
            "time/encoder_s",
            encoder(&parts, is("encoder.kind", "place"), from("encoder.from")),
            metric("encoder/place_error_m").map(|error| 1.0 - error / WORTHLESS_ERROR),
        ),
        stage(
            "graph",
            "graph",
            "time/graph_s",
            graph_text(&parts),
            graph.into_iter().flatten().reduce(f64::min),
        ),
        stage(
            "low",
            "low level",
            "time/low_s",
            low(&parts, is("low.controller", "walker"), from("low.from")),
            metric("graph/edge_success"),
        ),
        stage(
            "high",
            "high level",
            "time/high_s",
            high(&parts, is("high.planner", "search")),
            metric("high/greedy_arrived"),
        ),
    ]
}

fn encoder(parts: &Parts<'_>, places: bool, given: bool) -> String {
    if places {
        return "latents are the places".to_owned();
    }
    if given {
        return "of another run".to_owned();
    }
    listed([
        parts.part("places come back within {} m", "encoder/place_error_m", 2),
        parts.part("reconstruction {}", "encoder/reconstruction", 4),
        parts.part("KL {} nats", "encoder/kl_nats", 2),
    ])
}

fn graph_text(parts: &Parts<'_>) -> String {
    let nodes = parts.part("{} nodes", "graph/nodes", 0);
    let connected = parts.percent(" ({}% of all, connected)", "graph/connected_share", 0);
    listed([
        nodes.map(|nodes| nodes + &connected.unwrap_or_default()),
        parts.part("{} edges", "graph/edges", 0),
        parts.part("{} through walls", "graph/edges_through_walls", 0),
        parts.percent("{}% of free cells covered", "graph/coverage", 0),
        parts.percent("{}% of tries reached", "graph/edge_success", 1),
    ])
}

fn low(parts: &Parts<'_>, walker: bool, given: bool) -> String {
    let policy = if walker {
        "the walker walks".to_owned()
    } else if given {
        "of another run".to_owned()
    } else {
        listed([
            parts.part("policy loss {}", "low/policy_loss", 3),
            parts.part("mean weight {}", "low/mean_weight", 2),
        ])
    };
    let walks = listed([
        parts.percent("{}% of neighbours reached", "graph/edge_success", 1),
        parts.part("in {} times the data's best time", "low/steps_over_best", 2),
    ]);
    joined([policy, walks])
}

fn high(parts: &Parts<'_>, search: bool) -> String {
    if search {
        return "a search plans".to_owned();
    }
    let learned = listed([
        parts.part("return {}", "high/return", 3),
        parts.part("entropy {} nats", "high/entropy_nats", 2),
        parts.part("clip fraction {}", "high/clip_fraction", 3),
        parts.part("KL {}", "high/kl", 4),
    ]);
    let paths = listed([
        parts.percent("greedy paths arrive in {}%", "high/greedy_arrived", 1),
        parts.part("{} times the cheapest cost", "high/path_over_cheapest", 2),
    ]);
    joined([learned, paths])
}

fn joined(parts: [String; 2]) -> String {
    let parts = parts.into_iter().filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_measured_is_left_out() {
        let text = |metrics: &[(&str, f64)]| {
            let metric = |name: &str| {
                let found = metrics.iter().find(|(known, _)| *known == name);
                found.map(|(_, value)| *value)
            };
            let lines = summary(&|_| None, &metric);
            let lines = lines
                .iter()
                .map(|stage| format!("{}: {}\n", stage.name, stage.text));
            lines.collect::<String>()
        };
        assert!(text(&[]).contains("high: \n"));
        let text = text(&[
            ("high/entropy_nats", 0.5),
            ("high/kl", -1e-9),
            ("graph/nodes", 20.0),
            ("low/policy_loss", f64::NAN),
        ]);
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
