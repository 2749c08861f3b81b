//! Rates per second: of each actor, of all actors, of the stages of the learner.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use agents::Rate;
use config::Config;
use wire::{MAX_ACTORS, Status};

/// Rates are means over this window.
const WINDOW: Duration = Duration::from_secs(3);
/// Rows of metrics are written this often.
const EVERY: Duration = Duration::from_secs(2);
/// Maximum age of a rate.
const STALE: Duration = Duration::from_secs(10);
/// Minimum time between samples of a rate. After the launcher was suspended, waiting messages arrive at
/// once.
const LEAST: Duration = Duration::from_millis(100);

/// The metric of control steps per second of all actors.
pub(crate) const STEPS: &str = "throughput/steps_per_s";

/// Samples of the step count of an actor.
#[derive(Default)]
struct Actor {
    incarnation: u32,
    samples: VecDeque<(Instant, u64)>,
}

impl Actor {
    fn rate(&self, now: Instant) -> f64 {
        let (Some((first, from)), Some((last, to))) = (self.samples.front(), self.samples.back())
        else {
            return 0.0;
        };
        let passed = last.duration_since(*first);
        if now.saturating_duration_since(*last) > WINDOW || passed < LEAST {
            return 0.0;
        }
        to.saturating_sub(*from) as f64 / passed.as_secs_f64()
    }

    /// Adds a count. Of counts that arrive at once only the newest is kept.
    fn add(&mut self, now: Instant, steps: u64) {
        let before = self.samples.len().checked_sub(2);
        let close = |(at, _): &(Instant, u64)| now.saturating_duration_since(*at) < LEAST;
        if before.and_then(|i| self.samples.get(i)).is_some_and(close) {
            self.samples.pop_back();
        }
        self.samples.push_back((now, steps));
        let ago = |at: Instant| now.saturating_duration_since(at);
        // Keeps at least two samples, which make a rate.
        while let (Some((first, _)), Some((second, _))) =
            (self.samples.front(), self.samples.get(1))
            && ago(*first) > WINDOW
            && ago(*second) >= LEAST
        {
            self.samples.pop_front();
        }
    }
}

/// A stage of the learner.
struct Stage {
    /// The metric whose steps count its work.
    counted: &'static str,
    /// The metric to record, and what is counted.
    recorded: Rate,
    newest: Option<(Instant, u64)>,
    /// Newest sample that was recorded.
    written: Option<(Instant, u64)>,
    rate: Option<(Instant, f64)>,
}

impl Stage {
    fn new((counted, recorded): (&'static str, Rate)) -> Self {
        Self {
            counted,
            recorded,
            newest: None,
            written: None,
            rate: None,
        }
    }
}

/// Rates of a run.
pub(crate) struct Throughput {
    actors: BTreeMap<u32, Actor>,
    /// Control steps of all actors, including dead ones.
    steps: u64,
    written: (Instant, u64),
    stages: Vec<Stage>,
}

impl Throughput {
    /// Starts at a number of control steps.
    pub(crate) fn new(config: &Config, steps: u64, now: Instant) -> Self {
        let algorithm = agents::find(&config.run.algorithm);
        let labels = algorithm.map_or(&[][..], |algorithm| algorithm.labels());
        let rates = labels
            .iter()
            .filter_map(|label| Some((label.metric, label.rate?)));
        Self {
            actors: BTreeMap::new(),
            steps,
            written: (now, steps),
            stages: rates.map(Stage::new).collect(),
        }
    }

    /// Adds the status of an actor.
    pub(crate) fn on_status(&mut self, status: &Status, now: Instant) {
        if status.id as usize >= MAX_ACTORS {
            return;
        }
        let actor = self.actors.entry(status.id).or_default();
        let last = actor.samples.back().map_or(0, |(_, steps)| *steps);
        // A new process counts from zero.
        let anew = actor.incarnation != status.incarnation || status.steps < last;
        let more = if anew {
            actor.incarnation = status.incarnation;
            actor.samples.clear();
            status.steps
        } else {
            status.steps - last
        };
        self.steps = self.steps.saturating_add(more);
        actor.add(now, status.steps);
    }

    /// Excludes a duration in which the run was suspended.
    pub(crate) fn skip(&mut self, passed: Duration) {
        for actor in self.actors.values_mut() {
            actor.samples.iter_mut().for_each(|(at, _)| *at += passed);
        }
        self.written.0 += passed;
        for stage in &mut self.stages {
            let counts = [&mut stage.newest, &mut stage.written];
            counts
                .into_iter()
                .flatten()
                .for_each(|(at, _)| *at += passed);
            stage.rate.iter_mut().for_each(|(at, _)| *at += passed);
        }
    }

    /// Adds the step of a metric.
    pub(crate) fn on_metric(&mut self, name: &str, step: u64, now: Instant) {
        let mut stages = self.stages.iter_mut();
        if let Some(stage) = stages.find(|stage| stage.counted == name) {
            stage.newest = Some((now, step));
            stage.written.get_or_insert((now, step));
        }
    }

    /// Control steps per second of an actor.
    pub(crate) fn of_actor(&self, id: u32, now: Instant) -> f64 {
        self.actors.get(&id).map_or(0.0, |actor| actor.rate(now))
    }

    /// Control steps per second of all actors.
    pub(crate) fn of_all(&self, now: Instant) -> f64 {
        self.actors.values().map(|actor| actor.rate(now)).sum()
    }

    /// Rate of the current stage of the learner, and its unit.
    pub(crate) fn of_learner(&self, now: Instant) -> Option<(f64, &'static str)> {
        let fresh = |stage: &Stage| {
            let (at, rate) = stage.rate?;
            (now.saturating_duration_since(at) < STALE).then_some((rate, stage.recorded.unit))
        };
        self.stages.iter().find_map(fresh)
    }

