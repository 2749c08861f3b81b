//! Trajectories without loss: hello, sequence numbers, acknowledgements, window.
//!
//! An actor keeps what is not acknowledged and sends it again when a reader was restarted or is
//! silent for long; a reader takes messages in the order of their numbers alone and notes what it
//! took before it acknowledges it. So every message is taken once by every reader, whoever dies.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;

use crate::WireError;
use crate::bus::{Bus, Claim, Ipc, Waker, sleep};
use crate::ledger::{Ledger, Source};
use crate::records::{
    Acknowledgement, AcknowledgementHeader, Kind, LAYOUT, MAX_ACTORS, Reader, Status,
    TrajectoryHeader, Transition,
};

/// How often a hello is said again, and a waiting side looks up without being woken.
const REPEAT: Duration = Duration::from_millis(100);

/// How often the second hello is said again.
const SECOND_REPEAT: Duration = Duration::from_secs(2);

/// Silence of a reader after which what it has not acknowledged is sent again.
const AGAIN: Duration = Duration::from_secs(2);
/// Incarnations of strangers that are named in the log.
const NAMED: u64 = 10;

/// A message that is not acknowledged by all.
struct Unacknowledged {
    header: TrajectoryHeader,
    steps: Vec<Transition>,
}

/// An actor's end.
pub struct TrajectorySender {
    publisher: Publisher<Ipc, [Transition], TrajectoryHeader>,
    acknowledgements: Subscriber<Ipc, [Acknowledgement], AcknowledgementHeader>,
    wake_readers: Notifier<Ipc>,
    listener: Listener<Ipc>,
    readers: Vec<Reader>,
    claim: Claim,
    window: u64,
    limit: usize,
    next: u64,
    /// Next sequence number that each reader waits for, by the reader's number.
    acknowledged: [u64; 2],
    /// Each reader's process.
    incarnations: [u32; 2],
    /// Oldest first.
    unacknowledged: VecDeque<Unacknowledged>,
    /// Buffers of messages that are acknowledged.
    spare: Vec<Vec<Transition>>,
    /// When the oldest number last grew, or all was sent again.
    moved: Instant,
    transitions: u64,
    refused: u64,
}

/// What had been sent when an actor left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drained {
    /// Trajectories sent.
    pub trajectories: u64,
    /// Transitions sent.
    pub transitions: u64,
    /// Whether every required reader has acknowledged all of them.
    pub acknowledged: bool,
}

impl Drained {
    /// Of an actor that left before it sent anything.
    pub const NOTHING: Self = Self {
        trajectories: 0,
        transitions: 0,
        acknowledged: true,
    };
}

