//! Whether what actors sent is what learner and graph-builder have: from both ends, process by
//! process.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use wire::{Books, Reader, State, Status};

/// Processes that are remembered; whoever publishes on a channel must not fill the memory.
const MOST: usize = 100_000;

/// What an actor process last said of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Account {
    /// Messages that all readers have acknowledged to it, the hellos included.
    acknowledged: u64,
    /// Transitions sent.
    sent: u64,
    /// Whether it took its leave, with all acknowledged.
    left: bool,
}

/// The actors' side, by id and incarnation.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Accounts(BTreeMap<String, Account>);

fn key(actor: u32, incarnation: u32) -> String {
    format!("{actor}-{incarnation:08x}")
}

impl Accounts {
    /// Takes in what an actor says.
    pub(crate) fn hear(&mut self, status: &Status) {
        let key = key(status.id, status.incarnation);
        if self.0.len() < MOST || self.0.contains_key(&key) {
            let account = Account {
                acknowledged: status.acknowledged,
                sent: status.sent,
                left: status.state == State::Finished as u32,
            };
            self.0.insert(key, account);
        }
    }

    /// Compares with the readers' ledgers: a line to show, and whether all agrees.
    pub(crate) fn settle(&self, folder: &Path, readers: &[Reader]) -> (String, bool) {
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
            // Of whatever was taken twice, the sums would tell.
            agree &= lost == 0 && received == books.counts.transitions;
        }
        (text, agree)
    }

    /// Messages that were acknowledged to an actor and that a reader has not, and transitions that
    /// one that left has sent more or less of than a reader has.
    fn missing(&self, books: &Books) -> u64 {
        let had: BTreeMap<String, _> = books
            .sources()
            .map(|source| (key(source.actor, source.incarnation), source))
            .collect();
        let missing = |(key, account): (&String, &Account)| {
            let (next, transitions) = had
                .get(key)
                .map_or((0, 0), |source| (source.next, source.transitions));
            let unknown = account.acknowledged.saturating_sub(next);
            // Of one that left the transitions are known too: none less, and none twice.
            let differing = account.sent.abs_diff(transitions);
            unknown + if account.left { differing } else { 0 }
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
    fn what_was_acknowledged_and_is_not_there_is_lost() {
        let mut accounts = Accounts::default();
        let mut status = Status {
            id: 1,
            incarnation: 5,
            acknowledged: 10,
            sent: 100,
            ..Status::default()
        };
        accounts.hear(&status);
        let books = |present| Books {
            present: vec![present],
            ..Books::default()
        };
        // A killed actor's last word is older than what was received.
        assert_eq!(accounts.missing(&books(source(5, 12, 120))), 0);
        assert_eq!(accounts.missing(&books(source(5, 8, 80))), 2);
        assert_eq!(accounts.missing(&books(source(6, 12, 120))), 10);
        status.state = State::Finished as u32;
        accounts.hear(&status);
        assert_eq!(accounts.missing(&books(source(5, 10, 100))), 0);
        assert_eq!(accounts.missing(&books(source(5, 10, 98))), 2);
        assert_eq!(accounts.missing(&books(source(5, 10, 102))), 2);
    }
}
