//! An actor's work: rollouts while training, numbered episodes in rounds and in the evaluation.

use std::path::Path;
use std::time::{Duration, Instant};

use agents::{Plan, Policy, stream};
use anyhow::Context;
use config::Config;
use maze::Layout;
use rand_pcg::Pcg64Mcg;
use simulator::{Simulator, Task, Tasks};
use wire::{
    Bus, Claim, Directive, DirectiveSubscriber, Drained, EpisodeResult, Metric, Phase, Reporter,
    Role, State, Status, TrajectoryHeader, TrajectorySender, Versions,
};

use crate::episode::{Bounds, Environment, Next, Purpose, Tally};
use crate::inbox::Inbox;
use crate::traces::{Numbered, Traces};

/// Time between two words on how it is and where its body is.
const PULSE: Duration = Duration::from_millis(200);

/// One of the actor's environments, with the policy of its episode.
struct Slot {
    environment: Environment,
    policy: Option<Box<dyn Policy>>,
    /// Versions that the policy is of.
    versions: Versions,
    /// An episode is under way.
    playing: bool,
    episode: u64,
}

pub(crate) struct Actor<'a> {
    config: &'a Config,
    id: u32,
    inbox: Inbox<'a>,
    slots: Vec<Slot>,
    /// Newer weights act from the next trajectory on.
    renewed: bool,
    /// Versions that policies were asked for, where they were given.
    wanted: Option<Versions>,
    sender: TrajectorySender,
    directives: DirectiveSubscriber,
    reporter: Reporter,
    status: Status,
    pulse: Instant,
    episodes: u64,
    /// The round that the episode is of, 0 for none.
    round: u32,
    traces: Traces<'a>,
    stopped: &'a dyn Fn() -> bool,
}

/// How a played episode came out; nothing where it was broken off, since the phase changed or the
/// process shall stop.
type Played = Option<Tally>;

