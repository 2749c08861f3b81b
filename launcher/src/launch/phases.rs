//! What a run does when: from training to the evaluation's last episode.

use std::time::{Duration, Instant};

use config::Kind;
use wire::{Directive, Phase, Role, State, Status};

use super::{LEARNERS, Run, rounds_learned};

impl Run<'_> {
    /// Goes on to the next part when its time has come; false when all is done.
    pub(super) fn advance(&mut self) -> anyhow::Result<bool> {
        match self.directive.phase() {
            Phase::Train if !self.has(State::Trained) => {}
            Phase::Train if !self.trained => {
                self.trained = true;
                self.times.train += lap(&mut self.began);
            }
            Phase::Train if self.config.run.kind == Kind::Walker => return Ok(false),
            Phase::Train if self.config.run.deterministic => self.next_round()?,
            Phase::Train => {
                if self.began.elapsed().as_secs_f64() >= self.config.rollouts.seconds {
                    self.turn(Phase::Settle)?;
                }
            }
            Phase::Settle => {
                if self.settle()? {
                    let passed = lap(&mut self.began);
                    if !self.settled {
                        self.times.rollouts += passed;
                    }
                    self.settled = true;
                    self.evaluate()?;
                }
            }
            Phase::Evaluate if self.results.iter().all(Option::is_some) => {
                self.times.evaluate += lap(&mut self.began);
                return Ok(false);
            }
            Phase::Evaluate | Phase::Finish => {}
        }
        Ok(true)
    }

    fn turn(&mut self, phase: Phase) -> anyhow::Result<()> {
        self.directive.phase = phase as u32;
        self.directives.publish(&self.directive)?;
        Ok(())
    }

    fn status(&self, role: Role) -> Option<&Status> {
        self.statuses.get(&(role, 0)).map(|(status, _)| status)
    }

    /// Whether learner and graph-builder have come as far.
    fn has(&self, state: State) -> bool {
        let done = |role: Role| {
            self.status(role)
                .is_some_and(|status| status.state >= state as u32)
        };
        done(Role::Learner) && (self.config.run.kind == Kind::Walker || done(Role::GraphBuilder))
    }

    /// Begins the next round once the one before is learned from; after the last one, settles.
    fn next_round(&mut self) -> anyhow::Result<()> {
        let learned = |role: Role| {
            self.status(role)
                .is_some_and(|s| s.round >= self.directive.round)
        };
        if !learned(Role::Learner) || !learned(Role::GraphBuilder) {
            return Ok(());
        }
        let rollouts = &self.config.rollouts;
        if self.directive.round as usize >= rollouts.rounds {
            // Of the graph that settles, nothing is known yet.
            self.directive.graph_version = 0;
            return self.turn(Phase::Settle);
        }
        self.ask_for(rollouts.episodes);
        self.directive.round += 1;
        self.progress.say(&format!(
            "round {} of {}: {} episodes",
            self.directive.round, rollouts.rounds, rollouts.episodes
        ));
        self.turn(Phase::Train)
    }

    /// The graph settles first, then the weights on it; whether both have.
    fn settle(&mut self) -> anyhow::Result<bool> {
        if self.directive.graph_version == 0 {
            let settled = State::Settled as u32;
            let builder = self.status(Role::GraphBuilder);
            if let Some(status) = builder.filter(|status| status.state == settled) {
                self.directive.graph_version = status.versions[2];
                self.turn(Phase::Settle)?;
            }
        }
        Ok(self.has(State::Settled))
    }

    /// Asks for episodes with the newest weights and graph.
    fn ask_for(&mut self, episodes: usize) {
        let [low, high, graph] = self.status(Role::Learner).map_or([0; 3], |s| s.versions);
        self.directive = Directive {
            phase: self.directive.phase,
            round: self.directive.round,
            episodes: episodes as u32,
            low_version: low,
            high_version: high,
            graph_version: graph,
            ..Directive::default()
        };
    }

    fn evaluate(&mut self) -> anyhow::Result<()> {
        self.ask_for(self.config.evaluation.episodes);
        self.directive.round = 0;
        let Directive {
            episodes,
            low_version,
            high_version,
            graph_version,
            ..
        } = self.directive;
        let versions = [low_version, high_version, graph_version];
        if versions != self.evaluated {
            self.results.fill(None);
            self.evaluated = versions;
        }
        // What was played with the same weights before the run was stopped is played.
        for result in self.results.iter().flatten() {
            self.directive.mark_done(result.episode);
        }
        let known = self.results.iter().flatten().count();
        let known = match known {
            0 => String::new(),
            _ => format!(", {known} of them known"),
        };
        self.progress.say(&format!(
            "evaluate: {episodes} episodes with weights {low_version}, {high_version} and graph \
             {graph_version}{known}"
        ));
        self.turn(Phase::Evaluate)
    }

    /// In rounds, one that learns and died is started again together with the other, from the
    /// last round that both have learned from. False while that is under way.
    pub(super) fn rewound(&mut self) -> anyhow::Result<bool> {
        if !self.rewinding {
            return Ok(true);
        }
        if !self.children.are_gone(&LEARNERS) {
            return Ok(false);
        }
        self.directive = Directive {
            round: rounds_learned(self.config, self.folder),
            ..Directive::default()
        };
        self.directives.publish(&self.directive)?;
        self.statuses.retain(|(role, _), _| *role == Role::Actor);
        self.children.release(&LEARNERS);
        self.rewinding = false;
        Ok(true)
    }
}

/// Time since a moment, which moves on to now.
fn lap(began: &mut Instant) -> Duration {
    let passed = began.elapsed();
    *began = Instant::now();
    passed
}
