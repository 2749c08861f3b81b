//! What the user sees of a run while it goes on: the live view in a terminal, lines elsewhere.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use wire::{Phase, Role, State, Status};

use crate::children::Place;
use crate::figure::figure;
use crate::interrupts::Stops;
use crate::live::Live;
use crate::output;
use crate::stages::Newest;
use crate::throughput::Throughput;

/// Time between two lines.
const PAUSE: Duration = Duration::from_secs(5);

/// Newest status of each process, and when it came.
pub(crate) type Statuses = BTreeMap<(Role, u32), (Status, Instant)>;

/// A run as it is now.
pub(crate) struct Scene<'r> {
    pub(crate) phase: Phase,
    /// Time that the run has taken (s).
    pub(crate) seconds: f64,
    pub(crate) statuses: &'r Statuses,
    pub(crate) places: &'r [Place],
    pub(crate) newest: &'r Newest,
    pub(crate) throughput: &'r Throughput,
    /// Successes and episodes of the evaluation that are over, while there are any.
    pub(crate) score: Option<(usize, usize)>,
    /// Episodes of the evaluation.
    pub(crate) episodes: usize,
}

/// Shows a run.
pub(crate) struct Progress {
    live: Option<Live>,
    shown: Option<Instant>,
    last: String,
}

impl Progress {
    /// With the view where there is one.
    pub(crate) fn new(live: Option<Live>) -> Self {
        Self {
            live,
            shown: None,
            last: String::new(),
        }
    }

    /// Whether the view is up.
    pub(crate) fn is_live(&self) -> bool {
        self.live.is_some()
    }

    /// Takes in a process's word.
    pub(crate) fn hear(&mut self, role: Role, status: &Status) {
        if let Some(live) = &mut self.live {
            live.hear(role, status);
        }
    }

    /// Takes in a metric.
    pub(crate) fn note(&mut self, name: &str, value: f64) {
        if let Some(live) = &mut self.live {
            live.note(name, value);
        }
    }

    /// Shows how the run is, when it is time to.
    pub(crate) fn show(&mut self, scene: &Scene) {
        if self.live.as_ref().is_some_and(Live::is_gone) {
            self.close();
        }
        if let Some(live) = &mut self.live {
            live.show(scene);
            return;
        }
        if self.shown.is_some_and(|shown| shown.elapsed() < PAUSE) {
            return;
        }
        self.shown = Some(Instant::now());
        let line = line(scene);
        if line != self.last {
            say!("{line}");
        }
        self.last = line;
    }

    /// Says a line that stays.
    pub(crate) fn say(&mut self, text: &str) {
        match &mut self.live {
            Some(live) => live.say(text),
            None => say!("{text}"),
        }
    }

    /// Says that something went wrong that does not end the run.
    pub(crate) fn warn(&mut self, text: &str) {
        match &mut self.live {
            Some(live) => live.say(&format!("formica: {text}")),
            None => log::warn!("{text}"),
        }
    }

    /// Stops this process, the terminal as a shell wants it; returns when it is continued.
    pub(crate) fn stop(&self) {
        match &self.live {
            Some(live) => live.stop(),
            None => {
                output::flush();
                Stops::stop();
            }
        }
    }

    /// Takes the view down, and says what was said meanwhile.
    pub(crate) fn close(&mut self) {
        if let Some(live) = self.live.take() {
            for line in live.close() {
                say!("{line}");
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.close();
    }
}

/// All of a run that a line tells.
fn line(scene: &Scene) -> String {
    let mut actors = 0;
    let mut parts = vec![];
    for ((role, _), (status, seen)) in scene.statuses {
        if *role == Role::Actor {
            let working = status.state == State::Working as u32;
            actors += usize::from(working && seen.elapsed() < Duration::from_secs(5));
        } else if status.state < State::Finished as u32 {
            let text = status.text();
            let share = match status.progress {
                // The text tells more.
                [done, total] if total > 0 && !text.contains('%') => {
                    let share = done as f64 / total as f64;
                    format!(" {:.0}%", 100.0 * share.min(1.0))
                }
                _ => String::new(),
            };
            parts.push(format!("{}: {text}{share}", role.name()));
        }
    }
    let rate = scene.throughput.of_all(Instant::now());
    parts.push(match figure(rate, 0) {
        Some(rate) if rate != "0" => format!("{actors} actors at {rate} steps/s"),
        // None is known.
        _ => format!("{actors} actors"),
    });
    let lag = scene.newest.get("rollout/policy_lag");
    if let Some(lag) = lag.and_then(|lag| figure(*lag, 0)) {
        parts.push(format!("policy lag {lag}"));
    }
    if let Some((successes, done)) = scene.score {
        parts.push(format!("{successes} of {done} episodes reached the goal"));
    }
    let phase = match scene.phase {
        Phase::Train => "train",
        Phase::Settle => "settle",
        Phase::Evaluate => "evaluate",
        Phase::Finish => "finish",
    };
    format!("{phase} | {}", parts.join(" | "))
}
