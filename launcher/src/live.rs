//! The live view of a run in a terminal: gathered here, drawn by a thread of its own.
//!
//! What was said while it was up is said again on the screen of before.

mod figures;
mod floor;
mod frame;
mod ink;
mod painter;
mod processes;
mod terminal;
mod view;

use std::collections::{BTreeMap, VecDeque};
use std::fs::OpenOptions;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use config::{Config, Kind};
use maze::Layout;
use wire::{MAX_ACTORS, Phase, Role, State, Status};

use crate::children::Place;
use crate::progress::Scene;
use crate::throughput;
use painter::Painter;
use view::{Ant, Figure, Floor, Health, Process, Score, View};

/// Time between two frames.
const PAUSE: Duration = Duration::from_millis(200);
/// Values of a metric that are kept.
const HISTORY: usize = 40;
/// Places of an ant that are kept.
const WAY: usize = 24;
/// What was said that is kept.
const LINES: usize = 500;
/// Lines that a frame can show.
const SHOWN_LINES: usize = 8;
/// An attached actor that was silent for so long has left.
const LEFT: Duration = Duration::from_secs(15);
/// Tests that a score is the mean of.
const TESTS: usize = 20;

/// Metrics that are shown, the most important first: name, label, decimals.
const FIGURES: [(&str, &str, usize); 15] = [
    ("rollout/score", "test score, last 20", 0),
    ("rollout/policy_lag", "policy lag", 1),
    (throughput::STEPS, "steps a second", 0),
    ("low/policy_loss", "low policy loss", 3),
    ("low/value_loss", "low value loss", 4),
    ("high/value_loss", "high value loss", 4),
    ("high/entropy_nats", "high entropy (nats)", 2),
    ("high/return", "high return", 2),
    ("high/kl", "high KL (nats)", 4),
    ("encoder/reconstruction", "encoder loss", 4),
    ("encoder/kl_nats", "encoder KL (nats)", 2),
    ("walker/speed_m_s", "walker speed (m/s)", 2),
    ("walker/reward", "walker reward", 3),
    ("walker/value_loss", "walker value loss", 4),
    ("walker/kl", "walker KL (nats)", 4),
];

/// The view, and what it remembers of the run.
pub(crate) struct Live {
    painter: Painter,
    memory: Memory,
    shown: Option<Instant>,
}

impl Live {
    /// Puts the view up; none where there is no terminal that it could be seen in.
    pub(crate) fn start(config: &Config, folder: &Path) -> Option<Self> {
        if !terminal::is_fit() {
            return None;
        }
        let layout = Layout::of(&config.maze.layout, &config.maze.rows).ok()?;
        let log = OpenOptions::new()
            .create(true)
            .append(true)
            .open(folder.join("logs").join("launcher.log"))
            .ok()?;
        Some(Self {
            painter: Painter::start(log).ok()?,
            memory: Memory::new(config, folder, &layout),
            shown: None,
        })
    }

    /// Whether it can be seen no more.
    pub(crate) fn is_gone(&self) -> bool {
        self.painter.is_gone()
    }

    pub(crate) fn hear(&mut self, role: Role, status: &Status) {
        self.memory.hear(role, status);
    }

    pub(crate) fn note(&mut self, name: &str, value: f64) {
        self.memory.note(name, value);
    }

    pub(crate) fn say(&mut self, text: &str) {
        self.memory.say(text);
    }

    /// Shows how the run is, when it is time to.
    pub(crate) fn show(&mut self, scene: &Scene) {
        if self.shown.is_none_or(|shown| shown.elapsed() >= PAUSE) {
            self.shown = Some(Instant::now());
            self.painter.show(self.memory.view(scene));
        }
    }

    /// Gives the terminal back and stops this process, until it is continued.
    #[allow(clippy::unused_self)] // There is one terminal.
    pub(crate) fn stop(&self) {
        terminal::stop();
    }

    /// Takes the view down; all that was said.
    pub(crate) fn close(self) -> impl Iterator<Item = String> {
        drop(self.painter);
        self.memory.lines.into_iter()
    }
}

/// What a moment does not tell.
struct Memory {
    run: String,
    config: String,
    phases: &'static [Phase],
    floor: Arc<Floor>,
    colour: bool,
    histories: BTreeMap<&'static str, VecDeque<f64>>,
    /// By actor.
    ways: BTreeMap<u32, VecDeque<[f32; 2]>>,
    lines: VecDeque<String>,
}

impl Memory {
    fn new(config: &Config, folder: &Path, layout: &Layout) -> Self {
        Self {
            run: folder.display().to_string(),
            config: config.hash(),
            phases: match config.run.kind {
                Kind::Offline => &[Phase::Train, Phase::Settle, Phase::Evaluate, Phase::Finish],
                Kind::Walker => &[Phase::Train, Phase::Finish],
            },
            floor: Arc::new(Floor::new(layout)),
            colour: terminal::has_colour(),
            histories: BTreeMap::new(),
            ways: BTreeMap::new(),
            lines: VecDeque::new(),
        }
    }

