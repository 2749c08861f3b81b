//! What processes say, and who of them ended.

use std::cell::{Cell, RefCell};
use std::time::Instant;

use wire::{MAX_ACTORS, Phase, Role};

use super::{LEARNERS, Run};
use crate::children::{Ended, Failure};

impl Run<'_> {
    pub(super) fn read_reports(&mut self) -> anyhow::Result<()> {
        let Self {
            config,
            reports,
            children,
            statuses,
            accounts,
            metrics,
            throughput,
            progress,
            results,
            directive,
            refused,
            ..
        } = self;
        // Both closures tell them.
        let (throughput, progress) = (RefCell::new(throughput), RefCell::new(progress));
        let attached = config.topology.actors..config.topology.max_actors.min(MAX_ACTORS);
        let most_steps = config.evaluation.max_steps as u32;
        let mut news = false;
        let strange = Cell::new(0);
        reports.read(
            |status| {
                let id = status.id as usize;
                let known = Role::from_number(status.role).filter(|_| id < MAX_ACTORS);
                let Some(role) = known else {
                    strange.set(strange.get() + 1);
                    return;
                };
                let own = children.place_of(role, status);
                if own.is_none() && (role != Role::Actor || !attached.contains(&id)) {
                    return; // The last word of a process that was replaced.
                }
                if let Some(place) = own {
                    place.hear(status);
                }
                if role == Role::Actor {
                    accounts.hear(status);
                    throughput.borrow_mut().hear(status, Instant::now());
                }
                progress.borrow_mut().hear(role, status);
                statuses.insert((role, status.id), (*status, Instant::now()));
            },
            |metric| {
                let name = metric.name();
                let mut throughput = throughput.borrow_mut();
                throughput.note(&name, metric.step, Instant::now());
                progress.borrow_mut().note(&name, metric.value);
                metrics.add(metric);
            },
            |result| {
                let sound = result.success <= 1
                    && result.fell <= 1
                    && result.steps <= most_steps
                    && result.nearest.is_finite()
                    && (result.actor as usize) < MAX_ACTORS;
                // Words of an earlier round may come late.
                if !sound || result.round != directive.round || directive.is_done(result.episode) {
                    strange.set(strange.get() + u64::from(!sound));
                    return;
                }
                directive.mark_done(result.episode);
                news = true;
                if directive.phase() == Phase::Evaluate
                    && let Some(slot) = results.get_mut(result.episode as usize)
                {
                    *slot = Some(*result);
                }
            },
        );
        *refused += strange.get();
        if news {
            self.directives.publish(&self.directive)?;
        }
        Ok(())
    }

    /// Looks after the children; a failure that ends the run is noted.
    pub(super) fn tend(&mut self, stopping: bool) -> anyhow::Result<()> {
        for (i, ended) in self.children.tend(stopping)? {
            let place = &self.children.places[i];
            let (name, role, id) = (place.name(), place.role, place.id);
            match ended {
                Ended::Finished => continue,
                Ended::Restarting(why) => {
                    self.progress
                        .say(&format!("{name} {why}; starting it again"));
                    if self.config.run.deterministic && LEARNERS.contains(&role) {
                        self.children.hold(&LEARNERS);
                        self.rewinding = true;
                    }
                }
                Ended::GivenUp(why) => {
                    self.progress
                        .say(&format!("{name} {why}; going on without it"));
                }
                Ended::Failed(Failure { why, input }) => {
                    let why = format!("{name} {why}");
                    self.failure.get_or_insert(Failure { why, input });
                }
            }
            // Actors' last words still count as steps that were made.
            if role != Role::Actor {
                self.statuses.remove(&(role, id));
            }
        }
        Ok(())
    }
}
