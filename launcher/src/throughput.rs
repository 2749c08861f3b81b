//! How much is done a second: by each actor, by all, by the learner's stages.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use wire::{MAX_ACTORS, Status};

/// Rates are means of this long.
const WINDOW: Duration = Duration::from_secs(3);
/// Rows of metrics are written this often.
const EVERY: Duration = Duration::from_secs(2);
/// A rate that is older is none.
const STALE: Duration = Duration::from_secs(10);
/// What comes closer together tells no rate: words that waited while the launcher stood still come
/// all at once.
const LEAST: Duration = Duration::from_millis(100);

/// The metric that is written of all actors' control steps.
pub(crate) const STEPS: &str = "throughput/steps_per_s";

/// Stages of the learner: a metric whose steps count the stage's work, the metric that is written
/// of it, and the word for its steps.
const STAGES: [(&str, &str, &str); 3] = [
    ("low/policy_loss", "throughput/low_updates_per_s", "updates"),
    ("high/entropy_nats", "throughput/high_steps_per_s", "steps"),
    (
        "encoder/reconstruction",
        "throughput/encoder_updates_per_s",
        "updates",
    ),
];

/// A count that grows, and its pace.
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

    /// Takes in a count; of those that come at once the newest is kept.
    fn add(&mut self, now: Instant, steps: u64) {
        let before = self.samples.len().checked_sub(2);
        let close = |(at, _): &(Instant, u64)| now.saturating_duration_since(*at) < LEAST;
        if before.and_then(|i| self.samples.get(i)).is_some_and(close) {
            self.samples.pop_back();
        }
        self.samples.push_back((now, steps));
        let ago = |at: Instant| now.saturating_duration_since(at);
        // What is left tells a rate: the newest sample is not all that there is.
        while let (Some((first, _)), Some((second, _))) =
            (self.samples.front(), self.samples.get(1))
            && ago(*first) > WINDOW
            && ago(*second) >= LEAST
        {
            self.samples.pop_front();
        }
    }
}

#[derive(Default)]
struct Stage {
    newest: Option<(Instant, u64)>,
    /// Up to where it is written.
    written: Option<(Instant, u64)>,
    rate: Option<(Instant, f64)>,
}

/// What a second brings.
pub(crate) struct Throughput {
    actors: BTreeMap<u32, Actor>,
    /// Control steps of all actors, those of dead ones included.
    steps: u64,
    written: (Instant, u64),
    stages: [Stage; STAGES.len()],
}

impl Throughput {
    /// Goes on from so many control steps.
    pub(crate) fn new(steps: u64, now: Instant) -> Self {
        Self {
            actors: BTreeMap::new(),
            steps,
            written: (now, steps),
            stages: Default::default(),
        }
    }

