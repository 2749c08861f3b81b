//! The loop of a run: children, reports, phases, and what is shown of them.

use std::time::{Duration, Instant};

use config::Kind;
use rustix::process::Signal;
use wire::{Phase, Role};

use super::{Run, SWEEP, TICK};
use crate::progress::Scene;
use crate::saved::Saved;

/// A tick that took longer shows that the launcher itself stood still.
const STOOD_STILL: Duration = Duration::from_secs(2);

impl Run<'_> {
    /// From the first start to the last exit.
    pub(super) fn supervise(&mut self) -> anyhow::Result<()> {
        self.directives.publish(&self.directive)?;
        if self.config.run.kind == Kind::Offline {
            self.children.start(Role::GraphBuilder, 0, self.config)?;
        }
        self.children.start(Role::Learner, 0, self.config)?;
        for id in 0..self.config.topology.actors {
            self.children.start(Role::Actor, id as u32, self.config)?;
        }
        let mut swept = Instant::now();
        let mut ticked = Instant::now();
        loop {
            if ticked.elapsed() > STOOD_STILL {
                self.children.forgive();
            }
            ticked = Instant::now();
            self.heed_stop();
            self.read_reports()?;
            if swept.elapsed() > SWEEP {
                self.bus.sweep();
                swept = Instant::now();
            }
            self.directives.keep_alive();
            self.tend(false)?;
            if self.failure.is_some() || self.interrupts.count() > 0 {
                break;
            }
            if self.saver.is_due() {
                self.save();
            }
            self.measure();
            self.show();
            if !self.rewound()? || self.advance()? {
                std::thread::sleep(TICK);
                continue;
            }
            break;
        }
        self.save();
        self.finish()
    }

    /// Ctrl-Z stops all processes of the run with this one, and they go on with it. The time between
    /// counts for nothing; how long it was.
    pub(super) fn heed_stop(&mut self) -> Duration {
        if !self.stops.take() {
            return Duration::ZERO;
        }
        self.children.signal(Signal::STOP);
        let start = Instant::now();
        self.progress.stop();
        let passed = start.elapsed();
        self.children.signal(Signal::CONT);
        self.children.forgive();
        self.began += passed;
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
            places: &self.children.places,
            newest: self.metrics.newest(),
            throughput: &self.throughput,
            score: self.score_so_far(),
            episodes: self.results.len(),
        };
        self.progress.show(&scene);
    }

    /// Writes the launcher's own metrics, and says what could not be written.
    pub(super) fn measure(&mut self) {
        for (name, step, value) in self.throughput.due(Instant::now()) {
            self.metrics.add_own(name, step, value);
            self.progress.note(name, value);
        }
        self.metrics.flush_if_due();
        for complaint in self.metrics.complaints() {
            self.progress.warn(&complaint);
        }
    }

    pub(super) fn save(&mut self) {
        let saved = Saved {
            seconds: self.metrics.seconds(),
            times: self.times,
            trained: self.trained,
            since: self.began.elapsed().as_secs_f64(),
            evaluated: self.evaluated,
            results: self.results.iter().flatten().copied().collect(),
            settled: self.settled,
            finished: self.finished,
            restarts: self.restarts(),
            accounts: self.accounts.clone(),
        };
        if let Some(error) = self.saver.save(&saved) {
            self.progress.warn(&error);
        }
    }

    pub(super) fn restarts(&self) -> usize {
        let own = self.children.places.iter().map(|place| place.restarted);
        self.restarts_before + own.sum::<usize>()
    }

    /// Successes and episodes of the evaluation that are over.
    fn score_so_far(&self) -> Option<(usize, usize)> {
        let evaluating = matches!(self.directive.phase(), Phase::Evaluate | Phase::Finish);
        let done = self.results.iter().flatten();
        let successes = done.clone().filter(|result| result.success == 1).count();
        let done = done.count();
        (evaluating && done > 0).then_some((successes, done))
    }
}