impl TrajectorySender {
    /// Joins as an actor and says hello until every required reader has answered; none once
    /// `stopped` says so.
    ///
    /// # Errors
    /// [`WireError::NoAnswer`] after the deadline, a port that cannot be made.
    pub fn connect(
        bus: &Bus,
        claim: Claim,
        deadline: Duration,
        stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Self>, WireError> {
        let limits = bus.limits();
        let topic = bus.trajectories()?;
        let publisher = bus.port("trajectories", "get a publisher", || {
            topic
                .publisher_builder()
                .initial_max_slice_len(limits.trajectory_steps)
                .allocation_strategy(AllocationStrategy::Static)
                .max_loaned_samples(1)
                // The window keeps buffers from filling, so nothing is ever discarded; blocking
                // would hang when a reader dies.
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
        })?;
        let topic = bus.acknowledgements()?;
        let acknowledgements = bus.port("acknowledgements", "get a subscriber", || {
            topic.subscriber_builder().create()
        })?;
        let mut sender = Self {
            publisher,
            acknowledgements,
            wake_readers: bus.notifier(Waker::Readers)?,
            listener: bus.listener(Waker::Actors)?,
            readers: limits.readers.clone(),
            window: limits.window as u64,
            limit: limits.trajectory_steps,
            next: 0,
            acknowledged: [0; 2],
            incarnations: [0; 2],
            unacknowledged: VecDeque::with_capacity(limits.window + 1),
            spare: vec![],
            moved: Instant::now(),
            transitions: 0,
            refused: 0,
            claim,
        };
        // The first hello is repeated until each reader has seen one. The second lies behind all
        // repeats: once it is acknowledged the buffers are empty and the window holds.
        let mut waited = Duration::ZERO;
        for (greeting, repeat) in [(0, REPEAT), (1, SECOND_REPEAT)] {
            let mut said: Option<Instant> = None;
            while sender.oldest() <= greeting {
                if stopped() {
                    return Ok(None);
                }
                if waited > deadline {
                    let reader = sender.silent(greeting).map_or("a reader", Reader::name);
                    let seconds = deadline.as_secs_f64();
                    return Err(WireError::NoAnswer {
                        reader,
                        actor: sender.claim.actor,
                        seconds,
                    });
                }
                if said.is_none_or(|said| said.elapsed() >= repeat) {
                    sender.next = greeting;
                    let header = TrajectoryHeader::default();
                    sender.publish(Kind::Hello, header, 0, |_| Transition::default())?;
                    said = Some(Instant::now());
                }
                let before = Instant::now();
                sender.wait(REPEAT);
                // A process that was stopped meanwhile did not wait.
                waited += before.elapsed().min(SECOND_REPEAT);
            }
        }
        sender.next = 2;
        sender.moved = Instant::now();
        Ok(Some(sender))
    }

    fn silent(&self, greeting: u64) -> Option<Reader> {
        let next = |reader: &Reader| self.acknowledged[*reader as usize];
        self.readers
            .iter()
            .copied()
            .find(|reader| next(reader) <= greeting)
    }

    fn oldest(&self) -> u64 {
        let next = self
            .readers
            .iter()
            .map(|reader| self.acknowledged[*reader as usize]);
        next.min().unwrap_or(self.next)
    }

    fn read_acknowledgements(&mut self) {
        let oldest = self.oldest();
        let mut restarted = false;
        while let Ok(Some(table)) = self.acknowledgements.receive() {
            let AcknowledgementHeader {
                reader,
                incarnation,
            } = *table.user_header();
            let own = table.payload().get(self.claim.actor as usize);
            let (Some(own), Some(known)) = (own, self.incarnations.get_mut(reader as usize)) else {
                self.refused += 1;
                continue;
            };
            if *known != incarnation {
                restarted |= *known != 0;
                *known = incarnation;
            }
            if own.incarnation != crate::incarnation() {
                continue;
            }
            if own.next_sequence > self.next.max(2) {
                // More than was ever sent.
                self.refused += 1;
                continue;
            }
            let slot = &mut self.acknowledged[reader as usize];
            *slot = own.next_sequence.max(*slot);
        }
        let now = self.oldest();
        while let Some(message) = self.unacknowledged.front()
            && message.header.sequence < now
        {
            if let Some(message) = self.unacknowledged.pop_front() {
                self.spare.push(message.steps);
            }
        }
        if now > oldest {
            self.moved = Instant::now();
        }
        if restarted || (!self.unacknowledged.is_empty() && self.moved.elapsed() > AGAIN) {
            self.send_again();
        }
    }

    /// Sends all that is not acknowledged again; readers pass over what they had.
    fn send_again(&mut self) {
        self.moved = Instant::now();
        for message in &self.unacknowledged {
            // What cannot be sent now is sent the next time.
            let Ok(mut sample) = self.publisher.loan_slice_uninit(message.steps.len()) else {
                return;
            };
            *sample.user_header_mut() = message.header;
            let _ = sample.write_from_slice(&message.steps).send();
        }
        let _ = self.wake_readers.notify();
    }

    /// Next sequence number that the slowest reader waits for.
    #[must_use]
    pub fn acknowledged(&self) -> u64 {
        self.oldest()
    }

    /// Acknowledgements that were refused: of no reader, or of more than was sent.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Whether a trajectory may be sent now.
    pub fn credit(&mut self) -> bool {
        self.read_acknowledgements();
        self.next < self.oldest() + self.window
    }

    /// Waits for credit, at most for `timeout`; whether there is credit.
    pub fn wait_credit(&mut self, timeout: Duration) -> bool {
        let start = Instant::now();
        while !self.credit() {
            let Some(left) = timeout.checked_sub(start.elapsed()) else {
                return false;
            };
            sleep(&self.listener, left.min(REPEAT));
        }
        true
    }

    /// Sleeps until something for actors is there, at most for `timeout`.
    pub fn wait(&mut self, timeout: Duration) {
        sleep(&self.listener, timeout);
        self.read_acknowledgements();
    }

    /// Sends a trajectory of `steps` transitions, written in place in shared memory. Only with
    /// [`credit`](Self::credit). Of the header, the caller sets episode, first step, environment
    /// and versions.
    ///
    /// # Errors
    /// More steps than the run's limit, or what iceoryx2 refuses.
    pub fn send_with(
        &mut self,
        header: TrajectoryHeader,
        steps: usize,
        transition: impl FnMut(usize) -> Transition,
    ) -> Result<(), WireError> {
        self.publish(Kind::Data, header, steps, transition)?;
        self.transitions += steps as u64;
        Ok(())
    }

    fn publish(
        &mut self,
        kind: Kind,
        header: TrajectoryHeader,
        steps: usize,
        mut transition: impl FnMut(usize) -> Transition,
    ) -> Result<(), WireError> {
        if steps > self.limit {
            return Err(WireError::TooLong {
                what: "trajectory",
                got: steps,
                limit: self.limit,
            });
        }
        let failed = |reason: String| WireError::service("trajectories", "send", reason, None);
        let mut sample = self
            .publisher
            .loan_slice_uninit(steps)
            .map_err(|e| failed(format!("{e:?}")))?;
        let header = TrajectoryHeader {
            layout: LAYOUT,
            actor: self.claim.actor,
            incarnation: crate::incarnation(),
            kind: kind as u32,
            sequence: self.next,
            ..header
        };
        *sample.user_header_mut() = header;
        let mut kept = self.spare.pop().unwrap_or_default();
        kept.clear();
        sample
            .write_from_fn(|row| {
                let step = transition(row);
                kept.push(step);
                step
            })
            .send()
            .map_err(|e| failed(format!("{e:?}")))?;
        self.next += 1;
        if kind != Kind::Hello {
            let steps = kept;
            self.unacknowledged
                .push_back(Unacknowledged { header, steps });
        }
        let _ = self.wake_readers.notify();
        Ok(())
    }

    /// Transitions sent so far.
    #[must_use]
    pub fn transitions(&self) -> u64 {
        self.transitions
    }

    /// Says goodbye and waits until all is acknowledged, at most for `timeout`.
    pub fn drain(&mut self, timeout: Duration) -> Drained {
        let start = Instant::now();
        let trajectories = self.next.saturating_sub(2);
        // The goodbye has a place of its own beyond the window.
        let said = self.publish(Kind::Bye, TrajectoryHeader::default(), 0, |_| {
            Transition::default()
        });
        while said.is_ok() && self.oldest() < self.next && start.elapsed() < timeout {
            self.wait(REPEAT);
        }
        Drained {
            trajectories,
            transitions: self.transitions,
            acknowledged: said.is_ok() && self.oldest() >= self.next,
        }
    }
}

/// What a reader has had in all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Trajectories received.
    pub trajectories: u64,
    /// Transitions received.
    pub transitions: u64,
    /// Messages that came a second time.
    pub repeated: u64,
    /// Messages that came before one that was sent earlier; they are sent again after it.
    pub early: u64,
    /// Messages refused at the door: another layout, absurd lengths or indices, values that are
    /// not finite, a process that is not the actor that it says it is.
    pub refused: u64,
}

