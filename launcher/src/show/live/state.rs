//! The state of the view between frames.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use agents::{Algorithm, Label};
use config::Config;
use maze::Layout;
use wire::{MAX_ACTORS, Phase, Role, Status};

use super::process_rows::{printable, processes};
use super::terminal;
use super::view::{Ant, MazeOutline, Metric, Score, View};
use crate::record::throughput;
use crate::show::scene::Scene;

/// Values that are kept of a metric.
const HISTORY: usize = 40;
/// Positions that are kept of an ant.
pub(super) const TRAIL: usize = 24;
/// Log lines that are kept.
pub(super) const LINES: usize = 500;
/// Log lines that a frame can show.
const SHOWN_LINES: usize = 8;
/// Test episodes per score.
const TESTS: usize = 20;

/// Metrics of every run to show, the most important first.
const METRICS: [Label; 3] = [
    label("rollout/score", "test score, last 20", 0),
    label("rollout/policy_lag", "policy lag", 1),
    label(throughput::STEPS, "steps a second", 0),
];

const fn label(metric: &'static str, label: &'static str, decimals: usize) -> Label {
    Label {
        metric,
        label,
        decimals,
        rate: None,
    }
}

/// What the view shows of a run beyond its present state.
pub(super) struct LiveState {
    pub(super) run: String,
    pub(super) config: String,
    pub(super) phases: &'static [Phase],
    pub(super) outline: Arc<MazeOutline>,
    pub(super) colour: bool,
    /// Metrics to show, the most important first.
    pub(super) labels: Vec<Label>,
    pub(super) histories: BTreeMap<&'static str, VecDeque<f64>>,
    /// By actor.
    pub(super) trails: BTreeMap<u32, VecDeque<[f32; 2]>>,
    pub(super) lines: VecDeque<String>,
}

impl LiveState {
    pub(super) fn new(config: &Config, folder: &Path, layout: &Layout) -> Self {
        Self {
            run: folder.display().to_string(),
            config: config.hash(),
            phases: match config.offline {
                true => &[Phase::Train, Phase::Settle, Phase::Evaluate, Phase::Finish],
                false => &[Phase::Train, Phase::Finish],
            },
            labels: METRICS
                .iter()
                .chain(agents::find(&config.run.algorithm).map_or(&[][..], Algorithm::labels))
                .copied()
                .collect(),
            outline: Arc::new(MazeOutline::new(layout)),
            colour: terminal::has_colour(),
            histories: BTreeMap::new(),
            trails: BTreeMap::new(),
            lines: VecDeque::new(),
        }
    }

    pub(super) fn on_status(&mut self, role: Role, status: &Status) {
        if role != Role::Actor || status.id as usize >= MAX_ACTORS {
            return;
        }
        if self.outline.holds(status.place) {
            keep(
                self.trails.entry(status.id).or_default(),
                status.place,
                TRAIL,
            );
        } else {
            self.trails.remove(&status.id);
        }
    }

    pub(super) fn on_metric(&mut self, name: &str, value: f64) {
        let shown = self.labels.iter().find(|label| label.metric == name);
        if let Some(label) = shown.filter(|_| value.is_finite()) {
            keep(
                self.histories.entry(label.metric).or_default(),
                value,
                HISTORY,
            );
        }
    }

    pub(super) fn add_line(&mut self, text: &str) {
        keep(&mut self.lines, text.to_owned(), LINES);
    }

    pub(super) fn view(&self, scene: &Scene) -> View {
        let newest = self.lines.len().saturating_sub(SHOWN_LINES);
        View {
            run: self.run.clone(),
            config: self.config.clone(),
            phases: self.phases,
            phase: scene.phase,
            passed: Duration::try_from_secs_f64(scene.seconds).unwrap_or_default(),
            processes: processes(scene, Instant::now()),
            score: scene.score.map(|(successes, done)| Score {
                successes,
                done,
                episodes: scene.episodes,
            }),
            metrics: self.metrics(scene),
            outline: Arc::clone(&self.outline),
            ants: self
                .trails
                .iter()
                .map(|(id, trail)| Ant {
                    id: *id,
                    trail: trail.iter().copied().collect(),
                })
                .collect(),
            lines: self
                .lines
                .range(newest..)
                .map(|line| printable(line))
                .collect(),
            colour: self.colour,
        }
    }

    fn metrics(&self, scene: &Scene) -> Vec<Metric> {
        let mut metrics = vec![];
        for Label {
            metric: name,
            label,
            decimals,
            ..
        } in self.labels.iter().copied()
        {
            let history: Vec<f64> = match self.histories.get(name) {
                Some(history) => history.iter().copied().collect(),
                // From an earlier launcher of the run.
                None => scene.newest.get(name).copied().into_iter().collect(),
            };
            let Some(mut value) = history.last().copied() else {
                continue;
            };
            if name == "rollout/score" {
                let tests = &history[history.len().saturating_sub(TESTS)..];
                value = tests.iter().sum::<f64>() / tests.len() as f64;
            }
            metrics.push(Metric {
                label,
                value,
                decimals,
                history,
            });
        }
        metrics
    }
}

/// Appends a value, and removes the oldest one if there are too many.
fn keep<T>(kept: &mut VecDeque<T>, value: T, most: usize) {
    if kept.len() >= most {
        kept.pop_front();
    }
    kept.push_back(value);
}