    /// Names, steps and values of the metrics to record, when they are due.
    pub(crate) fn due(&mut self, now: Instant) -> Vec<(&'static str, u64, f64)> {
        let (at, steps) = self.written;
        let passed = now.saturating_duration_since(at);
        if passed < EVERY {
            return vec![];
        }
        self.written = (now, self.steps);
        let rate = (self.steps - steps) as f64 / passed.as_secs_f64();
        let mut rows = vec![(STEPS, self.steps, rate)];
        for stage in &mut self.stages {
            let (Some((then, from)), Some((last, to))) = (stage.written, stage.newest) else {
                continue;
            };
            let passed = last.saturating_duration_since(then);
            if to > from && passed < LEAST {
                continue;
            }
            if to > from {
                let rate = (to - from) as f64 / passed.as_secs_f64();
                stage.rate = Some((now, rate));
                rows.push((stage.recorded.metric, to, rate));
            }
            stage.written = stage.newest;
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn throughput(start: Instant) -> Throughput {
        let text = "[dataset]\npath = \"x\"\n[collect]\n";
        let config = agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap();
        Throughput::new(&config, 0, start)
    }

    fn status(id: u32, incarnation: u32, steps: u64) -> Status {
        Status {
            id,
            incarnation,
            steps,
            ..Status::default()
        }
    }

    #[test]
    fn steps_of_dead_actors_still_count() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = {
            let mut throughput = throughput(start);
            (throughput.steps, throughput.written) = (1000, (start, 1000));
            throughput
        };
        for i in 0..=10 {
            throughput.on_status(&status(0, 5, 100 * i), at(200 * i));
            throughput.on_status(&status(1, 6, 50 * i), at(200 * i));
        }
        assert_eq!(throughput.of_actor(0, at(2000)), 500.0);
        assert_eq!(throughput.of_all(at(2000)), 750.0);
        assert_eq!(throughput.of_all(at(9000)), 0.0, "no status since");
        assert!(throughput.due(at(1999)).is_empty());
        assert_eq!(throughput.due(at(2000)), [(STEPS, 2500, 750.0)]);
        // Another process in place of the first one: its steps are added.
        throughput.on_status(&status(0, 7, 300), at(3000));
        assert_eq!(throughput.due(at(4000)), [(STEPS, 2800, 150.0)]);
        throughput.on_status(&status(0, 7, u64::MAX), at(4100));
        throughput.on_status(&status(u32::MAX, 7, 1), at(4100));
        assert_eq!(throughput.due(at(6000)).len(), 1, "no overflow");
    }

    #[test]
    fn the_rate_of_a_stage_is_that_of_its_metrics_steps() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = throughput(start);
        throughput.on_metric("low/policy_loss", 100, at(500));
        assert_eq!(throughput.of_learner(at(500)), None);
        throughput.on_metric("low/policy_loss", 300, at(1500));
        throughput.on_metric("low/value_loss", 9999, at(1600));
        let rows = throughput.due(at(2000));
        assert_eq!(rows[1..], [("throughput/low_updates_per_s", 300, 200.0)]);
        assert_eq!(throughput.of_learner(at(2000)), Some((200.0, "updates")));
        assert_eq!(throughput.due(at(4000)).len(), 1, "it stands still");
        assert_eq!(throughput.of_learner(at(20_000)), None);
        // The learner was restarted and continues from an earlier checkpoint.
        throughput.on_metric("low/policy_loss", 200, at(4100));
        assert_eq!(throughput.due(at(6000)).len(), 1);
    }

    #[test]
    fn messages_that_arrive_at_once_do_not_change_the_rate() {
        let start = Instant::now();
        let at = |us| start + Duration::from_micros(us);
        let mut throughput = throughput(start);
        for i in 0..=10 {
            throughput.on_status(&status(0, 5, 100 * i), at(200_000 * i));
            throughput.on_metric("low/policy_loss", 100 * i, at(200_000 * i));
        }
        throughput.due(at(2_000_000));
        // The launcher was suspended for 14 s, and reads all waiting messages.
        for i in 0..100 {
            throughput.on_status(&status(0, 5, 1000 + 70 * i), at(16_000_000 + i));
            throughput.on_metric("low/policy_loss", 1000 + 70 * i, at(16_000_000 + i));
        }
        let rate = throughput.of_actor(0, at(16_000_200));
        assert!((490.0..=500.0).contains(&rate), "{rate}");
        let (rate, _) = throughput.of_learner(at(2_000_001)).unwrap();
        assert_eq!(rate, 500.0);
        for (name, _, rate) in throughput.due(at(16_000_200)) {
            assert!((490.0..=500.0).contains(&rate), "{name} {rate}");
        }
        // A process that was just started, with two statuses at once.
        throughput.on_status(&status(0, 6, 0), at(17_000_000));
        throughput.on_status(&status(0, 6, 900), at(17_000_001));
        assert_eq!(throughput.of_all(at(17_000_002)), 0.0);
    }

    #[test]
    fn a_suspended_run_keeps_its_rate() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = throughput(start);
        for i in 0..=5 {
            throughput.on_status(&status(0, 5, 100 * i), at(200 * i));
        }
        throughput.skip(Duration::from_secs(60));
        throughput.on_status(&status(0, 5, 600), at(61_200));
        assert_eq!(throughput.of_all(at(61_200)), 500.0);
        assert!(throughput.due(at(61_900)).is_empty());
        assert_eq!(throughput.due(at(62_000)), [(STEPS, 600, 300.0)]);
    }
}
