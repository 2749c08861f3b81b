//! A bounded queue of output. When it is full, the oldest text is dropped.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::stream::Stream;

/// Maximum number of texts.
const MOST: usize = 1000;

/// Texts for a writer thread.
pub(super) struct Queue {
    waiting: Mutex<Waiting>,
    /// Signalled when a text was added.
    added: Condvar,
    /// Signalled when a text was written.
    written: Condvar,
}

struct Waiting {
    texts: VecDeque<(Stream, String)>,
    dropped: usize,
    /// Number of texts that the writer has taken.
    taken: u64,
    /// Whether a text is being written.
    busy: bool,
}

impl Waiting {
    fn is_over(&self) -> bool {
        self.texts.is_empty() && !self.busy
    }
}

impl Queue {
    pub(super) const fn new() -> Self {
        Self {
            waiting: Mutex::new(Waiting {
                texts: VecDeque::new(),
                dropped: 0,
                taken: 0,
                busy: false,
            }),
            added: Condvar::new(),
            written: Condvar::new(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a text, without waiting for the writer.
    pub(super) fn put(&self, stream: Stream, text: String) {
        let mut waiting = self.lock();
        if waiting.texts.len() >= MOST {
            waiting.texts.pop_front();
            waiting.dropped += 1;
        }
        waiting.texts.push_back((stream, text));
        self.added.notify_one();
    }

    /// Writes texts forever.
    pub(super) fn work(&self, mut write: impl FnMut(Stream, &str)) {
        loop {
            let mut waiting = self.lock();
            waiting.busy = false;
            self.written.notify_all();
            let empty = |waiting: &mut Waiting| waiting.texts.is_empty();
            let wait = self.added.wait_while(waiting, empty);
            let mut waiting = wait.unwrap_or_else(PoisonError::into_inner);
            let dropped = std::mem::take(&mut waiting.dropped);
            let Some((stream, text)) = waiting.texts.pop_front() else {
                continue;
            };
            waiting.taken += 1;
            waiting.busy = true;
            drop(waiting);
            if dropped > 0 {
                let text = format!("({dropped} messages were left out: nobody read them)\n");
                write(stream, &text);
            }
            write(stream, &text);
        }
    }

    /// Waits until all is written, or until nothing was written for `patience`.
    pub(super) fn flush(&self, patience: Duration) {
        let mut waiting = self.lock();
        while !waiting.is_over() {
            let before = waiting.taken;
            let stuck = |waiting: &mut Waiting| !waiting.is_over() && waiting.taken == before;
            let wait = self.written.wait_timeout_while(waiting, patience, stuck);
            let (after, wait) = wait.unwrap_or_else(PoisonError::into_inner);
            if wait.timed_out() {
                return;
            }
            waiting = after;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::channel;
    use std::time::Instant;

    use super::*;

    #[test]
    fn a_blocked_reader_costs_the_oldest_lines_and_no_time() {
        let queue = Arc::new(Queue::new());
        let (go, wait) = channel::<()>();
        let (written, read) = channel();
        let own = Arc::clone(&queue);
        std::thread::spawn(move || {
            own.work(|_, text| {
                let _ = wait.recv();
                let _ = written.send(text.to_owned());
            });
        });
        queue.put(Stream::Out, "first".to_owned());
        let start = Instant::now();
        while !queue.lock().busy {
            assert!(start.elapsed() < Duration::from_secs(20));
            std::thread::yield_now();
        }
        for i in 0..MOST + 5 {
            queue.put(Stream::Out, i.to_string());
        }
        let start = Instant::now();
        queue.flush(Duration::from_millis(50));
        assert!(
            start.elapsed() < Duration::from_secs(10),
            "it waits in vain"
        );
        drop(go);
        queue.flush(Duration::from_secs(20));
        let all: Vec<String> = read.try_iter().collect();
        assert_eq!(all.len(), 2 + MOST);
        assert_eq!(all[0], "first");
        assert_eq!(all[1], "(5 messages were left out: nobody read them)\n");
        assert_eq!(all[2], "5");
        assert_eq!(all[MOST + 1], (MOST + 4).to_string());
    }
}
