//! Trajectories without loss: hello, sequence numbers, acknowledgements, window.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;

use crate::WireError;
use crate::bus::{Bus, Ipc, Waker, sleep};
use crate::records::{
    Acknowledgement, AcknowledgementHeader, Kind, LAYOUT, MAX_ACTORS, Reader, Status,
    TrajectoryHeader, Transition,
};

/// How often a hello is said again, and a waiting side looks up without being woken.
const REPEAT: Duration = Duration::from_millis(100);

/// How often the second hello is said again.
const SECOND_REPEAT: Duration = Duration::from_secs(2);

/// An actor's end.
pub struct TrajectorySender {
    publisher: Publisher<Ipc, [Transition], TrajectoryHeader>,
    acknowledgements: Subscriber<Ipc, [Acknowledgement], AcknowledgementHeader>,
    wake_readers: Notifier<Ipc>,
    listener: Listener<Ipc>,
    readers: Vec<Reader>,
    actor: u32,
    incarnation: u32,
    window: u64,
    limit: usize,
    next: u64,
    /// Next sequence number that each reader waits for, by the reader's number.
    acknowledged: [u64; 2],
    transitions: u64,
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

impl TrajectorySender {
    /// Joins as an actor and says hello until every required reader has answered.
    ///
    /// # Errors
    /// [`WireError::NoAnswer`] after the deadline, a port that cannot be made.
    pub fn connect(bus: &Bus, actor: u32, deadline: Duration) -> Result<Self, WireError> {
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
            actor,
            incarnation: std::process::id(),
            window: limits.window as u64,
            limit: limits.trajectory_steps,
            next: 0,
            acknowledged: [0; 2],
            transitions: 0,
        };
        // The first hello is repeated until each reader has seen one. The second lies behind all
        // repeats: once it is acknowledged the buffers are empty and the window holds.
        let start = Instant::now();
        for (greeting, repeat) in [(0, REPEAT), (1, SECOND_REPEAT)] {
            let mut said: Option<Instant> = None;
            while sender.oldest() <= greeting {
                if start.elapsed() > deadline {
                    let reader = sender.silent(greeting).map_or("a reader", Reader::name);
                    let seconds = deadline.as_secs_f64();
                    return Err(WireError::NoAnswer {
                        reader,
                        actor,
                        seconds,
                    });
                }
                if said.is_none_or(|said| said.elapsed() >= repeat) {
                    sender.next = greeting;
                    let header = TrajectoryHeader::default();
                    sender.publish(Kind::Hello, header, 0, |_| Transition::default())?;
                    said = Some(Instant::now());
                }
                sender.wait(REPEAT);
            }
        }
        sender.next = 2;
        Ok(sender)
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
        while let Ok(Some(table)) = self.acknowledgements.receive() {
            let own = table.payload().get(self.actor as usize);
            let slot = self
                .acknowledged
                .get_mut(table.user_header().reader as usize);
            if let (Some(own), Some(slot)) = (own, slot)
                && own.incarnation == self.incarnation
            {
                *slot = own.next_sequence.max(*slot);
            }
        }
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
        transition: impl FnMut(usize) -> Transition,
    ) -> Result<(), WireError> {
        if steps > self.limit {
            return Err(WireError::TooLong {
                what: "trajectory",
                got: steps,
                limit: self.limit,
            });
        }
        let failed = |reason: String| WireError::Service {
            service: "trajectories".to_owned(),
            action: "send",
            reason,
        };
        let mut sample = self
            .publisher
            .loan_slice_uninit(steps)
            .map_err(|e| failed(format!("{e:?}")))?;
        *sample.user_header_mut() = TrajectoryHeader {
            layout: LAYOUT,
            actor: self.actor,
            incarnation: self.incarnation,
            kind: kind as u32,
            sequence: self.next,
            ..header
        };
        sample
            .write_from_fn(transition)
            .send()
            .map_err(|e| failed(format!("{e:?}")))?;
        self.next += 1;
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

/// What a reader has had from one actor process.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SourceCounts {
    /// The process.
    pub incarnation: u32,
    /// Next sequence number.
    pub next: u64,
    /// Transitions received.
    pub transitions: u64,
    /// Whether it said goodbye.
    pub left: bool,
}

/// What a reader has had in all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Trajectories received.
    pub trajectories: u64,
    /// Transitions received.
    pub transitions: u64,
    /// Messages missing by their sequence numbers.
    pub lost: u64,
    /// Messages that came a second time.
    pub repeated: u64,
    /// Messages refused: another layout, absurd lengths or ids, values that are not finite.
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
    sources: [SourceCounts; MAX_ACTORS],
    counts: Counts,
    news: bool,
}

