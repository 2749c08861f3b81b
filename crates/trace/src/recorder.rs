//! Traces written by a thread of their own, so that whoever simulates never waits for a disk within
//! an episode. The thread has the lowest priority: where all cores are busy, it gets one or two
//! hundredths of one, and what it has not written waits in the queue.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender, TryRecvError, TrySendError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use simulator::Spaces;

use crate::record::{ChoiceRecord, EndRecord, OutcomeRecord, StepRecord};
use crate::still::Still;
use crate::write::EpisodeWriter;
use crate::{EpisodeMeta, TraceError};

/// Places in the queue: more than eight episodes.
const QUEUE: usize = 8192;
/// Memory that records in the queue may take (bytes): where they are large, as images are, the queue
/// has fewer places.
const MEMORY: usize = 64 << 20;
/// Memory of a record beside its observation (bytes).
const REST: usize = 512;
/// An episode that begins while less than half of the queue is free waits so long, and leaves no
/// trace if that does not help.
const PATIENCE: Duration = Duration::from_secs(2);
/// Traces leave so much of a disk (bytes) to what matters more: states, weights, the score.
const RESERVE: u64 = 64 << 20;
/// Nice, as far as it goes.
const LOWEST_PRIORITY: i32 = 19;
/// The thread looks by itself so often, for what is to be on disk within a second.
const LOOK: Duration = Duration::from_millis(250);

/// What becomes of an episode that begins while the thread is behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Behind {
    /// It waits, for two seconds at most: of an evaluation no trace is to be missing.
    Wait,
    /// It leaves no trace: training is not to wait.
    Skip,
}

/// An episode to trace.
#[derive(Debug, Clone)]
pub struct Episode {
    /// Where the trace goes.
    pub path: PathBuf,
    /// What it is called until it is whole; a name of this process alone.
    pub part: PathBuf,
    /// Which episode it is.
    pub meta: EpisodeMeta,
    /// The world around it.
    pub still: Arc<Still>,
    /// The simulator's state at its start, if it can be saved.
    pub state: Option<Vec<u8>>,
}

enum Job {
    /// An episode, and whether it was given up meanwhile.
    Begin(Box<Episode>, Arc<AtomicBool>),
    Outcome(OutcomeRecord),
    Choice(ChoiceRecord),
    Step(StepRecord),
    End(EndRecord),
}

/// Takes records, and never waits within an episode: where the disk cannot follow, the trace is given
/// up.
pub struct Recorder {
    /// None while it is dropped.
    queue: Option<SyncSender<Job>>,
    /// Places in the queue.
    places: u64,
    /// Step records that were written, to be filled anew: after the first episodes none is allocated.
    spare: Receiver<StepRecord>,
    thread: Option<JoinHandle<()>>,
    /// Whether an episode is being traced.
    open: bool,
    /// Whether the episode that was begun last is given up.
    discarded: Arc<AtomicBool>,
    /// Records put into the queue, and taken from it.
    sent: u64,
    taken: Arc<AtomicU64>,
    /// Records since the thread was woken.
    quiet: u64,
    /// Whether an episode has been skipped.
    skipped: bool,
    warn: fn(&str),
}

