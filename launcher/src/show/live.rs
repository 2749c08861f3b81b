//! The live view of a run in a terminal. A thread of its own draws it.
//!
//! Log lines that it showed are printed again on the main screen when it is closed.

mod frame;
mod layout;
mod maze;
mod metrics;
mod process_rows;
mod processes;
mod render_thread;
mod state;
mod style;
mod terminal;
mod view;

use std::fs::OpenOptions;
use std::path::Path;
use std::time::{Duration, Instant};

use ::maze::Layout;
use config::Config;
use wire::{Role, Status};

use crate::show::scene::Scene;
use render_thread::RenderThread;
use state::LiveState;

/// Time between two frames.
const PAUSE: Duration = Duration::from_millis(200);

/// The view.
pub(crate) struct Live {
    render_thread: RenderThread,
    state: LiveState,
    shown: Option<Instant>,
}

impl Live {
    /// Shows the view; `None` without a terminal that can show it.
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
            render_thread: RenderThread::start(log).ok()?,
            state: LiveState::new(config, folder, &layout),
            shown: None,
        })
    }

    /// Whether the terminal is gone.
    pub(crate) fn is_gone(&self) -> bool {
        self.render_thread.is_gone()
    }

    /// Updates the position of an actor's ant.
    pub(crate) fn on_status(&mut self, role: Role, status: &Status) {
        self.state.on_status(role, status);
    }

    /// Adds a value of a metric.
    pub(crate) fn on_metric(&mut self, name: &str, value: f64) {
        self.state.on_metric(name, value);
    }

    /// Adds a log line.
    pub(crate) fn add_line(&mut self, text: &str) {
        self.state.add_line(text);
    }

    /// Draws a frame when one is due.
    pub(crate) fn show(&mut self, scene: &Scene) {
        if self.shown.is_none_or(|shown| shown.elapsed() >= PAUSE) {
            self.shown = Some(Instant::now());
            self.render_thread.show(self.state.view(scene));
        }
    }

    /// Restores the terminal and stops this process until it is continued.
    #[allow(clippy::unused_self)] // There is one terminal.
    pub(crate) fn stop(&self) {
        terminal::stop();
    }

    /// Closes the view and returns its log lines.
    pub(crate) fn close(self) -> impl Iterator<Item = String> {
        drop(self.render_thread);
        self.state.lines.into_iter()
    }
}

#[cfg(test)]
mod tests;