impl TrajectoryReceiver {
    /// Joins as a reader.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus, reader: Reader) -> Result<Self, WireError> {
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
        Ok(Self {
            subscriber,
            publisher,
            wake_actors: bus.notifier(Waker::Actors)?,
            listener: bus.listener(Waker::Readers)?,
            reader,
            limit: bus.limits().trajectory_steps,
            sources: [SourceCounts::default(); MAX_ACTORS],
            counts: Counts::default(),
            news: false,
        })
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
                && (header.actor as usize) < MAX_ACTORS
                && header.kind <= Kind::Bye as u32
                && steps.len() <= self.limit;
            if !known {
                self.counts.refused += 1;
                continue;
            }
            if !self.expect(&header) {
                continue;
            }
            if header.kind == Kind::Data as u32 {
                if steps.iter().all(Transition::is_finite) {
                    self.counts.trajectories += 1;
                    self.counts.transitions += steps.len() as u64;
                    self.sources[header.actor as usize].transitions += steps.len() as u64;
                    take(&header, steps);
                } else {
                    self.counts.refused += 1;
                }
            }
        }
        most
    }

    /// Books a message by its sequence number; whether it is a new one.
    fn expect(&mut self, header: &TrajectoryHeader) -> bool {
        self.news = true;
        let source = &mut self.sources[header.actor as usize];
        if source.incarnation != header.incarnation {
            *source = SourceCounts {
                incarnation: header.incarnation,
                ..SourceCounts::default()
            };
            if header.kind != Kind::Hello as u32 {
                // This reader was restarted and had no hello: it counts from here.
                source.next = header.sequence;
            }
        }
        if header.kind == Kind::Hello as u32 && header.sequence < source.next {
            return false; // Said again while the answer was on its way.
        }
        if header.sequence < source.next {
            self.counts.repeated += 1;
            return false;
        }
        self.counts.lost += header.sequence - source.next;
        source.next = header.sequence + 1;
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
        *sample.user_header_mut() = AcknowledgementHeader {
            reader: self.reader as u32,
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
        status.settled = self.settled();
        status.lost = self.counts.lost;
        status.refused = self.counts.refused;
    }

    /// Whether every actor that ever said hello has taken its leave.
    #[must_use]
    pub fn all_left(&self) -> bool {
        self.sources().all(|(_, source)| source.left)
    }

    /// What was received in all.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Transitions from actors that took their leave.
    fn settled(&self) -> u64 {
        self.sources
            .iter()
            .filter(|source| source.left)
            .map(|source| source.transitions)
            .sum()
    }

    /// What was received from the newest process of each actor id.
    pub fn sources(&self) -> impl Iterator<Item = (u32, SourceCounts)> + '_ {
        (0..)
            .zip(self.sources)
            .filter(|(_, source)| source.incarnation != 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::tests::limits;
    use crate::domain::RunDomain;

    fn step(value: f32) -> Transition {
        Transition {
            reward: value,
            ..Transition::default()
        }
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
                    let mut sender = TrajectorySender::connect(&bus, actor, deadline).unwrap();
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
            let mut receiver = TrajectoryReceiver::new(&bus, Reader::Learner).unwrap();
            let start = Instant::now();
            while receiver.sources().filter(|(_, s)| s.left).count() < 3 {
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
            assert_eq!((counts.lost, counts.repeated, counts.refused), (0, 0, 0));
        });
        assert_eq!(sums, [10.0 * 99.0 * 50.0; 3]);
        drop(host);
        domain.remove();
    }

    #[test]
    fn without_acknowledgements_an_actor_stops_at_its_window() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let mut receiver = TrajectoryReceiver::new(&host, Reader::Learner).unwrap();
        let (ready, wait) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let id = domain.id().to_owned();
            scope.spawn(move || {
                let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
                let mut sender =
                    TrajectorySender::connect(&bus, 0, Duration::from_secs(10)).unwrap();
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
            while receiver.sources().all(|(_, source)| source.next < 2) {
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
            (counts.trajectories, counts.refused, counts.lost),
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
        let error = TrajectorySender::connect(&host, 0, Duration::from_millis(150))
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
