//! Rollouts of the hierarchy: while training, between random places with sampled subgoals; in
//! evaluation, the paper's protocol.

use std::path::Path;
use std::time::{Duration, Instant};

use agents::navigator::{Choosing, Navigator};
use config::Config;
use maze::{
    AntMaze, FALLEN, Layout, Observation, Physics, Style, Task, evaluation_task, random_task,
    upright,
};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use trace::StepRecord;
use wire::{
    Bus, Claim, Directive, DirectiveSubscriber, Drained, EpisodeResult, Metric, Phase, Reporter,
    Role, State, Status, TrajectoryHeader, TrajectorySender, Transition, flags,
};

use crate::PULSE;
use crate::inbox::{Inbox, Versions};
use crate::traces::{Numbered, Traces};

/// Rows of a trajectory, its final row included.
pub(crate) const TRAJECTORY_STEPS: usize = 129;

struct Actor<'a> {
    config: &'a Config,
    layout: &'a Layout,
    id: u32,
    ant: AntMaze,
    inbox: Inbox,
    navigator: Option<Navigator>,
    /// Versions that the navigator is of.
    versions: Versions,
    /// Versions that it was made for, where they were given.
    wanted: Option<Versions>,
    sender: TrajectorySender,
    directives: DirectiveSubscriber,
    reporter: Reporter,
    status: Status,
    pulse: Instant,
    record: Vec<Transition>,
    episode: u64,
    /// The round that the episode is of, 0 for none.
    round: u32,
    traces: Traces<'a>,
    stopped: &'a dyn Fn() -> bool,
}

/// How an episode ended.
struct Ended {
    success: bool,
    fell: bool,
    steps: usize,
    nearest: f32,
    edges: [u32; 2],
    /// Broken off, since the phase changed or the process shall stop.
    broken: bool,
}

impl Ended {
    fn result(&self, actor: u32, episode: u32, round: u32) -> EpisodeResult {
        EpisodeResult {
            actor,
            episode,
            round,
            success: u32::from(self.success),
            fell: u32::from(self.fell),
            steps: self.steps as u32,
            nearest: self.nearest,
            edges: self.edges,
        }
    }
}

/// What an episode is played for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Purpose {
    /// To learn from, with choices by their probabilities.
    Train,
    /// To see how well it goes, while training.
    Test,
    /// For the score.
    Evaluate,
}

impl Purpose {
    fn phase(self) -> Phase {
        match self {
            Self::Train | Self::Test => Phase::Train,
            Self::Evaluate => Phase::Evaluate,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Train => "training",
            Self::Test => "test",
            Self::Evaluate => "evaluation",
        }
    }
}

pub(crate) fn run(
    config: &Config,
    layout: &Layout,
    folder: &Path,
    bus: &Bus,
    claim: Claim,
    stopped: &dyn Fn() -> bool,
) -> anyhow::Result<Drained> {
    let id = claim.actor;
    let reporter = Reporter::new(bus)?;
    let status = Status {
        role: Role::Actor as u32,
        id,
        ..Status::default()
    };
    reporter.status(&status);
    let sender = TrajectorySender::connect(bus, claim, Duration::from_secs(120), stopped)?;
    let Some(sender) = sender else {
        return Ok(Drained::NOTHING);
    };
    let mut actor = Actor {
        config,
        layout,
        id,
        ant: AntMaze::new(layout, Physics::MAZE),
        inbox: Inbox::new(config, bus)?,
        navigator: None,
        versions: [0; 3],
        wanted: None,
        sender,
        directives: DirectiveSubscriber::new(bus)?,
        reporter,
        status,
        pulse: Instant::now(),
        record: Vec::with_capacity(TRAJECTORY_STEPS),
        episode: 0,
        round: 0,
        traces: Traces::new(config, layout, folder, id)?,
        stopped,
    };
    actor.status.state = State::Waiting as u32;
    actor.reporter.status(&actor.status);
    actor.work()?;
    let drained = actor.sender.drain(Duration::from_secs(3));
    actor.status.sent = drained.transitions;
    actor.status.acknowledged = actor.sender.acknowledged();
    if drained.acknowledged {
        actor.status.state = State::Finished as u32;
    }
    actor.reporter.status(&actor.status);
    if !stopped() {
        anyhow::ensure!(
            drained.acknowledged,
            "not all trajectories were acknowledged"
        );
    }
    Ok(drained)
}

