//! The end of a run: ends all processes and reports the outcome.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use report::stages;
use runs::file;
use rustix::process::Signal;
use wire::{EpisodeResult, Phase};

use super::children::Failure;
use super::run::{Run, TICK};
use crate::record::score;
use crate::{exit, fault};

/// Time from the directive to finish to SIGTERM, and from there to SIGKILL.
const GRACE: [Duration; 2] = [Duration::from_secs(8), Duration::from_secs(4)];
/// The same for a run that ends early: less than 5 s in total.
const SHORT_GRACE: [Duration; 2] = [Duration::from_millis(2500), Duration::from_millis(1500)];

impl Run<'_> {
    /// Ends all processes: by directive, by SIGTERM, by SIGKILL.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        let early = self.failure.is_some() || self.interrupts.count() > 0;
        self.directive.phase = Phase::Finish as u32;
        self.directives.publish(&self.directive)?;
        let mut start = Instant::now();
        let seen = self.interrupts.count();
        let (mut termed, mut killed) = (false, false);
        let [to_term, to_kill] = if early { SHORT_GRACE } else { GRACE };
        while self.children.any_left(true) {
            start += self.handle_stop();
            self.read_reports()?;
            self.bus.sweep();
            self.directives.keep_alive();
            self.poll_children(true)?;
            self.record_metrics();
            if self.progress.is_live() {
                self.show();
            }
            let passed = start.elapsed();
            let again = self.interrupts.count() > seen;
            if !termed && passed >= to_term {
                self.children.signal(Signal::TERM);
                termed = true;
            }
            if !killed && (again || passed >= to_term + to_kill) {
                self.children.signal(Signal::KILL);
                killed = true;
            }
            std::thread::sleep(TICK);
        }
        self.read_reports()
    }

    /// Prints and records the outcome.
    pub(super) fn report(&mut self) -> anyhow::Result<ExitCode> {
        self.save();
        let readers = &self.bus.limits().readers;
        let (text, agree) = self.audit.compare(self.folder, readers);
        self.progress.print(&text);
        let restarts = self.restarts();
        if restarts > 0 {
            self.progress.print(&format!("restarts: {restarts}"));
        }
        if self.refused > 0 {
            let refused = self.refused;
            self.progress
                .print(&format!("reports refused by the launcher: {refused}"));
        }
        let folder = self.folder;
        if self.interrupts.count() > 0 {
            self.progress.print(&format!(
                "ended by signal; `formica launch --resume {}` goes on",
                folder.display()
            ));
            return Ok(ExitCode::from(exit::SIGNAL));
        }
        if let Some(failure) = self.failure.take() {
            return Err(match failure {
                Failure { why, input: true } => fault::Input(why).into(),
                Failure { why, .. } => anyhow::anyhow!(why),
            });
        }
        anyhow::ensure!(
            agree,
            "the counts of transitions do not agree; see {}",
            folder.display()
        );
        if self.config.offline {
            let results: Vec<EpisodeResult> = self.results.iter().flatten().copied().collect();
            let score = score::write(folder, self.config, &results)?;
            let newest = self.metrics.newest();
            let json =
                serde_json::to_string_pretty(&stages::json(self.config, newest, &self.times))?;
            let table = stages::table(self.config, newest, &self.times);
            file::write(&folder.join("stages.json"), json.as_bytes())?;
            self.progress.print(&table);
            self.progress.print(&score);
            let missed = results.iter().any(|result| result.success == 0);
            if let Some(weakest) = stages::weakest(self.config, newest).filter(|_| missed) {
                self.progress.print(&weakest);
            }
        }
        self.finished = true;
        self.save();
        dataset::prepared::remove(folder);
        dataset::prepared::remove(folder);
        self.progress
            .print(&format!("all of it is in {}", folder.display()));
        Ok(ExitCode::SUCCESS)
    }
}