    /// Takes in an actor's word.
    pub(crate) fn hear(&mut self, status: &Status, now: Instant) {
        if status.id as usize >= MAX_ACTORS {
            return;
        }
        let actor = self.actors.entry(status.id).or_default();
        let last = actor.samples.back().map_or(0, |(_, steps)| *steps);
        // A new process counts from nothing.
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

    /// Counts so much of the time that passed as none: the run stood still.
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

    /// Takes in the step that a metric belongs to.
    pub(crate) fn note(&mut self, name: &str, step: u64, now: Instant) {
        if let Some(i) = STAGES.iter().position(|(of, ..)| *of == name) {
            let stage = &mut self.stages[i];
            stage.newest = Some((now, step));
            stage.written.get_or_insert((now, step));
        }
    }

    /// Control steps a second of an actor.
    pub(crate) fn of_actor(&self, id: u32, now: Instant) -> f64 {
        self.actors.get(&id).map_or(0.0, |actor| actor.rate(now))
    }

    /// Control steps a second of all actors.
    pub(crate) fn of_all(&self, now: Instant) -> f64 {
        self.actors.values().map(|actor| actor.rate(now)).sum()
    }

    /// The pace of the learner's stage that goes on, and the word for its steps.
    pub(crate) fn of_learner(&self, now: Instant) -> Option<(f64, &'static str)> {
        let fresh = |(stage, (.., word)): (&Stage, &(&str, &str, &'static str))| {
            let (at, rate) = stage.rate?;
            (now.saturating_duration_since(at) < STALE).then_some((rate, *word))
        };
        self.stages.iter().zip(&STAGES).find_map(fresh)
    }

    /// Names, steps and values of the metrics to write, when it is time to.
    pub(crate) fn due(&mut self, now: Instant) -> Vec<(&'static str, u64, f64)> {
        let (at, steps) = self.written;
        let passed = now.saturating_duration_since(at);
        if passed < EVERY {
            return vec![];
        }
        self.written = (now, self.steps);
        let rate = (self.steps - steps) as f64 / passed.as_secs_f64();
        let mut rows = vec![(STEPS, self.steps, rate)];
        for (stage, (_, name, _)) in self.stages.iter_mut().zip(&STAGES) {
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
                rows.push((name, to, rate));
            }
            stage.written = stage.newest;
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(id: u32, incarnation: u32, steps: u64) -> Status {
        Status {
            id,
            incarnation,
            steps,
            ..Status::default()
        }
    }

    #[test]
    fn steps_of_all_actors_are_counted_and_those_of_dead_ones_are_kept() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = Throughput::new(1000, start);
        for i in 0..=10 {
            throughput.hear(&status(0, 5, 100 * i), at(200 * i));
            throughput.hear(&status(1, 6, 50 * i), at(200 * i));
        }
        assert_eq!(throughput.of_actor(0, at(2000)), 500.0);
        assert_eq!(throughput.of_all(at(2000)), 750.0);
        assert_eq!(throughput.of_all(at(9000)), 0.0, "nothing was heard since");
        assert!(throughput.due(at(1999)).is_empty());
        assert_eq!(throughput.due(at(2000)), [(STEPS, 2500, 750.0)]);
        // Another process in the place of the first: its steps are more.
        throughput.hear(&status(0, 7, 300), at(3000));
        assert_eq!(throughput.due(at(4000)), [(STEPS, 2800, 150.0)]);
        throughput.hear(&status(0, 7, u64::MAX), at(4100));
        throughput.hear(&status(u32::MAX, 7, 1), at(4100));
        assert_eq!(throughput.due(at(6000)).len(), 1, "no overflow");
    }

    #[test]
    fn a_stage_has_the_pace_of_its_metrics_steps() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = Throughput::new(0, start);
        throughput.note("low/policy_loss", 100, at(500));
        assert_eq!(throughput.of_learner(at(500)), None);
        throughput.note("low/policy_loss", 300, at(1500));
        throughput.note("low/value_loss", 9999, at(1600));
        let rows = throughput.due(at(2000));
        assert_eq!(rows[1..], [("throughput/low_updates_per_s", 300, 200.0)]);
        assert_eq!(throughput.of_learner(at(2000)), Some((200.0, "updates")));
        assert_eq!(throughput.due(at(4000)).len(), 1, "it stands still");
        assert_eq!(throughput.of_learner(at(20_000)), None);
        // The learner was started again and goes on from an earlier state.
        throughput.note("low/policy_loss", 200, at(4100));
        assert_eq!(throughput.due(at(6000)).len(), 1);
    }

    #[test]
    fn what_comes_at_once_after_a_standstill_makes_no_rate_of_its_own() {
        let start = Instant::now();
        let at = |us| start + Duration::from_micros(us);
        let mut throughput = Throughput::new(0, start);
        for i in 0..=10 {
            throughput.hear(&status(0, 5, 100 * i), at(200_000 * i));
            throughput.note("low/policy_loss", 100 * i, at(200_000 * i));
        }
        throughput.due(at(2_000_000));
        // The launcher stood still for 14 s, and reads all that was said meanwhile.
        for i in 0..100 {
            throughput.hear(&status(0, 5, 1000 + 70 * i), at(16_000_000 + i));
            throughput.note("low/policy_loss", 1000 + 70 * i, at(16_000_000 + i));
        }
        let rate = throughput.of_actor(0, at(16_000_200));
        assert!((490.0..=500.0).contains(&rate), "{rate}");
        let (rate, _) = throughput.of_learner(at(2_000_001)).unwrap();
        assert_eq!(rate, 500.0);
        for (name, _, rate) in throughput.due(at(16_000_200)) {
            assert!((490.0..=500.0).contains(&rate), "{name} {rate}");
        }
        // A process that was just started, and speaks twice at once.
        throughput.hear(&status(0, 6, 0), at(17_000_000));
        throughput.hear(&status(0, 6, 900), at(17_000_001));
        assert_eq!(throughput.of_all(at(17_000_002)), 0.0);
    }

    #[test]
    fn a_run_that_is_stopped_keeps_its_pace() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut throughput = Throughput::new(0, start);
        for i in 0..=5 {
            throughput.hear(&status(0, 5, 100 * i), at(200 * i));
        }
        throughput.skip(Duration::from_secs(60));
        throughput.hear(&status(0, 5, 600), at(61_200));
        assert_eq!(throughput.of_all(at(61_200)), 500.0);
        assert!(throughput.due(at(61_900)).is_empty());
        assert_eq!(throughput.due(at(62_000)), [(STEPS, 600, 300.0)]);
    }
}
