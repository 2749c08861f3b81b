//! Shows the progress of a run: the live view in a terminal, lines elsewhere.

use std::time::{Duration, Instant};

use plot::number::fixed;
use wire::{Phase, Role, State, Status};

use super::live::Live;
use super::scene::Scene;
use crate::interrupts::Stops;
use crate::output;

/// Time between two lines.
const PAUSE: Duration = Duration::from_secs(5);

/// Shows the progress of a run.
pub(crate) struct Progress {
    live: Option<Live>,
    shown: Option<Instant>,
    last: String,
}

impl Progress {
    /// Uses the live view if there is one.
    pub(crate) fn new(live: Option<Live>) -> Self {
        Self {
            live,
            shown: None,
            last: String::new(),
        }
    }

    /// Whether the live view is shown.
    pub(crate) fn is_live(&self) -> bool {
        self.live.is_some()
    }

    /// Updates the view with a status.
    pub(crate) fn on_status(&mut self, role: Role, status: &Status) {
        if let Some(live) = &mut self.live {
            live.on_status(role, status);
        }
    }

    /// Updates the view with a metric.
    pub(crate) fn on_metric(&mut self, name: &str, value: f64) {
        if let Some(live) = &mut self.live {
            live.on_metric(name, value);
        }
    }

    /// Shows the state of the run when an update is due.
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
            outln!("{line}");
        }
        self.last = line;
    }

    /// Prints a line.
    pub(crate) fn print(&mut self, text: &str) {
        match &mut self.live {
            Some(live) => live.add_line(text),
            None => outln!("{text}"),
        }
    }

    /// Prints a warning.
    pub(crate) fn warn(&mut self, text: &str) {
        match &mut self.live {
            Some(live) => live.add_line(&format!("formica: {text}")),
            None => log::warn!("{text}"),
        }
    }

    /// Restores the terminal and stops this process until it is continued.
    pub(crate) fn stop(&self) {
        match &self.live {
            Some(live) => live.stop(),
            None => {
                output::flush();
                Stops::stop();
            }
        }
    }

    /// Closes the view, and prints its log lines.
    pub(crate) fn close(&mut self) {
        if let Some(live) = self.live.take() {
            for line in live.close() {
                outln!("{line}");
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.close();
    }
}

/// The state of a run as a line.
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
                // The text has no percentage.
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
    parts.push(match fixed(rate, 0) {
        Some(rate) if rate != "0" => format!("{actors} actors at {rate} steps/s"),
        // Unknown.
        _ => format!("{actors} actors"),
    });
    let lag = scene.newest.get("rollout/policy_lag");
    if let Some(lag) = lag.and_then(|lag| fixed(*lag, 0)) {
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
