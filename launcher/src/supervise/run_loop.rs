//! The main loop of a run.

use std::time::{Duration, Instant};

use rustix::process::Signal;
use wire::{Phase, Role};

use super::children::Slot;
use super::progress_file::RunProgress;
use super::run::{Run, TICK};
use crate::show::scene::Scene;

/// Dead nodes are cleared this often, since they occupy slots on channels.
const SWEEP: Duration = Duration::from_millis(200);
/// If a tick takes longer, the launcher itself was suspended.
const SUSPENDED: Duration = Duration::from_secs(2);

impl Run<'_> {
    /// Supervises the processes from the first start to the last exit.
    pub(super) fn supervise(&mut self) -> anyhow::Result<()> {
        self.directives.publish(&self.directive)?;
        if self.graph {
            self.children.start(Role::GraphBuilder, 0, self.config)?;
        }
        self.children.start(Role::Learner, 0, self.config)?;
        for id in 0..self.config.topology.actors {
            self.children.start(Role::Actor, id as u32, self.config)?;
        }
        let mut swept = Instant::now();
        let mut ticked = Instant::now();
        loop {
            if ticked.elapsed() > SUSPENDED {
                self.children.reset_timeouts();
            }
            ticked = Instant::now();
            self.handle_stop();
            self.read_reports()?;
            if swept.elapsed() > SWEEP {
                self.bus.sweep();
                swept = Instant::now();
            }
            self.directives.keep_alive();
            self.poll_children(false)?;
            if self.failure.is_some() || self.interrupts.count() > 0 {
                break;
            }
            if self.progress_file.is_due() {
                self.save();
            }
            self.record_metrics();
            self.show();
            if !self.is_rewound()? || self.advance()? {
                std::thread::sleep(TICK);
                continue;
            }
            break;
        }
        self.save();
        self.finish()
    }

    /// Handles Ctrl-Z: stops all processes of the run with this one. The time until they continue does not
    /// count. Returns this time.
    pub(super) fn handle_stop(&mut self) -> Duration {
        if !self.stops.take() {
            return Duration::ZERO;
        }
        self.children.signal(Signal::STOP);
        let start = Instant::now();
        self.progress.stop();
        let passed = start.elapsed();
        self.children.signal(Signal::CONT);
        self.children.reset_timeouts();
        self.part_start += passed;
        self.metrics.skip(passed);
        self.throughput.skip(passed);
        for (_, seen) in self.statuses.values_mut() {
            *seen += passed;
        }
        passed
    }

    pub(super) fn show(&mut self) {
        let scene = Scene {
            phase: self.directive.phase(),
            seconds: self.metrics.seconds(),
            statuses: &self.statuses,
            slots: self.children.slots.iter().map(Slot::state).collect(),
            newest: self.metrics.newest(),
            throughput: &self.throughput,
            score: self.score_so_far(),
            episodes: self.results.len(),
        };
        self.progress.show(&scene);
    }

    /// Records the launcher's own metrics, and prints errors in recording.
    pub(super) fn record_metrics(&mut self) {
        for (name, step, value) in self.throughput.due(Instant::now()) {
            self.metrics.add_own(name, step, value);
            self.progress.on_metric(name, value);
        }
        self.metrics.flush_if_due();
        for error in self.metrics.take_errors() {
            self.progress.warn(&error);
        }
    }

    pub(super) fn save(&mut self) {
        let progress = RunProgress {
            seconds: self.metrics.seconds(),
            times: self.times,
            trained: self.trained,
            since: self.part_start.elapsed().as_secs_f64(),
            evaluated: self.evaluated,
            results: self.results.iter().flatten().copied().collect(),
            settled: self.settled,
            finished: self.finished,
            restarts: self.restarts(),
            audit: self.audit.clone(),
        };
        if let Some(error) = self.progress_file.save(&progress) {
            self.progress.warn(&error);
        }
    }

    pub(super) fn restarts(&self) -> usize {
        let own = self.children.slots.iter().map(|slot| slot.restarted);
        self.restarts_before + own.sum::<usize>()
    }

    /// Successes and episodes of the evaluation so far.
    fn score_so_far(&self) -> Option<(usize, usize)> {
        let evaluating = matches!(self.directive.phase(), Phase::Evaluate | Phase::Finish);
        let done = self.results.iter().flatten();
        let successes = done.clone().filter(|result| result.success == 1).count();
        let done = done.count();
        (evaluating && done > 0).then_some((successes, done))
    }
}