    fn hear(&mut self, role: Role, status: &Status) {
        if role != Role::Actor || status.id as usize >= MAX_ACTORS {
            return;
        }
        if self.floor.holds(status.place) {
            keep(self.ways.entry(status.id).or_default(), status.place, WAY);
        } else {
            self.ways.remove(&status.id);
        }
    }

    fn note(&mut self, name: &str, value: f64) {
        let shown = FIGURES.iter().find(|(shown, ..)| *shown == name);
        if let Some((name, ..)) = shown.filter(|_| value.is_finite()) {
            keep(self.histories.entry(*name).or_default(), value, HISTORY);
        }
    }

    fn say(&mut self, text: &str) {
        keep(&mut self.lines, text.to_owned(), LINES);
    }

    fn view(&self, scene: &Scene) -> View {
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
            figures: self.figures(scene),
            floor: Arc::clone(&self.floor),
            ants: self
                .ways
                .iter()
                .map(|(id, way)| Ant {
                    id: *id,
                    way: way.iter().copied().collect(),
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

    fn figures(&self, scene: &Scene) -> Vec<Figure> {
        let mut figures = vec![];
        for (name, label, decimals) in FIGURES {
            let history: Vec<f64> = match self.histories.get(name) {
                Some(history) => history.iter().copied().collect(),
                // Of an earlier launcher of the run.
                None => scene.newest.get(name).copied().into_iter().collect(),
            };
            let Some(mut value) = history.last().copied() else {
                continue;
            };
            if name == "rollout/score" {
                let tests = &history[history.len().saturating_sub(TESTS)..];
                value = tests.iter().sum::<f64>() / tests.len() as f64;
            }
            figures.push(Figure {
                label,
                value,
                decimals,
                history,
            });
        }
        figures
    }
}

/// Adds to what is kept; the oldest goes when there is too much.
fn keep<T>(kept: &mut VecDeque<T>, value: T, most: usize) {
    if kept.len() >= most {
        kept.pop_front();
    }
    kept.push_back(value);
}

/// A text without what could move the cursor.
fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() && c != '\n' { ' ' } else { c })
        .collect()
}

/// The run's own processes, then those that are attached to it.
fn processes(scene: &Scene, now: Instant) -> Vec<Process> {
    let mut processes: Vec<Process> = scene
        .places
        .iter()
        .map(|place| {
            let status = scene.statuses.get(&(place.role, place.id));
            let status = status.map(|(status, _)| status);
            let present = status.filter(|status| status.pid == place.pid);
            let heard = place.is_alive().then(|| place.silence());
            process(
                scene,
                (place.role, place.id),
                present,
                health(place, present),
                heard,
                now,
            )
            .with(place)
        })
        .collect();
    for ((role, id), (status, seen)) in scene.statuses {
        let own = |place: &Place| (place.role, place.id) == (*role, *id);
        let silence = now.saturating_duration_since(*seen);
        if scene.places.iter().any(own) || silence > LEFT {
            continue;
        }
        let health = Health::Alive(State::from_number(status.state).unwrap_or(State::Finished));
        let mut process = process(
            scene,
            (*role, *id),
            Some(status),
            health,
            Some(silence),
            now,
        );
        process.name += " +";
        processes.push(process);
    }
    processes
}

fn health(place: &Place, present: Option<&Status>) -> Health {
    let state = present.and_then(|status| State::from_number(status.state));
    match state {
        state if place.is_alive() => Health::Alive(state.unwrap_or(State::Starting)),
        _ if place.is_to_return() => Health::Restarting,
        Some(State::Finished) => Health::Alive(State::Finished),
        _ => Health::Gone,
    }
}

fn process(
    scene: &Scene,
    (role, id): (Role, u32),
    status: Option<&Status>,
    health: Health,
    heard: Option<Duration>,
    now: Instant,
) -> Process {
    let name = match role {
        Role::Actor => format!("{} {id}", role.name()),
        _ => role.name().to_owned(),
    };
    let share = |status: &Status| {
        let [done, all] = status.progress;
        (all > 0).then(|| done as f64 / all as f64)
    };
    let working = matches!(health, Health::Alive(State::Working | State::Trained));
    Process {
        name,
        pid: status.map(|status| status.pid),
        health,
        doing: status.map_or_else(String::new, |status| printable(&status.text())),
        done: status.and_then(share),
        rate: match role {
            Role::Actor if working => Some((scene.throughput.of_actor(id, now), "steps")),
            Role::Learner => scene.throughput.of_learner(now),
            _ => None,
        },
        restarts: 0,
        heard,
    }
}

impl Process {
    /// With what the launcher knows of it.
    fn with(self, place: &Place) -> Self {
        Self {
            pid: place.is_alive().then_some(place.pid),
            restarts: place.restarted,
            ..self
        }
    }
}

#[cfg(test)]
mod tests;
