//! Reads reports of processes, and handles processes that ended.

use std::cell::{Cell, RefCell};
use std::time::Instant;

use wire::{MAX_ACTORS, Phase, Role};

use super::children::{Ended, Failure};
use super::run::{LEARNERS, Run};

impl Run<'_> {
    pub(super) fn read_reports(&mut self) -> anyhow::Result<()> {
        let Self {
            config,
            reports,
            children,
            statuses,
            audit,
            metrics,
            throughput,
            progress,
            results,
            directive,
            refused,
            ..
        } = self;
        // Used by both closures.
        let (throughput, progress) = (RefCell::new(throughput), RefCell::new(progress));
        let attached = config.topology.actors..config.topology.max_actors.min(MAX_ACTORS);
        let most_steps = config.evaluation.max_steps as u32;
        let mut changed = false;
        let invalid = Cell::new(0);
        reports.read(
            |status| {
                let id = status.id as usize;
                let known = Role::from_number(status.role).filter(|_| id < MAX_ACTORS);
                let Some(role) = known else {
                    invalid.set(invalid.get() + 1);
                    return;
                };
                let own = children.slot_of(role, status);
                if own.is_none() && (role != Role::Actor || !attached.contains(&id)) {
                    return; // From a process that was replaced.
                }
                if let Some(slot) = own {
                    slot.on_status(status);
                }
                if role == Role::Actor {
                    audit.on_status(status);
                    throughput.borrow_mut().on_status(status, Instant::now());
                }
                progress.borrow_mut().on_status(role, status);
                statuses.insert((role, status.id), (*status, Instant::now()));
            },
            |metric| {
                let name = metric.name();
                let mut throughput = throughput.borrow_mut();
                throughput.on_metric(&name, metric.step, Instant::now());
                progress.borrow_mut().on_metric(&name, metric.value);
                metrics.add(metric);
            },
            |result| {
                let valid = result.success <= 1
                    && result.fell <= 1
                    && result.steps <= most_steps
                    && result.nearest.is_finite()
                    && (result.actor as usize) < MAX_ACTORS;
                // Results of an earlier round may be late.
                if !valid || result.round != directive.round || directive.is_done(result.episode) {
                    invalid.set(invalid.get() + u64::from(!valid));
                    return;
                }
                directive.mark_done(result.episode);
                changed = true;
                if directive.phase() == Phase::Evaluate
                    && let Some(slot) = results.get_mut(result.episode as usize)
                {
                    *slot = Some(*result);
                }
            },
        );
        *refused += invalid.get();
        if changed {
            self.directives.publish(&self.directive)?;
        }
        Ok(())
    }

    /// Polls the processes, and keeps a failure that ends the run.
    pub(super) fn poll_children(&mut self, stopping: bool) -> anyhow::Result<()> {
        for (i, ended) in self.children.poll(stopping)? {
            let slot = &self.children.slots[i];
            let (name, role, id) = (slot.name(), slot.role, slot.id);
            match ended {
                Ended::Finished => continue,
                Ended::Restarting(why) => {
                    self.progress
                        .print(&format!("{name} {why}; starting it again"));
                    if self.config.run.deterministic && LEARNERS.contains(&role) {
                        self.children.hold(&LEARNERS);
                        self.rewinding = true;
                    }
                }
                Ended::GivenUp(why) => {
                    self.progress
                        .print(&format!("{name} {why}; going on without it"));
                }
                Ended::Failed(Failure { why, input }) => {
                    let why = format!("{name} {why}");
                    self.failure.get_or_insert(Failure { why, input });
                }
            }
            // The last statuses of actors still count.
            if role != Role::Actor {
                self.statuses.remove(&(role, id));
            }
        }
        Ok(())
    }
}