impl Recorder {
    /// Starts the thread, for records of a simulator's shape. `warn` gets what fails; once, until
    /// something works again.
    ///
    /// # Errors
    /// No more threads.
    pub fn new(spaces: &Spaces, warn: fn(&str)) -> std::io::Result<Self> {
        let bytes = 4 * spaces.observation.words() + REST;
        let places = (MEMORY / bytes).clamp(64, QUEUE);
        let (queue, jobs) = mpsc::sync_channel(places);
        let (written, spare) = mpsc::sync_channel(places);
        let taken = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&taken);
        let thread = std::thread::Builder::new()
            .name("trace".to_owned())
            .spawn(move || {
                // Of the calling thread alone, on Linux. Without it all works, less well.
                let _ = rustix::process::setpriority_process(None, LOWEST_PRIORITY);
                Writer {
                    taken: count,
                    written,
                    discarded: Arc::default(),
                    episode: None,
                    failed: false,
                    warn,
                }
                .work(&jobs);
            })?;
        Ok(Self {
            queue: Some(queue),
            places: places as u64,
            spare,
            thread: Some(thread),
            open: false,
            discarded: Arc::default(),
            sent: 0,
            taken,
            quiet: 0,
            skipped: false,
            warn,
        })
    }

    /// Whether an episode is being traced.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Begins a trace, where there is room for it.
    pub fn begin(&mut self, episode: Episode, behind: Behind) {
        let start = Instant::now();
        while self.sent - self.taken.load(Ordering::Relaxed) > self.places / 2 {
            if behind == Behind::Skip {
                self.skip();
                return;
            }
            if start.elapsed() > PATIENCE {
                (self.warn)("no trace: the disk is slower than the simulation");
                return;
            }
            self.wake();
            std::thread::sleep(Duration::from_millis(2));
        }
        self.open = true;
        self.discarded = Arc::default();
        self.send(Job::Begin(Box::new(episode), Arc::clone(&self.discarded)));
    }

    /// Records what became of a choice.
    pub fn outcome(&mut self, record: OutcomeRecord) {
        self.send(Job::Outcome(record));
    }

    /// Records a choice.
    pub fn choice(&mut self, record: ChoiceRecord) {
        self.send(Job::Choice(record));
    }

    /// An empty record to fill for [`step`](Self::step), without an allocation where one was written
    /// before.
    #[must_use]
    pub fn blank(&self) -> StepRecord {
        let mut record = self.spare.try_recv().unwrap_or_default();
        record.clear();
        record
    }

    /// Records a step.
    pub fn step(&mut self, record: StepRecord) {
        self.send(Job::Step(record));
    }

    /// Ends the trace: whole, it comes to its place a little later.
    pub fn end(&mut self, record: EndRecord) {
        self.send(Job::End(record));
        self.open = false;
    }

    /// Gives the trace up, with what of it waits in the queue: on full cores that is seconds of
    /// work, and whoever is told to end has not got them.
    pub fn discard(&mut self) {
        self.discarded.store(true, Ordering::Relaxed);
        self.open = false;
        self.wake();
    }

    fn skip(&mut self) {
        if !self.skipped {
            (self.warn)(
                "an episode of the training leaves no trace, nor may others: all cores are busy, \
                 and traces get what is left; fewer actors or a larger traces.training_every help",
            );
        }
        self.skipped = true;
    }

    fn wake(&mut self) {
        self.quiet = 0;
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }

    fn send(&mut self, job: Job) {
        let Some(queue) = self.queue.as_ref().filter(|_| self.open) else {
            return;
        };
        match queue.try_send(job) {
            Ok(()) => {
                self.sent += 1;
                self.quiet += 1;
                // Whoever wakes gets a slice of a few milliseconds, whatever its priority: to wake
                // the thread often would take them from the simulation.
                if self.quiet >= self.places / 4 {
                    self.wake();
                }
            }
            Err(TrySendError::Full(_)) => {
                // A trace with a hole is none; the thread gives it up when the next one begins.
                self.open = false;
                (self.warn)("a trace is given up: the disk is slower than the simulation");
            }
            Err(TrySendError::Disconnected(_)) => self.open = false,
        }
    }
}

