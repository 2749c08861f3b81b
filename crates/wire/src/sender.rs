//! An actor's end of the trajectories: hello, sequence numbers, window.
//!
//! An actor keeps what is not acknowledged and sends it again when a reader was restarted or is
//! silent for long, so that every message is taken once by every reader, whoever dies.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use simulator::Rows;

use crate::WireError;
use crate::bus::{Bus, Claim, Ipc, Waker, sleep};
use crate::limits::Limits;
use crate::reader::Reader;
use crate::records::{Acknowledgement, AcknowledgementHeader, Kind, LAYOUT, TrajectoryHeader};

/// How often a hello is said again, and a waiting side looks up without being woken.
const REPEAT: Duration = Duration::from_millis(100);

/// How often the second hello is said again.
const SECOND_REPEAT: Duration = Duration::from_secs(2);

/// Silence of a reader after which what it has not acknowledged is sent again.
const AGAIN: Duration = Duration::from_secs(2);

/// A message that is not acknowledged by all.
struct Unacknowledged {
    header: TrajectoryHeader,
    words: Vec<u32>,
}

/// An actor's end.
pub struct TrajectorySender {
    publisher: Publisher<Ipc, [u32], TrajectoryHeader>,
    acknowledgements: Subscriber<Ipc, [Acknowledgement], AcknowledgementHeader>,
    wake_readers: Notifier<Ipc>,
    listener: Listener<Ipc>,
    readers: Vec<Reader>,
    claim: Claim,
    window: u64,
    limits: Limits,
    next: u64,
    /// Next sequence number that each reader waits for, by the reader's number.
    acknowledged: [u64; 2],
    /// Each reader's process.
    incarnations: [u32; 2],
    /// Oldest first.
    unacknowledged: VecDeque<Unacknowledged>,
    /// Buffers of messages that are acknowledged.
    spare: Vec<Vec<u32>>,
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
                .initial_max_slice_len(limits.trajectory_words())
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
            limits: limits.clone(),
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
                    sender.publish(Kind::Hello, header, &[], &[])?;
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
                self.spare.push(message.words);
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
            let Ok(mut sample) = self.publisher.loan_slice_uninit(message.words.len()) else {
                return;
            };
            *sample.user_header_mut() = message.header;
            let _ = sample.write_from_slice(&message.words).send();
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

    /// Sends rows and the words of choices that ended. Only with [`credit`](Self::credit). Of the
    /// header, the caller sets episode, first step, environment, round and versions.
    ///
    /// # Errors
    /// More rows or words than the run's limits, or what iceoryx2 refuses.
    pub fn send(
        &mut self,
        header: TrajectoryHeader,
        rows: Rows<'_>,
        choices: &[u32],
    ) -> Result<(), WireError> {
        let Limits {
            trajectory_rows,
            choice_words,
            ..
        } = self.limits;
        for (what, got, limit) in [
            ("trajectory", rows.len(), trajectory_rows),
            ("list of choices", choices.len(), choice_words),
        ] {
            if got > limit {
                return Err(WireError::TooLong { what, got, limit });
            }
        }
        let number = rows.len() as u32;
        let header = TrajectoryHeader {
            rows: number,
            ..header
        };
        self.publish(Kind::Data, header, rows.words(), choices)?;
        self.transitions += u64::from(number);
        Ok(())
    }

    fn publish(
        &mut self,
        kind: Kind,
        header: TrajectoryHeader,
        rows: &[u32],
        choices: &[u32],
    ) -> Result<(), WireError> {
        let failed = |reason: String| WireError::service("trajectories", "send", reason, None);
        let mut words = self.spare.pop().unwrap_or_default();
        words.clear();
        words.extend_from_slice(rows);
        words.extend_from_slice(choices);
        let mut sample = self
            .publisher
            .loan_slice_uninit(words.len())
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
        sample
            .write_from_slice(&words)
            .send()
            .map_err(|e| failed(format!("{e:?}")))?;
        self.next += 1;
        if kind != Kind::Hello {
            self.unacknowledged
                .push_back(Unacknowledged { header, words });
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
        let said = self.publish(Kind::Bye, TrajectoryHeader::default(), &[], &[]);
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