/// The learner's or the graph-builder's end.
pub struct TrajectoryReceiver {
    subscriber: Subscriber<Ipc, [Transition], TrajectoryHeader>,
    publisher: Publisher<Ipc, [Acknowledgement], AcknowledgementHeader>,
    wake_actors: Notifier<Ipc>,
    listener: Listener<Ipc>,
    reader: Reader,
    limit: usize,
    max_actors: u32,
    root: PathBuf,
    sources: [Source; MAX_ACTORS],
    counts: Counts,
    ledger: Ledger,
    news: bool,
}

impl TrajectoryReceiver {
    /// Joins as a reader, and counts on from where the ledger in the run's folder says that the
    /// one before stopped.
    ///
    /// # Errors
    /// A port that cannot be made, a ledger that cannot be opened.
    pub fn new(bus: &Bus, reader: Reader, folder: &Path) -> Result<Self, WireError> {
        let path = reader.ledger(folder);
        let opened = Ledger::open(&path).map_err(|reason| WireError::Io {
            path: path.display().to_string(),
            reason,
        })?;
        Self::join(bus, reader, opened)
    }

    fn join(
        bus: &Bus,
        reader: Reader,
        (ledger, books): (Ledger, crate::Books),
    ) -> Result<Self, WireError> {
        let topic = bus.trajectories()?;
        let subscriber = bus.port("trajectories", "get a subscriber", || {
            topic.subscriber_builder().create()
        })?;
        let topic = bus.acknowledgements()?;
        let publisher = bus.port("acknowledgements", "get a publisher", || {
            topic
                .publisher_builder()
                .initial_max_slice_len(MAX_ACTORS)
                .allocation_strategy(AllocationStrategy::Static)
                .create()
        })?;
        let mut sources = [Source::default(); MAX_ACTORS];
        for source in books.present.iter().filter(|s| s.incarnation != 0) {
            if let Some(slot) = sources.get_mut(source.actor as usize) {
                *slot = *source;
            }
        }
        let mut receiver = Self {
            subscriber,
            publisher,
            wake_actors: bus.notifier(Waker::Actors)?,
            listener: bus.listener(Waker::Readers)?,
            reader,
            limit: bus.limits().trajectory_steps,
            max_actors: bus.limits().max_actors as u32,
            root: bus.root().to_path_buf(),
            sources,
            counts: books.counts,
            ledger,
            // Actors learn that this process is a new one.
            news: true,
        };
        receiver.acknowledge();
        Ok(receiver)
    }