impl Drop for Recorder {
    /// Waits for whole episodes in the queue to be written.
    fn drop(&mut self) {
        if self.open {
            self.discard();
        }
        self.queue = None;
        self.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Whether a trace's disk has more room than is kept from it.
fn has_room(path: &Path) -> Result<(), TraceError> {
    let folder = path.parent().unwrap_or(path);
    // Where nobody can tell, writing will.
    let Ok(disk) = rustix::fs::statvfs(folder) else {
        return Ok(());
    };
    let free = disk.f_bavail.saturating_mul(disk.f_frsize);
    if free >= RESERVE {
        return Ok(());
    }
    Err(TraceError::Mcap {
        path: path.display().to_string(),
        reason: format!(
            "its disk has {} MiB free, and the last {} are not for traces; free some",
            free >> 20,
            RESERVE >> 20
        ),
    })
}

/// The thread's side.
struct Writer {
    taken: Arc<AtomicU64>,
    /// Where records go once they are written.
    written: SyncSender<StepRecord>,
    /// Whether the episode that was taken last is given up.
    discarded: Arc<AtomicBool>,
    episode: Option<EpisodeWriter>,
    /// Whether the last trace failed, which was told.
    failed: bool,
    warn: fn(&str),
}

impl Writer {
    fn work(&mut self, jobs: &Receiver<Job>) {
        loop {
            if self.is_discarded() {
                self.discard();
            }
            match jobs.try_recv() {
                Ok(job) => {
                    self.taken.fetch_add(1, Ordering::Relaxed);
                    self.take(job);
                }
                Err(TryRecvError::Empty) => {
                    let due = |writer: &EpisodeWriter| Instant::now() >= writer.flush_due();
                    if self.episode.as_ref().is_some_and(due) {
                        self.write(EpisodeWriter::flush);
                    }
                    std::thread::park_timeout(LOOK);
                }
                Err(TryRecvError::Disconnected) => break,
            }
        }
        // Its end never came.
        self.discard();
    }

    fn take(&mut self, job: Job) {
        if let Job::Begin(_, discarded) = &job {
            // The end of the last one never came.
            self.discard();
            self.discarded = Arc::clone(discarded);
        }
        match job {
            Job::Begin(..) if self.is_discarded() => {}
            Job::Begin(episode, _) => {
                let Episode {
                    path,
                    part,
                    meta,
                    still,
                    state,
                } = *episode;
                let begun = has_room(&path)
                    .and_then(|()| EpisodeWriter::begin(&path, part, &meta, still, state));
                match begun {
                    Ok(writer) => self.episode = Some(writer),
                    Err(error) => self.fail(&error),
                }
            }
            Job::Outcome(record) => self.write(|writer| writer.outcome(&record)),
            Job::Choice(record) => self.write(|writer| writer.choice(record)),
            Job::Step(record) => {
                self.write(|writer| writer.step(&record));
                let _ = self.written.try_send(record);
            }
            Job::End(record) => match self.episode.take().map(|writer| writer.end(&record)) {
                Some(Err(error)) => self.fail(&error),
                Some(Ok(_)) => self.failed = false,
                None => {}
            },
        }
    }

    fn write(&mut self, work: impl FnOnce(&mut EpisodeWriter) -> Result<(), TraceError>) {
        if let Some(Err(error)) = self.episode.as_mut().map(work) {
            self.discard();
            self.fail(&error);
        }
    }

    fn fail(&mut self, error: &TraceError) {
        if !self.failed {
            (self.warn)(&format!("no trace: {error}"));
        }
        self.failed = true;
    }

    fn is_discarded(&self) -> bool {
        self.discarded.load(Ordering::Relaxed)
    }

    fn discard(&mut self) {
        if let Some(writer) = self.episode.take() {
            writer.discard();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;

    #[test]
    fn what_waits_of_an_episode_that_was_given_up_is_not_written() {
        let episode = |number: u32| {
            let path = PathBuf::from(format!("/no such folder/{number}.mcap"));
            let part = path.with_extension("part");
            Box::new(Episode {
                path,
                part,
                meta: EpisodeMeta::default(),
                still: Arc::new(Still::new(Scene::default())),
                state: None,
            })
        };
        let (queue, jobs) = mpsc::sync_channel(4);
        for (number, discarded) in [(1, true), (2, true), (3, false)] {
            let discarded = Arc::new(AtomicBool::new(discarded));
            let job = Job::Begin(episode(number), discarded);
            assert!(queue.send(job).is_ok());
        }
        drop(queue);
        let told = |told: &str| assert!(told.contains("/3.mcap"), "{told}");
        let mut writer = Writer {
            taken: Arc::default(),
            written: mpsc::sync_channel(1).0,
            discarded: Arc::default(),
            episode: None,
            failed: false,
            warn: told,
        };
        writer.work(&jobs);
        assert!(writer.failed, "the third was tried");
    }
}