pub(crate) fn run(
    config: &Config,
    plan: &dyn Plan,
    (layout, folder): (&Layout, &Path),
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
        id,
        inbox: Inbox::new(plan, bus)?,
        slots: slots(config, plan, layout, id)?,
        renewed: plan.environments().renewed,
        wanted: None,
        sender,
        directives: DirectiveSubscriber::new(bus)?,
        reporter,
        status,
        pulse: Instant::now(),
        episodes: 0,
        round: 0,
        traces: Traces::new(config, plan, layout, folder, id)?,
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

/// The actor's environments.
fn slots(config: &Config, plan: &dyn Plan, layout: &Layout, id: u32) -> anyhow::Result<Vec<Slot>> {
    let environments = plan.environments();
    let bounds = Bounds {
        steps: environments
            .episode_steps
            .unwrap_or(config.evaluation.max_steps),
        rows: environments.trajectory_rows,
        choice_words: plan.choice_words(),
    };
    let slot = |number: usize| {
        let simulator = match plan.simulator(layout, number) {
            Some(simulator) => simulator,
            None => simulator(config, layout)?,
        };
        let index = u64::from(id) << 32 | number as u64;
        let rng = stream(config.run.seed, "rollouts", index);
        Ok(Slot {
            environment: Environment::new(simulator, rng, bounds),
            policy: None,
            versions: [0; wire::PARTS],
            playing: false,
            episode: 0,
        })
    };
    (0..environments.number).map(slot).collect()
}

/// An instance of the run's simulator.
///
/// # Errors
/// A simulator that this version does not have.
fn simulator(config: &Config, layout: &Layout) -> anyhow::Result<Box<dyn Simulator>> {
    let radius = config.evaluation.success_radius as f32;
    let simulator = simulators::create(&config.run.simulator, layout, radius);
    simulator.with_context(|| format!("no simulator '{}'", config.run.simulator))
}

impl Actor<'_> {
    fn work(&mut self) -> anyhow::Result<()> {
        let mut unreported: Option<EpisodeResult> = None;
        while !(self.stopped)() {
            self.pulse();
            let directive = self.directives.latest();
            let phase = directive.phase();
            // Only rounds and the evaluation have episodes by number, and versions of their own.
            let deterministic = self.config.run.deterministic;
            let numbered = match phase {
                Phase::Finish => return Ok(()),
                Phase::Evaluate => true,
                Phase::Train => deterministic && directive.round > 0,
                Phase::Settle => false,
            };
            let wanted = numbered.then_some(directive.versions);
            self.renew(wanted);
            if phase == Phase::Train && !deterministic {
                if self.roll_out()? {
                    continue;
                }
            } else {
                self.break_off();
            }
            unreported = unreported.filter(|result| {
                result.round == directive.round && !directive.is_done(result.episode)
            });
            if let Some(result) = &unreported {
                // Sent again until the launcher's directive shows it.
                self.reporter.result(result);
                self.sender.wait(Duration::from_millis(50));
                continue;
            }
            let ready = wanted.is_some_and(|wanted| {
                self.slots[0].policy.is_some() && self.slots[0].versions == wanted
            });
            match self.next_episode(&directive).filter(|_| ready) {
                Some(episode) => {
                    self.status.state = State::Working as u32;
                    unreported = self.play_numbered(&directive, episode)?;
                }
                None => self.rest(),
            }
        }
        Ok(())
    }

    /// Takes newer weights and graphs; policies of episodes under way stay as they are.
    fn renew(&mut self, wanted: Option<Versions>) {
        // What does not fit together yet is left for what does.
        if self.inbox.look() || wanted != self.wanted {
            let renewed = self.renewed;
            let free = self.slots.iter_mut();
            for slot in free.filter(|slot| renewed || !slot.playing) {
                if let Some((policy, versions)) = self.inbox.policy(wanted.as_ref()) {
                    slot.policy = Some(policy);
                    slot.versions = versions;
                    self.status.versions = versions;
                    self.wanted = wanted;
                }
            }
        }
    }

    /// Plays every environment up to its next trajectory. Returns whether there is a policy to play.
    fn roll_out(&mut self) -> anyhow::Result<bool> {
        let mut played = false;
        for number in 0..self.slots.len() {
            if self.slots[number].policy.is_none() {
                continue;
            }
            played = true;
            self.status.state = State::Working as u32;
            if !self.slots[number].playing {
                self.begin_rollout(number);
            }
            if let Some(tally) = self.advance(number)? {
                self.end_rollout(number, &tally);
            }
            if (self.stopped)() || self.directives.latest().phase() != Phase::Train {
                break;
            }
        }
        Ok(played)
    }

    /// Begins a training episode, or a test now and then: by the evaluation's protocol, with the
    /// weights at the moment.
    fn begin_rollout(&mut self, number: usize) {
        self.episodes += 1;
        let every = self.config.rollouts.test_every as u64;
        let test = self.config.offline && every > 0 && self.episodes.is_multiple_of(every);
        let (tasks, purpose) = if test {
            (Tasks::Evaluation, Purpose::Test)
        } else {
            (Tasks::Training, Purpose::Train)
        };
        let slot = &mut self.slots[number];
        let environment = &mut slot.environment;
        let task = environment.simulator.draw(tasks, &mut environment.rng);
        slot.episode = self.episodes;
        self.begin(number, &task, purpose);
    }

    fn end_rollout(&mut self, number: usize, tally: &Tally) {
        if self.slots[number].environment.purpose == Purpose::Test {
            self.report_test(tally);
        }
        // The newest parts act from here on, where they could not before.
        if let Some((policy, versions)) = self.inbox.policy(None)
            && versions != self.slots[number].versions
        {
            let slot = &mut self.slots[number];
            slot.policy = Some(policy);
            slot.versions = versions;
            self.status.versions = versions;
        }
    }

    fn report_test(&self, tally: &Tally) {
        let score = 100.0 * f64::from(u8::from(tally.success));
        let step = self.status.steps;
        let metric = Metric::new(Role::Actor, self.id, "rollout/score", step, score);
        self.reporter.metric(&metric);
    }

    /// Breaks off the training episodes that are under way.
    fn break_off(&mut self) {
        for (number, slot) in self.slots.iter_mut().enumerate() {
            if std::mem::take(&mut slot.playing) {
                slot.environment.clear();
                if number == 0 {
                    self.traces.discard();
                }
            }
        }
    }

    /// An episode of a round or of the evaluation: the same whoever plays it.
    fn play_numbered(
        &mut self,
        directive: &Directive,
        episode: u32,
    ) -> anyhow::Result<Option<EpisodeResult>> {
        let evaluation = directive.phase() == Phase::Evaluate;
        let round = if evaluation { 0 } else { directive.round };
        let every = self.config.rollouts.test_every as u32;
        let test = !evaluation && every > 0 && (episode + 1).is_multiple_of(every);
        let (tasks, purpose) = match (evaluation, test) {
            (true, _) => (Tasks::Evaluation, Purpose::Evaluate),
            (false, true) => (Tasks::Evaluation, Purpose::Test),
            (false, false) => (Tasks::Training, Purpose::Train),
        };
        let index = u64::from(round) << 32 | u64::from(episode);
        let rng = stream(self.config.run.seed, purpose.name(), index);
        self.round = round;
        let played = self.play(rng, tasks, purpose, u64::from(episode));
        self.round = 0;
        let Some(tally) = played? else {
            return Ok(None);
        };
        if test {
            self.report_test(&tally);
        }
        let result = EpisodeResult {
            actor: self.id,
            episode,
            round,
            success: u32::from(tally.success),
            fell: u32::from(tally.fell),
            steps: tally.steps as u32,
            nearest: tally.nearest,
            choices: tally.choices,
        };
        self.reporter.result(&result);
        Ok(Some(result))
    }

    /// Plays an episode in the first environment, from a generator of its own.
    fn play(
        &mut self,
        rng: Pcg64Mcg,
        tasks: Tasks,
        purpose: Purpose,
        episode: u64,
    ) -> anyhow::Result<Played> {
        let slot = &mut self.slots[0];
        slot.episode = episode;
        slot.environment.rng = rng;
        let environment = &mut slot.environment;
        let task = environment.simulator.draw(tasks, &mut environment.rng);
        self.begin(0, &task, purpose);
        while self.slots[0].playing {
            if let Some(tally) = self.advance(0)? {
                return Ok(Some(tally));
            }
        }
        Ok(None)
    }

    fn begin(&mut self, number: usize, task: &Task, purpose: Purpose) {
        let round = self.round;
        let slot = &mut self.slots[number];
        let Some(policy) = &mut slot.policy else {
            return;
        };
        slot.environment.begin(&mut **policy, task, purpose);
        slot.playing = true;
        if number == 0 {
            let numbered = match (purpose, round) {
                (Purpose::Evaluate, _) => Numbered::Evaluation(slot.episode as u32),
                (_, 0) => Numbered::Own(slot.episode),
                (_, round) => Numbered::Round(round, slot.episode as u32),
            };
            let simulator = &*slot.environment.simulator;
            self.traces.begin(
                numbered,
                purpose,
                task,
                simulator,
                &**policy,
                &slot.versions,
            );
        }
    }

    /// Plays an environment up to its next trajectory. Returns how the episode ended, once it has.
    fn advance(&mut self, number: usize) -> anyhow::Result<Played> {
        loop {
            let slot = &mut self.slots[number];
            let Some(policy) = slot.policy.as_deref_mut().filter(|_| slot.playing) else {
                return Ok(None);
            };
            let traced = number == 0;
            let environment = &mut slot.environment;
            if environment.decide(policy) && !self.send(number)? {
                return Ok(None);
            }
            let slot = &mut self.slots[number];
            let Some(policy) = slot.policy.as_deref_mut() else {
                return Ok(None);
            };
            let environment = &mut slot.environment;
            let record = match traced {
                true => self.traces.decided(environment, policy),
                false => None,
            };
            let (step, next) = environment.step(policy);
            if let Some(record) = record {
                self.traces.step(record, step.reward);
            }
            self.status.steps += 1;
            if traced && let Some(observation) = environment.simulator.observation().floats() {
                self.status.place = environment.simulator.body().place(observation);
            }
            if next != Next::Go {
                let tally = environment.tally;
                let sent = self.send(number)?;
                if next == Next::End && sent {
                    self.slots[number].playing = false;
                    if traced {
                        let simulator = &*self.slots[number].environment.simulator;
                        self.traces.end(tally.success, tally.fell, simulator);
                    }
                    return Ok(Some(tally));
                }
                return Ok(None);
            }
            self.pulse();
        }
    }

    /// Sends the rows so far with their final row. Returns false, and the episode is broken off, where
    /// the phase changed or the process shall stop.
    fn send(&mut self, number: usize) -> anyhow::Result<bool> {
        let slot = &mut self.slots[number];
        slot.environment.close();
        let purpose = slot.environment.purpose;
        let mut stays = true;
        while stays && !self.sender.wait_credit(Duration::from_millis(200)) {
            self.reporter.status(&self.status);
            stays = !(self.stopped)() && self.directives.latest().phase() != Phase::Finish;
        }
        let slot = &mut self.slots[number];
        let environment = &mut slot.environment;
        if stays {
            let rows = environment.rows.rows();
            let steps = rows.len() - 1;
            let header = TrajectoryHeader {
                episode: slot.episode,
                first_step: (environment.tally.steps - steps) as u32,
                environment: number as u32,
                round: self.round,
                versions: slot.versions,
                ..TrajectoryHeader::default()
            };
            self.sender.send(header, rows, &environment.choices)?;
        }
        environment.clear();
        let phase = match purpose {
            Purpose::Train | Purpose::Test => Phase::Train,
            Purpose::Evaluate => Phase::Evaluate,
        };
        let goes_on = stays && !(self.stopped)() && self.directives.latest().phase() == phase;
        if !goes_on {
            self.slots[number].playing = false;
            if number == 0 {
                self.traces.discard();
            }
        }
        Ok(goes_on)
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
}
