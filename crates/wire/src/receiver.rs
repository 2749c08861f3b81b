//! A reader's end of the trajectories: acknowledgements and the ledger.
//!
//! A reader takes messages in the order of their numbers alone, and writes down what it took before
//! it acknowledges it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use simulator::{RowLayout, Rows};

use crate::WireError;
use crate::bus::{Bus, Ipc, Waker, sleep};
use crate::ledger::{Books, Counts, Ledger, Source};
use crate::limits::Limits;
use crate::reader::Reader;
use crate::records::{
    Acknowledgement, AcknowledgementHeader, Kind, LAYOUT, MAX_ACTORS, TrajectoryHeader,
};
use crate::status::Status;

/// Incarnations of strangers that are named in the log.
const NAMED: u64 = 10;

/// A trajectory, read in place.
#[derive(Debug, Clone, Copy)]
pub struct Trajectory<'a> {
    /// Its steps, the final row among them; all finite.
    pub rows: Rows<'a>,
    /// The words of the choices that ended in it, as the algorithm writes and reads them.
    pub choices: &'a [u32],
}

/// The learner's or the graph-builder's end.
pub struct TrajectoryReceiver {
    subscriber: Subscriber<Ipc, [u32], TrajectoryHeader>,
    publisher: Publisher<Ipc, [Acknowledgement], AcknowledgementHeader>,
    wake_actors: Notifier<Ipc>,
    listener: Listener<Ipc>,
    reader: Reader,
    limits: Limits,
    layout: RowLayout,
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

    pub(crate) fn join(
        bus: &Bus,
        reader: Reader,
        (ledger, books): (Ledger, Books),
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
            layout: RowLayout::new(&bus.limits().spaces),
            limits: bus.limits().clone(),
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
        mut take: impl FnMut(&TrajectoryHeader, Trajectory<'_>),
    ) -> usize {
        let layout = self.layout;
        for number in 0..most {
            let Ok(Some(sample)) = self.subscriber.receive() else {
                return number;
            };
            let (header, words) = (*sample.user_header(), sample.payload());
            let trajectory = split(&layout, &self.limits, &header, words);
            let Some(trajectory) = trajectory.filter(|_| self.allows(&header)) else {
                refuse(&mut self.counts, self.reader, &header);
                continue;
            };
            if !self.expect(&header) || header.kind != Kind::Data as u32 {
                continue;
            }
            if trajectory.rows.iter().all(|row| row.is_finite()) {
                self.counts.trajectories += 1;
                self.counts.transitions += u64::from(header.rows);
                self.sources[header.actor as usize].transitions += u64::from(header.rows);
                take(&header, trajectory);
            } else {
                refuse(&mut self.counts, self.reader, &header);
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

    /// Counts a message by its sequence number. Returns whether it is the next one.
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
        self.note();
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

    /// Writes down what was received.
    pub(crate) fn note(&mut self) {
        self.ledger.write(&self.counts, &self.sources);
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

/// A message's parts, where its header and lengths are those of a message of this run.
fn split<'a>(
    layout: &'a RowLayout,
    limits: &Limits,
    header: &TrajectoryHeader,
    words: &'a [u32],
) -> Option<Trajectory<'a>> {
    let rows = header.rows as usize;
    let known = header.layout == LAYOUT
        && (header.actor as usize) < limits.max_actors
        && header.kind <= Kind::Bye as u32
        && rows <= limits.trajectory_rows;
    let (rows, choices) = words.split_at_checked(rows.checked_mul(layout.stride())?)?;
    (known && choices.len() <= limits.choice_words).then(|| Trajectory {
        rows: layout.rows(rows),
        choices,
    })
}

fn refuse(counts: &mut Counts, reader: Reader, header: &TrajectoryHeader) {
    counts.refused += 1;
    if counts.refused <= NAMED {
        let TrajectoryHeader {
            actor,
            kind,
            sequence,
            rows,
            ..
        } = header;
        let reader = reader.name();
        log::warn!(
            "{reader}: refused a message of {rows} steps that says it is number {sequence}, kind \
             {kind}, of actor {actor}"
        );
    }
}
