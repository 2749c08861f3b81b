//! Checks at the end of a run that learner and graph-builder received what each actor process sent.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use wire::{Books, Reader, State, Status};

/// Maximum number of processes, since ids come from a channel.
const MOST: usize = 100_000;

/// The last status of an actor process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Deliveries {
    /// Messages that all readers have acknowledged, including hellos.
    acknowledged: u64,
    /// Transitions sent.
    sent: u64,
    /// Whether it disconnected cleanly, with all acknowledged.
    left: bool,
}

/// Deliveries of actor processes, by id and incarnation.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct DeliveryAudit(BTreeMap<String, Deliveries>);

fn key(actor: u32, incarnation: u32) -> String {
    format!("{actor}-{incarnation:08x}")
}

impl DeliveryAudit {
    /// Adds the status of an actor.
    pub(crate) fn on_status(&mut self, status: &Status) {
        let key = key(status.id, status.incarnation);
        if self.0.len() < MOST || self.0.contains_key(&key) {
            let sent = Deliveries {
                acknowledged: status.acknowledged,
                sent: status.sent,
                left: status.state == State::Finished as u32,
            };
            self.0.insert(key, sent);
        }
    }

    /// Compares with the ledgers of the readers. Returns a line to print, and whether all agrees.
    pub(crate) fn compare(&self, folder: &Path, readers: &[Reader]) -> (String, bool) {
        let mut text = String::from("transitions: ");
        let mut agree = true;
        for (i, reader) in readers.iter().enumerate() {
            let gap = if i > 0 { ", " } else { "" };
            let Ok(books) = Books::read(&reader.ledger(folder)) else {
                let _ = write!(text, "{gap}no ledger of the {}", reader.name());
                agree = false;
                continue;
            };
            let lost = self.missing(&books);
            let received: u64 = books.sources().map(|source| source.transitions).sum();
            let left = books.sources().filter(|source| source.left);
            let left: u64 = left.map(|source| source.transitions).sum();
            let _ = write!(
                text,
                "{gap}{received} received by the {} ({lost} lost, {} refused), {left} of them from \
                 actors that took their leave",
                reader.name(),
                books.counts.refused,
            );
            // Transitions that were counted twice would change the sum.
            agree &= lost == 0 && received == books.counts.transitions;
        }
        (text, agree)
    }

    /// Acknowledged messages that a reader does not have, and differences in the transitions of actors that
    /// disconnected cleanly.
    fn missing(&self, books: &Books) -> u64 {
        let had: BTreeMap<String, _> = books
            .sources()
            .map(|source| (key(source.actor, source.incarnation), source))
            .collect();
        let missing = |(key, sent): (&String, &Deliveries)| {
            let (next, transitions) = had
                .get(key)
                .map_or((0, 0), |source| (source.next, source.transitions));
            let unknown = sent.acknowledged.saturating_sub(next);
            // After a clean disconnect the number of transitions is final.
            let differing = sent.sent.abs_diff(transitions);
            unknown + if sent.left { differing } else { 0 }
        };
        self.0.iter().map(missing).sum()
    }
}

#[cfg(test)]
mod tests {
    use wire::Source;

    use super::*;

    fn source(incarnation: u32, next: u64, transitions: u64) -> Source {
        Source {
            actor: 1,
            incarnation,
            next,
            transitions,
            left: false,
        }
    }

    #[test]
    fn acknowledged_messages_that_are_missing_are_lost() {
        let mut audit = DeliveryAudit::default();
        let mut status = Status {
            id: 1,
            incarnation: 5,
            acknowledged: 10,
            sent: 100,
            ..Status::default()
        };
        audit.on_status(&status);
        let books = |present| Books {
            present: vec![present],
            ..Books::default()
        };
        // The last status of a killed actor is older than what was received.
        assert_eq!(audit.missing(&books(source(5, 12, 120))), 0);
        assert_eq!(audit.missing(&books(source(5, 8, 80))), 2);
        assert_eq!(audit.missing(&books(source(6, 12, 120))), 10);
        status.state = State::Finished as u32;
        audit.on_status(&status);
        assert_eq!(audit.missing(&books(source(5, 10, 100))), 0);
        assert_eq!(audit.missing(&books(source(5, 10, 98))), 2);
        assert_eq!(audit.missing(&books(source(5, 10, 102))), 2);
    }
}
