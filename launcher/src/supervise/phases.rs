//! Phases of a run, from training to the last episode of the evaluation.

use std::time::{Duration, Instant};

use wire::{Directive, GRAPH, Phase, Role, State, Status, Versions};

use super::run::{LEARNERS, Run, rounds_learned};

impl Run<'_> {
    /// Starts the next part of the run when it is due. Returns false at the end.
    pub(super) fn advance(&mut self) -> anyhow::Result<bool> {
        match self.directive.phase() {
            Phase::Train if !self.has(State::Trained) => {}
            Phase::Train if !self.trained => {
                self.trained = true;
                self.times.train += lap(&mut self.part_start);
            }
            Phase::Train if !self.config.offline => return Ok(false),
            Phase::Train if self.config.run.deterministic => self.next_round()?,
            Phase::Train => {
                if self.part_start.elapsed().as_secs_f64() >= self.config.rollouts.seconds {
                    self.publish_phase(Phase::Settle)?;
                }
            }
            Phase::Settle => {
                if self.settle()? {
                    let passed = lap(&mut self.part_start);
                    if !self.settled {
                        self.times.rollouts += passed;
                    }
                    self.settled = true;
                    self.evaluate()?;
                }
            }
            Phase::Evaluate if self.results.iter().all(Option::is_some) => {
                self.times.evaluate += lap(&mut self.part_start);
                return Ok(false);
            }
            Phase::Evaluate | Phase::Finish => {}
        }
        Ok(true)
    }

    fn publish_phase(&mut self, phase: Phase) -> anyhow::Result<()> {
        self.directive.phase = phase as u32;
        self.directives.publish(&self.directive)?;
        Ok(())
    }

    fn status(&self, role: Role) -> Option<&Status> {
        self.statuses.get(&(role, 0)).map(|(status, _)| status)
    }

    /// Whether learner and graph-builder have reached a state.
    fn has(&self, state: State) -> bool {
        let done = |role: Role| {
            self.status(role)
                .is_some_and(|status| status.state >= state as u32)
        };
        done(Role::Learner) && (!self.graph || done(Role::GraphBuilder))
    }

    /// Starts the next round once the previous one was learned from. After the last one, settles.
    fn next_round(&mut self) -> anyhow::Result<()> {
        let learned = |role: Role| {
            self.status(role)
                .is_some_and(|s| s.round >= self.directive.round)
        };
        if !learned(Role::Learner) || (self.graph && !learned(Role::GraphBuilder)) {
            return Ok(());
        }
        let rollouts = &self.config.rollouts;
        if self.directive.round as usize >= rollouts.rounds {
            // The final graph is not known yet.
            self.directive.versions[GRAPH] = 0;
            return self.publish_phase(Phase::Settle);
        }
        self.request(rollouts.episodes);
        self.directive.round += 1;
        self.progress.print(&format!(
            "round {} of {}: {} episodes",
            self.directive.round, rollouts.rounds, rollouts.episodes
        ));
        self.publish_phase(Phase::Train)
    }

    /// Settles the graph first, then the weights on it. Returns whether both are final.
    fn settle(&mut self) -> anyhow::Result<bool> {
        if self.graph && self.directive.versions[GRAPH] == 0 {
            let settled = State::Settled as u32;
            let builder = self.status(Role::GraphBuilder);
            if let Some(status) = builder.filter(|status| status.state == settled) {
                self.directive.versions[GRAPH] = status.versions[GRAPH];
                self.publish_phase(Phase::Settle)?;
            }
        }
        Ok(self.has(State::Settled))
    }

    /// Requests episodes with the newest weights and graph.
    fn request(&mut self, episodes: usize) {
        let versions = self.status(Role::Learner).map(|status| status.versions);
        self.directive = Directive {
            phase: self.directive.phase,
            round: self.directive.round,
            episodes: episodes as u32,
            versions: versions.unwrap_or_default(),
            ..Directive::default()
        };
    }

    fn evaluate(&mut self) -> anyhow::Result<()> {
        self.request(self.config.evaluation.episodes);
        self.directive.round = 0;
        let Directive {
            episodes, versions, ..
        } = self.directive;
        if versions != self.evaluated {
            self.results.fill(None);
            self.evaluated = versions;
        }
        // Results with the same weights, from before the run was stopped, are kept.
        for result in self.results.iter().flatten() {
            self.directive.mark_done(result.episode);
        }
        let known = self.results.iter().flatten().count();
        let known = match known {
            0 => String::new(),
            _ => format!(", {known} of them known"),
        };
        self.progress.print(&format!(
            "evaluate: {episodes} episodes with {}{known}",
            self.named(&versions)
        ));
        self.publish_phase(Phase::Evaluate)
    }

    /// Versions with the names of their parts.
    fn named(&self, versions: &Versions) -> String {
        let networks = self.plan.networks().into_iter().zip(versions);
        let networks = networks.map(|(network, version)| format!("{} {version}", network.name));
        let graph = self.graph.then(|| format!("graph {}", versions[GRAPH]));
        networks.chain(graph).collect::<Vec<_>>().join(", ")
    }

    /// In rounds, learner and graph-builder restart together after one of them died, from the last round that
    /// both have learned from. Returns false until both have ended.
    pub(super) fn is_rewound(&mut self) -> anyhow::Result<bool> {
        if !self.rewinding {
            return Ok(true);
        }
        if !self.children.are_gone(&LEARNERS) {
            return Ok(false);
        }
        self.directive = Directive {
            round: rounds_learned(self.config, self.plan, self.folder),
            ..Directive::default()
        };
        self.directives.publish(&self.directive)?;
        self.statuses.retain(|(role, _), _| *role == Role::Actor);
        self.children.release(&LEARNERS);
        self.rewinding = false;
        Ok(true)
    }
}

/// Time since `start`, which is set to now.
fn lap(start: &mut Instant) -> Duration {
    let passed = start.elapsed();
    *start = Instant::now();
    passed
}
