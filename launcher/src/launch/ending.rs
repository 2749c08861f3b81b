//! The end of a run: all processes ended in order, and how it went.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use config::Kind;
use rustix::process::Signal;
use wire::{EpisodeResult, Phase};

use super::{Run, TICK};
use crate::children::Failure;
use crate::interrupts::Interrupts;
use crate::{fault, folder, score, stages};

/// From the word to finish to SIGTERM, and from there to SIGKILL.
const PATIENCE: [Duration; 2] = [Duration::from_secs(8), Duration::from_secs(4)];
/// The same for a run that ends before its time: within 5 s in all.
const HASTE: [Duration; 2] = [Duration::from_millis(2500), Duration::from_millis(1500)];

impl Run<'_> {
    /// Ends all processes in order: by word, by SIGTERM, by SIGKILL.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        let early = self.failure.is_some() || self.interrupts.count() > 0;
        self.directive.phase = Phase::Finish as u32;
        self.directives.publish(&self.directive)?;
        let mut start = Instant::now();
        let seen = self.interrupts.count();
        let (mut termed, mut killed) = (false, false);
        let [patience, hurry] = if early { HASTE } else { PATIENCE };
        while self.children.any_left(true) {
            start += self.heed_stop();
            self.read_reports()?;
            self.bus.sweep();
            self.directives.keep_alive();
            self.tend(true)?;
            self.measure();
            if self.progress.is_live() {
                self.show();
            }
            let passed = start.elapsed();
            let hasty = self.interrupts.count() > seen;
            if !termed && passed >= patience {
                self.children.signal(Signal::TERM);
                termed = true;
            }
            if !killed && (hasty || passed >= patience + hurry) {
                self.children.signal(Signal::KILL);
                killed = true;
            }
            std::thread::sleep(TICK);
        }
        self.read_reports()
    }

    /// Says how it went, and writes it down.
    pub(super) fn report(&mut self) -> anyhow::Result<ExitCode> {
        self.save();
        let readers = &self.bus.limits().readers;
        let (text, agree) = self.accounts.settle(self.folder, readers);
        self.progress.say(&text);
        let restarts = self.restarts();
        if restarts > 0 {
            self.progress.say(&format!("restarts: {restarts}"));
        }
        if self.refused > 0 {
            let refused = self.refused;
            self.progress
                .say(&format!("reports refused by the launcher: {refused}"));
        }
        let folder = self.folder;
        if self.interrupts.count() > 0 {
            self.progress.say(&format!(
                "ended by signal; `formica launch --resume {}` goes on",
                folder.display()
            ));
            return Ok(ExitCode::from(Interrupts::EXIT));
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
        if self.config.run.kind == Kind::Offline {
            let results: Vec<EpisodeResult> = self.results.iter().flatten().copied().collect();
            let score = score::write(folder, self.config, &results)?;
            let newest = self.metrics.newest();
            let json = serde_json::to_string_pretty(&stages::json(newest, &self.times))?;
            let table = stages::table(self.config, newest, &self.times);
            folder::write(&folder.join("stages.json"), json.as_bytes())?;
            self.progress.say(&table);
            self.progress.say(&score);
            let missed = results.iter().any(|result| result.success == 0);
            if let Some(weakest) = stages::weakest(newest).filter(|_| missed) {
                self.progress.say(&weakest);
            }
        }
        self.finished = true;
        self.save();
        dataset::prepared::remove(folder);
        self.progress
            .say(&format!("all of it is in {}", folder.display()));
        Ok(ExitCode::SUCCESS)
    }
}
