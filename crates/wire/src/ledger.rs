//! What a reader has had from every actor, in a file that outlives the reader: its successor
//! counts on where it stopped, so that nothing is taken twice and nothing is left out.
//!
//! Layout, little-endian: a head (64 bytes: magic, format, counts), a row (32 bytes) for each
//! actor id, then a row for each process that had an id before the present one. The head and the
//! rows of the present processes are one write within a page, which a killed process has either
//! done or not begun.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;

use crate::records::MAX_ACTORS;

const MAGIC: &[u8; 8] = b"FORMICAL";
const HEAD: usize = 64;
const ROW: usize = 32;
const TABLE: usize = HEAD + ROW * MAX_ACTORS;
/// A longer file is none of ours.
const LONGEST: u64 = 64 << 20;

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

/// What a reader has had from one actor process.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Source {
    /// The actor.
    pub actor: u32,
    /// The process; 0 for none.
    pub incarnation: u32,
    /// Next sequence number.
    pub next: u64,
    /// Transitions received.
    pub transitions: u64,
    /// Whether it said goodbye.
    pub left: bool,
}

pub(crate) struct Ledger {
    file: Option<File>,
    past: u64,
    /// What is written, made anew each time.
    table: Vec<u8>,
}

/// What a ledger holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Books {
    /// Of all messages.
    pub counts: Counts,
    /// Each actor id's present process.
    pub present: Vec<Source>,
    /// Processes that had an id before.
    pub past: Vec<Source>,
}

impl Ledger {
    /// Opens the ledger of a reader, or begins it; with what it holds.
    pub(crate) fn open(path: &Path) -> io::Result<(Self, Books)> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(path)?;
        let books = read(&mut file)?.unwrap_or_default();
        let past = books.past.len() as u64;
        let file = Some(file);
        let table = Vec::with_capacity(TABLE);
        Ok((Self { file, past, table }, books))
    }

    /// One that forgets, for readers that have no successor.
    #[cfg(test)]
    pub(crate) fn none() -> Self {
        Self {
            file: None,
            past: 0,
            table: vec![],
        }
    }

    /// Notes a process that has a successor now. To be followed by [`write`](Self::write).
    pub(crate) fn retire(&mut self, source: &Source) {
        let at = (TABLE + ROW * self.past as usize) as u64;
        self.put(&row(source), at);
        self.past += 1;
    }

    /// Notes the present state. Only then may it be acknowledged.
    pub(crate) fn write(&mut self, counts: &Counts, sources: &[Source; MAX_ACTORS]) {
        let mut bytes = std::mem::take(&mut self.table);
        bytes.clear();
        bytes.extend(MAGIC);
        for value in [
            self.past,
            counts.trajectories,
            counts.transitions,
            counts.repeated,
            counts.early,
            counts.refused,
        ] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.resize(HEAD, 0);
        sources.iter().for_each(|source| bytes.extend(row(source)));
        self.put(&bytes, 0);
        self.table = bytes;
    }

    fn put(&mut self, bytes: &[u8], at: u64) {
        let Some(file) = &self.file else { return };
        if let Err(error) = file.write_all_at(bytes, at) {
            log::warn!("the ledger ends here, a restart will not know of what comes: {error}");
            self.file = None;
        }
    }
}

impl Books {
    /// Reads a ledger's file.
    ///
    /// # Errors
    /// What the system refuses, or a file that is no ledger.
    pub fn read(path: &Path) -> io::Result<Self> {
        read(&mut File::open(path)?)?.ok_or_else(|| io::Error::other("not a ledger"))
    }

    /// All processes, those of before first.
    pub fn sources(&self) -> impl Iterator<Item = &Source> {
        let known = |source: &&Source| source.incarnation != 0;
        self.past.iter().chain(&self.present).filter(known)
    }
}

fn row(source: &Source) -> [u8; ROW] {
    let mut row = [0; ROW];
    row[..4].copy_from_slice(&source.actor.to_le_bytes());
    row[4..8].copy_from_slice(&source.incarnation.to_le_bytes());
    row[8..16].copy_from_slice(&source.next.to_le_bytes());
    row[16..24].copy_from_slice(&source.transitions.to_le_bytes());
    row[24] = u8::from(source.left);
    row
}

fn read(file: &mut File) -> io::Result<Option<Books>> {
    let mut bytes = vec![];
    file.take(LONGEST).read_to_end(&mut bytes)?;
    Ok(parse(&bytes))
}

fn parse(bytes: &[u8]) -> Option<Books> {
    let u64_at = |bytes: &[u8], at: usize| {
        let eight = bytes.get(at..at + 8)?.try_into().ok()?;
        Some(u64::from_le_bytes(eight))
    };
    let table = bytes.get(..TABLE)?;
    if !table.starts_with(MAGIC) {
        return None;
    }
    let head = |place: usize| u64_at(table, 8 + 8 * place);
    let counts = Counts {
        trajectories: head(1)?,
        transitions: head(2)?,
        repeated: head(3)?,
        early: head(4)?,
        refused: head(5)?,
    };
    let source = |row: &[u8]| {
        let ids = u64_at(row, 0)?;
        Some(Source {
            actor: ids as u32,
            incarnation: (ids >> 32) as u32,
            next: u64_at(row, 8)?,
            transitions: u64_at(row, 16)?,
            left: row.get(24) == Some(&1),
        })
    };
    let sources = |bytes: &[u8]| bytes.chunks_exact(ROW).map(source).collect::<Option<_>>();
    let past = usize::try_from(head(0)?).ok()?.checked_mul(ROW)?;
    Some(Books {
        counts,
        present: sources(&table[HEAD..])?,
        past: sources(bytes[TABLE..].get(..past)?)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(actor: u32, incarnation: u32, next: u64) -> Source {
        Source {
            actor,
            incarnation,
            next,
            transitions: 10 * next,
            left: next > 5,
        }
    }

    #[test]
    fn what_was_written_is_read_by_a_successor() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        let (mut ledger, books) = Ledger::open(&path).unwrap();
        assert_eq!(books, Books::default());
        let mut sources = [Source::default(); MAX_ACTORS];
        sources[3] = source(3, 77, 4);
        let counts = Counts {
            trajectories: 4,
            transitions: 40,
            repeated: 1,
            early: 2,
            refused: 3,
        };
        ledger.write(&counts, &sources);
        ledger.retire(&sources[3]);
        drop(ledger);
        // Killed between the two: the old process is still the present one, and is retired again.
        let (mut ledger, books) = Ledger::open(&path).unwrap();
        assert_eq!((books.counts, books.past.len()), (counts, 0));
        assert_eq!(books.present[3], sources[3]);
        ledger.retire(&sources[3]);
        sources[3] = source(3, 78, 9);
        ledger.write(&counts, &sources);
        let books = Books::read(&path).unwrap();
        let all: Vec<_> = books.sources().copied().collect();
        assert_eq!(all, [source(3, 77, 4), source(3, 78, 9)]);
    }

    #[test]
    fn damage_is_an_error_or_other_numbers_never_a_panic() {
        let mut bytes = vec![];
        bytes.extend(MAGIC);
        bytes.resize(TABLE + ROW, 0);
        bytes[8] = 1;
        assert_eq!(parse(&bytes).unwrap().past.len(), 1);
        for length in 0..bytes.len() {
            assert_eq!(parse(&bytes[..length]), None, "cut at {length}");
        }
        bytes[8..16].fill(0xff);
        assert_eq!(parse(&bytes), None, "more rows than there are");
    }
}
