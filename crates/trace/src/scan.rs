//! Looks through any file of MCAP, whole or not: which of its bytes are whole records, and which are
//! lost. Twice: first to find what is whole and what the channels are, for a file that lost the chunk
//! with its channels has them again in its summary; then to visit the messages.
//!
//! A chunk is whole when its checksum holds, and an attachment likewise. What has no checksum is whole
//! when it has the shape of its kind and another record follows. After damage the scan goes on at the
//! next byte at which a record begins that is whole by a checksum or by its exact shape.

mod chunk;
mod examine;
mod frame;
mod resume;
mod source;
mod visit;

use std::collections::BTreeMap;
use std::io::{self, Read, Seek};
use std::ops::Range;

use mcap::records::Channel;

use crate::Lost;
use frame::Frame;
use source::Source;
pub(crate) use visit::{Stop, Visit};

/// Bound on a record that is kept in memory as long as the scan: schemas, channels, metadata.
const KEPT: u64 = 16 << 20;
/// Bound on all schemas and channels.
const DESCRIPTIONS: u64 = 256 << 20;
/// Bound on a record that is read into memory at all.
const MOST: u64 = 1 << 30;
/// Bytes of the magic at both ends.
const MAGIC: u64 = mcap::MAGIC.len() as u64;

/// A schema as a file tells it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

/// A file that was looked through.
pub(crate) struct Scan<R> {
    source: Source<R>,
    /// Whole records.
    sound: Vec<Range<u64>>,
    /// All schemas and channels by their ids; of two that claim one id, the first.
    pub(crate) schemas: BTreeMap<u16, Schema>,
    pub(crate) channels: BTreeMap<u16, Channel>,
    described: u64,
    /// Bytes of no whole record, in order.
    pub(crate) lost: Vec<Lost>,
    /// Damage of which nobody knows where it is, or that costs nothing.
    pub(crate) notes: Vec<String>,
    /// Why the file is cut off; none where it ends as it should.
    pub(crate) cut: Option<String>,
    /// Where the data section ends and its checksum, and where the footer is.
    data_end: Option<(Frame, u32)>,
    footer: Option<Frame>,
    /// Bytes that may yet be looked at in search of whole records.
    budget: u64,
}

impl<R: Read + Seek> Scan<R> {
    /// Looks through a file.
    ///
    /// # Errors
    /// What the system refuses.
    pub(crate) fn of(inner: R) -> io::Result<Self> {
        let source = Source::new(inner)?;
        let budget = source.len().saturating_mul(8).saturating_add(MOST);
        let mut scan = Self {
            source,
            sound: vec![],
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            described: 0,
            lost: vec![],
            notes: vec![],
            cut: None,
            data_end: None,
            footer: None,
            budget,
        };
        scan.look()?;
        Ok(scan)
    }

    /// The first bytes, as many as there are of those that say what a file is.
    pub(crate) fn beginning(&mut self) -> io::Result<Vec<u8>> {
        self.source.bytes(0, MAGIC)
    }

    /// Bytes in all.
    pub(crate) fn len(&self) -> u64 {
        self.source.len()
    }

    /// Whether any record is whole.
    pub(crate) fn has_records(&self) -> bool {
        !self.sound.is_empty()
    }

    fn look(&mut self) -> io::Result<()> {
        let len = self.source.len();
        let mut at = 0;
        if self.source.is_magic(0)? {
            at = MAGIC;
        } else if len > 0 {
            at = self.resume(0)?;
            self.lose(0, at, "they should begin an MCAP file".to_owned());
        }
        let mut ended = false;
        while at < len && !ended {
            let after_footer = self.footer.is_some_and(|footer| footer.end() == at);
            if after_footer && self.source.is_magic(at)? {
                at += MAGIC;
                ended = true;
                continue;
            }
            at = match self.source.frame(at)? {
                None => self.skip(at, format!("the record at byte {at} does not end"))?,
                Some(frame) => match self.examine(&frame)? {
                    Ok(()) => self.keep(&frame),
                    // Where a record follows, the length is right, and it alone is lost.
                    Err(reason) if self.source.is_chain(frame.end())? => {
                        self.lose(at, frame.end(), reason);
                        frame.end()
                    }
                    Err(reason) => self.skip(at, reason)?,
                },
            };
        }
        self.conclude(at, ended)
    }

    fn keep(&mut self, frame: &Frame) -> u64 {
        match self.sound.last_mut() {
            Some(last) if last.end == frame.at => last.end = frame.end(),
            _ => self.sound.push(frame.at..frame.end()),
        }
        frame.end()
    }

    fn lose(&mut self, from: u64, to: u64, reason: String) {
        match self.lost.last_mut() {
            Some(last) if last.to == from => last.to = to,
            _ => self.lost.push(Lost { from, to, reason }),
        }
    }

    /// Leaves out what is between `at` and the next whole record; where that is.
    fn skip(&mut self, at: u64, reason: String) -> io::Result<u64> {
        let next = self.resume(at + 1)?;
        self.lose(at, next, reason);
        Ok(next)
    }

    /// Says how the file ends, and looks whether the checksums of its sections hold.
    fn conclude(&mut self, at: u64, ended: bool) -> io::Result<()> {
        let len = self.source.len();
        if ended {
            if at < len {
                let more = len - at;
                self.notes.push(format!(
                    "{more} bytes follow the end of the MCAP file at byte {at}; they are left out"
                ));
            }
        } else if len < MAGIC || !self.source.is_magic(len - MAGIC)? {
            let tail = self.lost.last().filter(|lost| lost.to == len);
            self.cut = Some(match tail {
                Some(Lost { from, reason, .. }) => {
                    format!("it has no footer, and after byte {from} no whole record: {reason}")
                }
                None if at <= MAGIC => format!("it ends after its first {len} bytes"),
                None => format!("it has no footer; it ends at byte {len} after a whole record"),
            });
        } else if self.lost.is_empty() {
            let told = "its footer is missing, and with it the index; the data are all there";
            self.notes.push(told.to_owned());
        }
        if !self.lost.is_empty() || self.cut.is_some() {
            return Ok(());
        }
        let Some((end, saved)) = self.data_end else {
            return Ok(());
        };
        if saved != 0 && saved != self.source.checksum(0, end.at)? {
            let told = "the checksum of its data does not hold, and nothing tells where the \
                        damage is";
            self.notes.push(told.to_owned());
        }
        let Some(footer) = self.footer else {
            return Ok(());
        };
        let until = footer.body() + 16;
        let saved = self.source.array(until)?.map_or(0, u32::from_le_bytes);
        if saved != 0 && saved != self.source.checksum(end.end(), until)? {
            let told = "the checksum of its summary does not hold; that is an index alone, and the \
                        data are all there";
            self.notes.push(told.to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
