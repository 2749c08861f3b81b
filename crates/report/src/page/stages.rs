//! What each stage achieved and how long it took, read from `stages.json`.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use plot::markup::{escaped, text};
use runs::file;
use runs::metrics::Newest;
use runs::read::Recorded;
use runs::seeds::SeedGroup;
use runs::times::Times;
use serde::Deserialize;

use super::html::{Column, Layout, Row, absent, figure, folded, table};
use crate::stages::{Stage, stages};

/// Number of runs whose tables are open.
const OPEN: usize = 1;

/// `stages.json`.
#[derive(Debug, Deserialize)]
struct Written {
    metrics: Newest,
    seconds: Seconds,
}

/// Seconds of each part of a run.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Seconds {
    collect: f64,
    train: f64,
    rollouts: f64,
    evaluate: f64,
}

impl Seconds {
    fn times(&self) -> Times {
        let time = |seconds| Duration::try_from_secs_f64(seconds).unwrap_or_default();
        Times {
            collect: time(self.collect),
            train: time(self.train),
            rollouts: time(self.rollouts),
            evaluate: time(self.evaluate),
        }
    }
}

fn read(folder: &Path) -> anyhow::Result<Option<Written>> {
    let path = folder.join("stages.json");
    let Some(bytes) = file::read(&path)? else {
        return Ok(None);
    };
    let written = serde_json::from_slice(&bytes).map_err(|error| {
        let (path, line) = (path.display(), error.line());
        anyhow::anyhow!("{path}:{line}: {error}; give the one that a run wrote")
    })?;
    Ok(Some(written))
}

/// A table for each run, and a bar chart of times for the first.
pub(super) fn section(groups: &[SeedGroup]) -> anyhow::Result<String> {
    let runs: Vec<&Recorded> = groups.iter().flat_map(|group| &group.runs).collect();
    let (mut body, mut waiting, mut pictures) = (String::new(), vec![], vec![]);
    let mut shown = 0;
    for run in &runs {
        let Some(written) = read(&run.folder)? else {
            waiting.push(run.name.as_str());
            continue;
        };
        let times = written.seconds.times();
        let all = stages(&run.config, &written.metrics, &times);
        let rows = all.iter().map(|stage| Row {
            head: stage.name.to_owned(),
            cells: vec![seconds(stage.seconds), stage.text.clone()],
            sums_up: stage.name == "time",
        });
        let columns = [
            ("Stage", Column::Text),
            ("Time", Column::Number),
            ("What it is worth", Column::Sentence),
        ];
        let name = format!("Stages of {}", run.name);
        let rows: Vec<Row> = rows.collect();
        let html = table(&name, &columns, &rows);
        match runs.len() {
            1 => body += &html,
            _ => body += &folded(&run.name, shown < OPEN, &html),
        }
        if shown == 0 {
            pictures.push(bars(&run.name, &parts(&all, &times)));
        }
        shown += 1;
    }
    if !pictures.is_empty() {
        let of = match runs.len() {
            1 => "",
            _ => ", of the first run",
        };
        let caption = format!(
            "Time that the parts of a run took{of}. Some stages are trained beside each other."
        );
        body += &figure("times", Layout::One, &pictures, &caption);
    }
    if !waiting.is_empty() {
        body += &absent(&format!(
            "Stages are told at the end of a run, in stages.json; there is none yet of {}.",
            waiting.join(", ")
        ));
    }
    Ok(body)
}

fn seconds(seconds: Option<f64>) -> String {
    seconds.map_or("–".to_owned(), |seconds| format!("{seconds:.0} s"))
}

/// The parts of a run with their times, in order.
fn parts(stages: &[Stage], times: &Times) -> Vec<(&'static str, f64)> {
    let own = stages.iter().filter(|stage| stage.own);
    let own = own.filter_map(|stage| Some((stage.title, stage.seconds?)));
    let first = ("collecting data", times.collect.as_secs_f64());
    let last = [
        ("last rollouts", times.rollouts.as_secs_f64()),
        ("evaluation", times.evaluate.as_secs_f64()),
    ];
    std::iter::once(first).chain(own).chain(last).collect()
}

/// Sizes of a chart for phones (px).
const WIDTH: f64 = 400.0;
const LEFT: f64 = 122.0;
const RIGHT: f64 = 70.0;
const ROW: f64 = 24.0;

const STYLE: &str = "\
    .bars text{font:13px system-ui,'DejaVu Sans',sans-serif;fill:#1f2328}\
    .bars .paper{fill:#ffffff}.bars .bar{fill:#0072b2}\
    @media screen and (prefers-color-scheme:dark){\
    .bars text{fill:#e6edf3}.bars .paper{fill:#15191e}.bars .bar{fill:#56b4e9}}";

/// A bar chart as SVG.
fn bars(name: &str, parts: &[(&str, f64)]) -> String {
    let most = parts
        .iter()
        .map(|(_, seconds)| *seconds)
        .fold(1.0, f64::max);
    let mut rows = String::new();
    for (i, (part, seconds)) in parts.iter().enumerate() {
        let y = 12.0 + ROW * i as f64;
        let width = (WIDTH - LEFT - RIGHT) * (seconds / most).clamp(0.0, 1.0);
        let right = "text-anchor=\"end\"";
        text(&mut rows, [LEFT - 10.0, y + 13.5], right, part);
        let _ = writeln!(
            rows,
            "<rect class=\"bar\" x=\"{LEFT}\" y=\"{y}\" width=\"{:.1}\" height=\"17\" rx=\"2\"/>",
            width.max(1.0)
        );
        let label = match *seconds {
            seconds if seconds < 10.0 => format!("{seconds:.1} s"),
            seconds => format!("{seconds:.0} s"),
        };
        text(&mut rows, [LEFT + width + 7.0, y + 13.5], "", &label);
    }
    let height = 18.0 + ROW * parts.len() as f64;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"bars\" \
         viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n\
         <title>Time of each part of {}</title>\n<style>{STYLE}</style>\n\
         <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{rows}</svg>\n",
        escaped(name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_part_has_the_longest_bar() {
        let svg = bars(
            "a<b",
            &[("low level", 200.0), ("graph", 2.0), ("other", f64::NAN)],
        );
        assert!(svg.contains("a&lt;b"), "{svg}");
        for (width, label) in [("208.0", ">200 s<"), ("2.1", ">2.0 s<")] {
            assert!(
                svg.contains(&format!("width=\"{width}\" height=\"17\"")),
                "{svg}"
            );
            assert!(svg.contains(label), "{svg}");
        }
    }

    #[test]
    fn damaged_stages_are_an_error_and_invalid_times_are_zero() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap().is_none());
        let path = folder.path().join("stages.json");
        std::fs::write(&path, "{\n\"metrics\": 3}").unwrap();
        let error = read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("stages.json:2: "), "{error}");
        std::fs::write(
            &path,
            "{\"metrics\": {\"a\": 1.5}, \"seconds\": {\"train\": -1e300}}",
        )
        .unwrap();
        let written = read(folder.path()).unwrap().unwrap();
        assert_eq!(written.metrics["a"], 1.5);
        assert_eq!(written.seconds.times(), Times::default());
    }
}