    /// Takes in up to `most` of the messages that wait; `take` sees each trajectory in place.
    /// Returns how many messages there were. Actors go on only after
    /// [`acknowledge`](Self::acknowledge).
    pub fn receive(
        &mut self,
        most: usize,
        mut take: impl FnMut(&TrajectoryHeader, &[Transition]),
    ) -> usize {
        for number in 0..most {
            let Ok(Some(sample)) = self.subscriber.receive() else {
                return number;
            };
            let (header, steps) = (*sample.user_header(), sample.payload());
            let known = header.layout == LAYOUT
                && header.actor < self.max_actors
                && header.kind <= Kind::Bye as u32
                && steps.len() <= self.limit;
            let allowed = known && self.allows(&header);
            if !allowed {
                self.refuse(&header, steps.len());
                continue;
            }
            if !self.expect(&header) {
                continue;
            }
            if header.kind == Kind::Data as u32 {
                if steps.iter().all(Transition::is_sound) {
                    self.counts.trajectories += 1;
                    self.counts.transitions += steps.len() as u64;
                    self.sources[header.actor as usize].transitions += steps.len() as u64;
                    take(&header, steps);
                } else {
                    self.refuse(&header, steps.len());
                }
            }
        }
        most
    }

    /// Whether a message's process is the actor that it says it is: the one that is known, or
    /// the one that holds the id's claim.
    fn allows(&self, header: &TrajectoryHeader) -> bool {
        self.sources[header.actor as usize].incarnation == header.incarnation
            || Bus::claimed(&self.root, header.actor) == Some(header.incarnation)
    }