impl Actor<'_> {
    fn work(&mut self) -> anyhow::Result<()> {
        let mut rng =
            Pcg64Mcg::seed_from_u64((self.config.run.seed << 16) + 0x5eed + u64::from(self.id));
        let mut unreported: Option<EpisodeResult> = None;
        loop {
            if (self.stopped)() {
                return Ok(());
            }
            self.pulse();
            let directive = self.directives.latest();
            // Only rounds and the evaluation have episodes by number, and versions of their own.
            let numbered = match directive.phase() {
                Phase::Finish => return Ok(()),
                Phase::Evaluate => true,
                Phase::Train => self.config.run.deterministic && directive.round > 0,
                Phase::Settle => false,
            };
            let wanted = numbered.then_some([
                directive.low_version,
                directive.high_version,
                directive.graph_version,
            ]);
            // What does not fit together yet is left for what does.
            if (self.inbox.look() || wanted != self.wanted)
                && let Some((navigator, versions)) = self.inbox.navigator(self.config, wanted)
            {
                self.navigator = Some(navigator);
                self.versions = versions;
                self.status.versions = versions;
                self.wanted = wanted;
            }
            let numbered = match directive.phase() {
                _ if numbered => {
                    self.navigator.is_some() && wanted.is_some_and(|w| w == self.versions)
                }
                Phase::Train if !self.config.run.deterministic && self.navigator.is_some() => {
                    self.status.state = State::Working as u32;
                    self.roll_out(&mut rng)?;
                    continue;
                }
                _ => false,
            };
            unreported = unreported.filter(|result| {
                result.round == directive.round && !directive.is_done(result.episode)
            });
            if let Some(result) = &unreported {
                // Sent again until the launcher's directive shows it.
                self.reporter.result(result);
                self.sender.wait(Duration::from_millis(50));
                continue;
            }
            match self.next_episode(&directive).filter(|_| numbered) {
                Some(episode) => {
                    self.status.state = State::Working as u32;
                    unreported = if directive.phase() == Phase::Evaluate {
                        self.evaluate(episode)?
                    } else {
                        self.play_of_round(&directive, episode)?
                    };
                }
                None => self.rest(),
            }
        }
    }

    /// A training episode, or a test now and then: by the evaluation's protocol, with the weights
    /// of the hour.
    fn roll_out(&mut self, rng: &mut Pcg64Mcg) -> anyhow::Result<()> {
        self.episode += 1;
        let every = self.config.rollouts.test_every as u64;
        if every > 0 && self.episode.is_multiple_of(every) {
            let task = evaluation_task(self.layout, rng);
            let ended = self.play(&task, Purpose::Test, rng)?;
            self.report_test(&ended);
            return Ok(());
        }
        let task = random_task(self.layout, Style::Diverse, rng);
        self.play(&task, Purpose::Train, rng)?;
        Ok(())
    }

    fn report_test(&self, ended: &Ended) {
        if !ended.broken {
            let score = 100.0 * f64::from(u8::from(ended.success));
            let step = self.status.steps;
            let metric = Metric::new(Role::Actor, self.id, "rollout/score", step, score);
            self.reporter.metric(&metric);
        }
    }

    /// An episode of a round: the same whoever plays it.
    fn play_of_round(
        &mut self,
        directive: &Directive,
        episode: u32,
    ) -> anyhow::Result<Option<EpisodeResult>> {
        let round = directive.round;
        let seed = (self.config.run.seed << 32) + (u64::from(round) << 12) + u64::from(episode);
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed << 48);
        (self.round, self.episode) = (round, u64::from(episode));
        let every = self.config.rollouts.test_every as u32;
        let test = every > 0 && (episode + 1).is_multiple_of(every);
        let (task, purpose) = if test {
            (evaluation_task(self.layout, &mut rng), Purpose::Test)
        } else {
            let task = random_task(self.layout, Style::Diverse, &mut rng);
            (task, Purpose::Train)
        };
        let ended = self.play(&task, purpose, &mut rng)?;
        self.round = 0;
        if test {
            self.report_test(&ended);
        }
        if ended.broken {
            return Ok(None);
        }
        let result = ended.result(self.id, episode, round);
        self.reporter.result(&result);
        Ok(Some(result))
    }

    fn rest(&mut self) {
        self.status.state = State::Waiting as u32;
        self.status.place = [f32::NAN; 2];
        self.sender.wait(Duration::from_millis(100));
    }

    fn pulse(&mut self) {
        if self.pulse.elapsed() > PULSE {
            self.status.sent = self.sender.transitions();
            self.status.acknowledged = self.sender.acknowledged();
            self.status.refused =
                self.sender.refused() + self.inbox.refused() + self.directives.refused();
            self.reporter.status(&self.status);
            self.pulse = Instant::now();
        }
    }

    /// The next episode that is not done: of this actor's share, every `actors`-th, from the
    /// first on; then, and for actors that are attached, of the others' from the last on, which
    /// they come to last. An episode that two play is the same twice.
    fn next_episode(&self, directive: &Directive) -> Option<u32> {
        let actors = self.config.topology.actors as u32;
        let open = |i: &u32| !directive.is_done(*i);
        let own = (self.id < actors)
            .then(|| (self.id..directive.episodes).step_by(actors as usize))
            .and_then(|mut share| share.find(open));
        own.or_else(|| (0..directive.episodes).rev().find(open))
    }

    fn evaluate(&mut self, episode: u32) -> anyhow::Result<Option<EpisodeResult>> {
        // Episodes are the same whichever actor runs them.
        let seed = (self.config.run.seed << 20) + 0xe0a1 + u64::from(episode);
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let task = evaluation_task(self.layout, &mut rng);
        self.episode = u64::from(episode);
        let ended = self.play(&task, Purpose::Evaluate, &mut rng)?;
        if ended.broken {
            return Ok(None);
        }
        let result = ended.result(self.id, episode, 0);
        self.reporter.result(&result);
        Ok(Some(result))
    }

    /// Plays one episode and sends its trajectories.
    fn play(&mut self, task: &Task, purpose: Purpose, rng: &mut Pcg64Mcg) -> anyhow::Result<Ended> {
        let choosing = if purpose == Purpose::Train {
            Choosing::Sampled
        } else {
            Choosing::Greedy
        };
        let radius = self.config.evaluation.success_radius as f32;
        let limit = self.config.evaluation.max_steps;
        let patience = self.config.execution.max_edge_steps;
        let start = self.ant.reset(task.start, rng);
        let numbered = self.numbered(purpose);
        if let Some(navigator) = &mut self.navigator {
            navigator.begin(task.goal);
            let versions = self.versions;
            self.traces
                .begin(numbered, purpose.name(), task, &start, navigator, versions);
        }
        let mut ended = Ended {
            success: false,
            fell: false,
            steps: 0,
            nearest: f32::INFINITY,
            edges: [0; 2],
            broken: false,
        };
        let mut observation = self.ant.observation();
        for step in 0..limit {
            let Some(navigator) = &mut self.navigator else {
                break;
            };
            let decision = navigator.decide(&observation, choosing, rng);
            let goal_node = navigator.goal_node();
            let traced = self
                .traces
                .decided(step, &observation, &decision, navigator, &self.ant);
            let mut bits = match decision.outcome {
                Some(outcome) if outcome.reached => flags::REACHED,
                Some(_) => flags::FAILED,
                None => 0,
            };
            // An edge is settled within the trajectory that it was chosen in, where it can be.
            let room = TRAJECTORY_STEPS - self.record.len();
            if decision.chosen.is_some() && !self.record.is_empty() && room < 2 + patience {
                ended.broken = !self.send(&observation, (decision.node, bits), step, purpose)?;
                if ended.broken {
                    break;
                }
            }
            let before = observation;
            self.ant.step(&decision.action);
            observation = self.ant.observation();
            self.status.steps += 1;
            self.status.place = [observation[0], observation[1]];
            ended.steps = step + 1;
            let distance = (task.goal[0] - observation[0]).hypot(task.goal[1] - observation[1]);
            ended.nearest = ended.nearest.min(distance);
            ended.success = distance <= radius;
            ended.fell = upright(&observation) < FALLEN;
            if let Some(outcome) = decision.outcome {
                ended.edges[0] += 1;
                ended.edges[1] += u32::from(outcome.reached);
            }
            bits |= if decision.chosen.is_some() {
                flags::CHOICE
            } else {
                0
            };
            bits |= if ended.fell { flags::FELL } else { 0 };
            bits |= if purpose == Purpose::Train {
                0
            } else {
                flags::TEST
            };
            // In training a fallen ant has nothing more to teach.
            let given_up = ended.fell && purpose == Purpose::Train;
            let last = ended.success || given_up || step + 1 == limit;
            if ended.success {
                bits |= flags::SUCCESS | flags::TERMINAL;
            } else if last {
                bits |= flags::TRUNCATED;
            }
            let reward = f32::from(u8::from(ended.success));
            if let Some(record) = traced {
                self.traces.step(StepRecord { reward, ..record });
            }
            self.record.push(Transition {
                observation: before,
                action: decision.action,
                goal: task.goal,
                reward,
                log_prob: decision.chosen.map_or(0.0, |chosen| chosen.log_prob),
                node: decision.node as i32,
                subgoal: decision.subgoal.map_or(-1, |node| node as i32),
                goal_node: goal_node as i32,
                flags: bits,
            });
            if last || self.record.len() + 1 >= TRAJECTORY_STEPS {
                ended.broken = !self.send(&observation, (u32::MAX, 0), step + 1, purpose)?;
            }
            if last || ended.broken {
                break;
            }
            self.pulse();
        }
        if ended.broken {
            self.traces.discard();
        } else {
            self.traces.end(ended.success, &observation, &self.ant);
        }
        Ok(ended)
    }

    /// The episode under way, by its number.
    fn numbered(&self, purpose: Purpose) -> Numbered {
        match (purpose, self.round) {
            (Purpose::Evaluate, _) => Numbered::Evaluation(self.episode as u32),
            (_, 0) => Numbered::Own(self.episode),
            (_, round) => Numbered::Round(round, self.episode as u32),
        }
    }

    /// Sends the record so far, which ends before `step` of the episode, with its final row: the
    /// observation, node and outcome there. False when the episode is to be broken off.
    fn send(
        &mut self,
        after: &Observation,
        (node, outcome): (u32, u32),
        step: usize,
        purpose: Purpose,
    ) -> anyhow::Result<bool> {
        let first_step = (step - self.record.len()) as u32;
        self.record.push(Transition {
            observation: *after,
            node: i32::try_from(node).unwrap_or(-1),
            flags: flags::FINAL | outcome,
            ..Transition::default()
        });
        while !self.sender.wait_credit(Duration::from_millis(200)) {
            self.reporter.status(&self.status);
            if (self.stopped)() || self.directives.latest().phase() == Phase::Finish {
                self.record.clear();
                return Ok(false);
            }
        }
        let [low, high, graph] = self.versions;
        let header = TrajectoryHeader {
            episode: self.episode,
            first_step,
            round: self.round,
            low_version: low,
            weights_version: high,
            graph_version: graph,
            ..TrajectoryHeader::default()
        };
        let record = &self.record;
        self.sender
            .send_with(header, record.len(), |row| record[row])?;
        self.record.clear();
        Ok(!(self.stopped)() && self.directives.latest().phase() == purpose.phase())
    }
}
