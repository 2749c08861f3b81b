//! Charts of metrics over time.

use std::collections::BTreeSet;

use plot::chart::{Chart, Shape, legend_line};
use plot::markup::escaped;
use runs::seeds::SeedGroup;

use super::html::{Layout, absent, figure};
use crate::curves::{SCORE, chart};

/// Maximum number of charts of training, since a file can have any number of metrics.
const CHARTS: usize = 36;

/// Charts of throughput and lag: id of the figure, metric, title, axis, caption.
const MACHINERY: [(&str, &str, &str, &str, &str); 2] = [
    (
        "throughput",
        "throughput/steps_per_s",
        "Throughput",
        "control steps a second",
        "Control steps a second, of all actors together.",
    ),
    (
        "lag",
        "rollout/policy_lag",
        "Policy lag",
        "versions",
        "Policy lag: by how many versions the weights that trajectories were walked with were \
         behind the newest ones when they were learned from.",
    ),
];

/// Prefixes of the metrics of training, in the order of each algorithm's stages.
fn areas() -> Vec<String> {
    let mut areas = vec![];
    for algorithm in agents::ALGORITHMS {
        let labels = algorithm.labels();
        for stage in algorithm.summary(&|_| None, &|_| None) {
            let area = format!("{}/", stage.name);
            let known = labels.iter().any(|label| label.metric.starts_with(&area));
            if known && !areas.contains(&area) {
                areas.push(area);
            }
        }
    }
    areas
}

/// Most rows of a metric in any run.
fn rows(groups: &[SeedGroup], metric: &str) -> usize {
    let runs = groups.iter().flat_map(|group| &group.runs);
    runs.map(|run| run.rows(metric).len()).max().unwrap_or(0)
}

/// A figure with one image for screens and one for phones.
fn either(id: &str, chart: &Chart, caption: &str) -> String {
    let pictures = [Shape::Wide, Shape::Narrow].map(|shape| chart.svg(shape));
    figure(id, Layout::Either, &pictures, caption)
}

/// How lines show the runs of a group, for a caption.
fn spread_caption(groups: &[SeedGroup]) -> &'static str {
    match groups.iter().any(|group| group.runs.len() > 1) {
        true => {
            " Bold: the mean over a group's seeds; band: one standard deviation; thin: each run."
        }
        false => "",
    }
}

/// Test episodes during training.
pub(super) fn learning(groups: &[SeedGroup]) -> String {
    if rows(groups, SCORE) == 0 {
        return absent(&format!(
            "No test episode was walked in training: no row of {SCORE} in metrics.csv."
        ));
    }
    let caption = format!(
        "<b>Figure 1.</b> Learning curves: test episodes in training that reached the goal.{} \
         Dots: scores of the final evaluation.",
        spread_caption(groups)
    );
    either("curves", &chart(groups, SCORE), &caption)
}

/// Throughput and lag.
pub(super) fn machinery(groups: &[SeedGroup]) -> String {
    let mut body = String::new();
    for (id, metric, title, axis, caption) in MACHINERY {
        if rows(groups, metric) == 0 {
            body += &absent(&format!("{title}: no row of {metric} in metrics.csv."));
            continue;
        }
        let mut chart = chart(groups, metric);
        title.clone_into(&mut chart.title);
        axis.clone_into(&mut chart.y_label);
        // From zero, so that heights can be compared.
        let values = chart.series.iter().flat_map(|series| &series.bold);
        let most = values.map(|[_, y]| *y).fold(1.0, f64::max);
        chart.y_range = Some([0.0, most]);
        body += &either(id, &chart, caption);
    }
    body
}

/// Small charts of losses and other metrics of training.
pub(super) fn training(groups: &[SeedGroup]) -> String {
    let areas = areas();
    let runs = groups.iter().flat_map(|group| &group.runs);
    let names: BTreeSet<&str> = runs
        .flat_map(|run| run.metrics.keys().map(String::as_str))
        .filter(|name| areas.iter().any(|area| name.starts_with(area)))
        // Two values are not a curve.
        .filter(|name| rows(groups, name) > 2)
        .collect();
    if names.is_empty() {
        return absent("Nothing was trained yet: no losses in metrics.csv.");
    }
    // In the order of the stages.
    let ordered = areas.iter().flat_map(|area| {
        let names = names.iter().copied();
        names.filter(move |name| name.starts_with(area))
    });
    let ordered: Vec<&str> = ordered.collect();
    let pictures: Vec<String> = ordered
        .iter()
        .take(CHARTS)
        .map(|name| {
            let chart = chart(groups, name);
            let small = Chart {
                title: (*name).to_owned(),
                subtitle: String::new(),
                y_label: String::new(),
                x_label: "minutes".to_owned(),
                ..chart
            };
            small.svg(Shape::Small)
        })
        .collect();
    let mut legend = String::new();
    if groups.len() > 1 {
        for (i, group) in groups.iter().enumerate() {
            legend += &format!("<li>{}{}</li>\n", legend_line(i), escaped(&group.label));
        }
        legend = format!("<ul class=\"legend\">\n{legend}</ul>\n");
    }
    let mut caption = format!(
        "Losses and other measures of training over the minutes since the start.{}",
        spread_caption(groups)
    );
    if ordered.len() > CHARTS {
        caption += &format!(" {} more are left out.", ordered.len() - CHARTS);
    }
    let runs = groups.iter().flat_map(|group| &group.runs);
    let metrics = runs.flat_map(|run| run.metrics.values());
    let strays: usize = metrics.map(|metric| metric.left_out).sum();
    if strays > 0 {
        caption += &format!(" {strays} values that are no number to draw are left out.");
    }
    legend + &figure("losses", Layout::Many, &pictures, &caption)
}