    fn refuse(&mut self, header: &TrajectoryHeader, steps: usize) {
        self.counts.refused += 1;
        if self.counts.refused <= NAMED {
            let (reader, actor) = (self.reader.name(), header.actor);
            let (kind, sequence) = (header.kind, header.sequence);
            log::warn!(
                "{reader}: refused a message of {steps} steps that says it is number {sequence}, \
                 kind {kind}, of actor {actor}"
            );
        }
    }

    /// Books a message by its sequence number; whether it is the next one.
    fn expect(&mut self, header: &TrajectoryHeader) -> bool {
        self.news = true;
        let source = &mut self.sources[header.actor as usize];
        if source.incarnation != header.incarnation {
            if source.incarnation != 0 {
                self.ledger.retire(source);
            }
            *source = Source {
                actor: header.actor,
                incarnation: header.incarnation,
                ..Source::default()
            };
            if header.kind != Kind::Hello as u32 {
                // The ledger was lost: it counts from here.
                source.next = header.sequence;
            }
        }
        if header.sequence != source.next {
            let again = header.sequence < source.next;
            // A hello is said again while the answer is on its way.
            if again && header.kind != Kind::Hello as u32 {
                self.counts.repeated += 1;
            }
            self.counts.early += u64::from(!again);
            return false;
        }
        source.next += 1;
        source.left = header.kind == Kind::Bye as u32;
        true
    }

    /// Tells the actors what was received, so that they may send on; cheap when nothing is new.
    /// To be called now and then even so: late actors get the table then.
    pub fn acknowledge(&mut self) {
        if !self.news {
            let _ = self.publisher.update_connections();
            return;
        }
        let Ok(mut sample) = self.publisher.loan_slice_uninit(MAX_ACTORS) else {
            return;
        };
        self.ledger.write(&self.counts, &self.sources);
        *sample.user_header_mut() = AcknowledgementHeader {
            reader: self.reader as u32,
            incarnation: crate::incarnation(),
        };
        let sources = &self.sources;
        let sample = sample.write_from_fn(|actor| Acknowledgement {
            incarnation: sources[actor].incarnation,
            reserved: 0,
            next_sequence: sources[actor].next,
        });
        if sample.send().is_ok() {
            self.news = false;
            let _ = self.wake_actors.notify();
        }
    }

    /// Sleeps until something for readers is there, at most for `timeout`.
    pub fn wait(&self, timeout: Duration) {
        sleep(&self.listener, timeout);
    }

    /// Writes what was received into a status.
    pub fn report(&self, status: &mut Status) {
        status.received = self.counts.transitions;
        status.refused = self.counts.refused;
    }

    /// Whether every actor that said hello has taken its leave, or is gone without.
    #[must_use]
    pub fn all_left(&self) -> bool {
        self.sources()
            .all(|source| source.left || !Bus::is_claimed(&self.root, source.actor))
    }

    /// What was received in all.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What was received from the newest process of each actor id.
    pub fn sources(&self) -> impl Iterator<Item = Source> + '_ {
        let known = |source: &Source| source.incarnation != 0;
        self.sources.into_iter().filter(known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::RunDomain;
    use crate::limits::tests::limits;

    fn connected(bus: &Bus, claim: Claim, deadline: Duration) -> TrajectorySender {
        let sender = TrajectorySender::connect(bus, claim, deadline, &|| false);
        sender.unwrap().unwrap()
    }

    #[test]
    fn an_actor_that_is_stopped_waits_for_no_answer() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let start = Instant::now();
        let stopped = || start.elapsed() > Duration::from_millis(50);
        let claim = host.claim(0).unwrap();
        let sender = TrajectorySender::connect(&host, claim, Duration::from_secs(60), &stopped);
        assert!(sender.unwrap().is_none());
        assert!(start.elapsed() < Duration::from_secs(5));
        drop(host);
        domain.remove();
    }

    fn step(value: f32) -> Transition {
        Transition {
            reward: value,
            ..Transition::default()
        }
    }

    fn forgetful(bus: &Bus) -> TrajectoryReceiver {
        let opened = (Ledger::none(), crate::Books::default());
        TrajectoryReceiver::join(bus, Reader::Learner, opened).unwrap()
    }

    #[test]
    fn readers_that_are_replaced_take_each_trajectory_once() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let each = 60;
        let mut seen = vec![];
        std::thread::scope(|scope| {
            let id = domain.id().to_owned();
            scope.spawn(move || {
                let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
                let deadline = Duration::from_secs(20);
                let claim = bus.claim(0).unwrap();
                assert!(matches!(bus.claim(0), Err(WireError::Taken(0))));
                let mut sender = connected(&bus, claim, deadline);
                for i in 0..each {
                    assert!(sender.wait_credit(deadline));
                    let header = TrajectoryHeader::default();
                    sender.send_with(header, 2, |_| step(i as f32)).unwrap();
                }
                let drained = sender.drain(deadline);
                assert!(drained.acknowledged, "{drained:?}");
            });
            let start = Instant::now();
            let mut left = false;
            // Each reader takes seven messages and ends without a word; of the last ones the actor
            // never hears that they were taken.
            while !left {
                let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "learner").unwrap();
                let mut receiver =
                    TrajectoryReceiver::new(&bus, Reader::Learner, folder.path()).unwrap();
                let mut taken = 0;
                while taken < 7 && !left {
                    assert!(start.elapsed() < Duration::from_secs(60), "{seen:?}");
                    taken += receiver.receive(3, |_, steps| seen.push(steps[0].reward));
                    if taken < 7 {
                        receiver.acknowledge();
                    } else {
                        receiver.ledger.write(&receiver.counts, &receiver.sources);
                    }
                    left = receiver.sources().any(|source| source.left);
                    receiver.wait(Duration::from_millis(5));
                }
                if left {
                    receiver.acknowledge();
                }
            }
        });
        let expected: Vec<f32> = (0..each).map(|i| i as f32).collect();
        assert_eq!(seen, expected);
        let books = crate::Books::read(&Reader::Learner.ledger(folder.path())).unwrap();
        assert_eq!(books.counts.transitions, 2 * each);
        drop(host);
        domain.remove();
    }

    #[test]
    fn a_stranger_that_says_it_is_an_actor_is_refused() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let mut receiver = forgetful(&host);
        let topic = host.trajectories().unwrap();
        let publisher = topic
            .publisher_builder()
            .initial_max_slice_len(200)
            .create()
            .unwrap();
        let sound = TrajectoryHeader {
            layout: LAYOUT,
            incarnation: 5,
            ..TrajectoryHeader::default()
        };
        let mut send = |header: TrajectoryHeader, steps: usize| {
            let mut sample = publisher.loan_slice_uninit(steps).unwrap();
            *sample.user_header_mut() = header;
            sample.write_from_fn(|_| step(f32::NAN)).send().unwrap();
            let before = receiver.counts().refused;
            receiver.receive(10, |_, _| unreachable!("it was taken"));
            receiver.counts().refused - before
        };
        assert_eq!(send(sound, 0), 1, "nobody has claimed the id");
        assert_eq!(send(TrajectoryHeader { layout: 1, ..sound }, 0), 1);
        assert_eq!(send(TrajectoryHeader { kind: 9, ..sound }, 0), 1);
        let actor = u32::MAX;
        assert_eq!(send(TrajectoryHeader { actor, ..sound }, 0), 1);
        let _claim = host.claim(0).unwrap();
        assert_eq!(send(sound, 0), 1, "the claim is another process's");
        let own = TrajectoryHeader {
            incarnation: crate::incarnation(),
            ..sound
        };
        assert_eq!(send(own, 0), 0);
        let data = TrajectoryHeader {
            kind: Kind::Data as u32,
            sequence: 1,
            ..own
        };
        assert_eq!(send(data, 3), 1, "not finite");
        assert_eq!(send(data, 200), 1, "too long");
        drop((publisher, receiver, host));
        domain.remove();
    }

    #[test]
    fn a_slow_reader_loses_nothing_from_three_actors() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let (actors, each) = (3_u32, 100_u32);
        let mut sums = [0.0_f64; 3];
        std::thread::scope(|scope| {
            for actor in 0..actors {
                let domain = RunDomain::open(domain.id()).unwrap();
                scope.spawn(move || {
                    let bus = Bus::join(&domain, &format!("actor-{actor}")).unwrap();
                    let deadline = Duration::from_secs(10);
                    let mut sender = connected(&bus, bus.claim(actor).unwrap(), deadline);
                    for i in 0..each {
                        assert!(sender.wait_credit(deadline));
                        let header = TrajectoryHeader::default();
                        sender.send_with(header, 10, |_| step(i as f32)).unwrap();
                    }
                    let drained = sender.drain(deadline);
                    assert!(drained.acknowledged, "{drained:?}");
                    assert_eq!(drained.transitions, 1000);
                });
            }
            let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "learner").unwrap();
            let mut receiver = forgetful(&bus);
            let start = Instant::now();
            while receiver.sources().filter(|s| s.left).count() < 3 {
                assert!(
                    start.elapsed() < Duration::from_secs(20),
                    "{:?}",
                    receiver.counts()
                );
                receiver.receive(2, |header, steps| {
                    sums[header.actor as usize] +=
                        steps.iter().map(|s| f64::from(s.reward)).sum::<f64>();
                });
                receiver.acknowledge();
                receiver.wait(Duration::from_millis(1));
            }
            let counts = receiver.counts();
            assert_eq!(
                (counts.trajectories, counts.transitions),
                (300, 3000),
                "{counts:?}"
            );
            assert_eq!((counts.early, counts.repeated, counts.refused), (0, 0, 0));
        });
        assert_eq!(sums, [10.0 * 99.0 * 50.0; 3]);
        drop(host);
        domain.remove();
    }

    #[test]
    fn without_acknowledgements_an_actor_stops_at_its_window() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let mut receiver = forgetful(&host);
        let (ready, wait) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let id = domain.id().to_owned();
            scope.spawn(move || {
                let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
                let claim = bus.claim(0).unwrap();
                let mut sender = connected(&bus, claim, Duration::from_secs(10));
                let mut sent = 0;
                while sent < 100 && sender.wait_credit(Duration::from_millis(300)) {
                    let header = TrajectoryHeader::default();
                    let value = if sent == 1 { f32::NAN } else { 0.0 };
                    sender.send_with(header, 1, |_| step(value)).unwrap();
                    sent += 1;
                }
                assert!(
                    sender
                        .send_with(TrajectoryHeader::default(), 66, |_| step(0.0))
                        .is_err()
                );
                ready.send(sent).unwrap();
            });
            // Answers both hellos and then nothing.
            while receiver.sources().all(|source| source.next < 2) {
                receiver.receive(1, |_, _| {});
                receiver.acknowledge();
                receiver.wait(Duration::from_millis(10));
            }
            let sent = wait.recv_timeout(Duration::from_secs(10)).unwrap();
            assert_eq!(sent, limits().window);
        });
        receiver.receive(100, |_, _| {});
        let counts = receiver.counts();
        assert_eq!(
            (counts.trajectories, counts.refused, counts.early),
            (3, 1, 0)
        );
        drop(receiver);
        drop(host);
        domain.remove();
    }

    #[test]
    fn nobody_at_home_is_an_error_with_a_name() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let error = TrajectorySender::connect(
            &host,
            host.claim(0).unwrap(),
            Duration::from_millis(150),
            &|| false,
        )
        .err()
        .unwrap();
        assert!(
            matches!(
                error,
                WireError::NoAnswer {
                    reader: "learner",
                    ..
                }
            ),
            "{error}"
        );
        drop(host);
        domain.remove();
    }
}
