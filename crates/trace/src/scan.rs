//! Looks through any file of MCAP, whole or not: which of its bytes are whole records, and which are
//! lost. Twice: first to find what is whole and what the channels are, for a file that lost the chunk
//! with its channels has them again in its summary; then to visit the messages.
//!
//! A chunk is whole when its checksum holds, and an attachment likewise. What has no checksum is whole
//! when it has the shape of its kind and another record follows. After damage the scan goes on at the
//! next byte at which a record begins that is whole by a checksum or by its exact shape.

mod chunk;
mod frame;
mod resume;
mod source;

use std::collections::BTreeMap;
use std::io::{self, Read, Seek};
use std::ops::Range;

use mcap::records::{Channel, MessageHeader, Record, op};

use crate::Lost;
use frame::{Frame, MESSAGE_HEAD, Shape};
use source::Source;

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

/// What is told of the records of a file.
pub(crate) trait Visit {
    /// What ends the visit.
    type Error;

    /// Whether the bytes of a message's data, or of a metadata record or attachment, are wanted: they
    /// are not read otherwise.
    fn wants(&self, opcode: u8, channel: u16, len: u64) -> bool;

    /// A message, with no data where they are not wanted.
    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), Self::Error>;

    /// A metadata record or attachment that is wanted.
    fn record(&mut self, record: Record<'_>) -> Result<(), Self::Error>;
}

/// Why a visit ended before its time.
pub(crate) enum Stop<E> {
    /// The system refused.
    Io(io::Error),
    /// The visitor did.
    Visitor(E),
}

impl<E> From<io::Error> for Stop<E> {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
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

    /// Whether a record is whole, or why it is not. What describes messages is kept.
    fn examine(&mut self, frame: &Frame) -> io::Result<Result<(), String>> {
        let shape = self.source.shape(frame)?;
        let (name, at) = (frame.name(), frame.at);
        let broken = || Err(format!("the {name} at byte {at} is damaged"));
        if shape == Shape::Broken {
            return Ok(broken());
        }
        match frame.opcode {
            op::CHUNK => return Ok(self.chunk(frame)),
            op::ATTACHMENT => {
                if let Some(whole) = self.attachment(frame)? {
                    return Ok(if whole { Ok(()) } else { broken() });
                }
            }
            op::FOOTER => {
                let (end, len) = (frame.end(), self.source.len());
                // Even one that was cut within its magic.
                let rest = self.source.bytes(end, MAGIC)?;
                if !mcap::MAGIC.starts_with(&rest) || end + (rest.len() as u64) > len {
                    return Ok(broken());
                }
                self.footer = Some(*frame);
                return Ok(Ok(()));
            }
            _ => {}
        }
        let followed = self.source.follows(frame.end())?;
        let sound = match shape {
            Shape::Exact => true,
            Shape::Loose if frame.opcode == op::MESSAGE => followed || self.tells(frame)?,
            _ => followed,
        };
        if !sound {
            return Ok(broken());
        }
        match frame.opcode {
            op::SCHEMA | op::CHANNEL | op::METADATA | op::HEADER => {
                if frame.len > KEPT {
                    return Ok(Err(format!("the {name} at byte {at} is over {KEPT} bytes")));
                }
                let body = self.source.bytes(frame.body(), frame.len)?;
                match mcap::parse_record(frame.opcode, &body) {
                    Ok(record) => self.describe(record, frame.len),
                    Err(error) => {
                        return Ok(Err(format!("the {name} at byte {at} is damaged: {error}")));
                    }
                }
            }
            op::DATA_END => {
                let crc = self.source.array(frame.body())?;
                self.data_end = Some((*frame, crc.map_or(0, u32::from_le_bytes)));
            }
            _ => {}
        }
        Ok(Ok(()))
    }

    fn describe(&mut self, record: Record<'_>, len: u64) {
        if self.described.saturating_add(len) > DESCRIPTIONS {
            return;
        }
        match record {
            Record::Schema { header, data } if !self.schemas.contains_key(&header.id) => {
                self.described += len;
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.schemas.insert(header.id, schema);
            }
            Record::Channel(channel) if !self.channels.contains_key(&channel.id) => {
                self.described += len;
                self.channels.insert(channel.id, channel);
            }
            _ => {}
        }
    }

    /// Looks through a chunk; its schemas and channels count once all of it is whole.
    fn chunk(&mut self, frame: &Frame) -> Result<(), String> {
        let chunk = self.source.chunk(frame)?;
        let mut told = vec![];
        let mut room = DESCRIPTIONS.saturating_sub(self.described);
        let walked = self.source.walk(&chunk, |mut inner| {
            let (opcode, len) = (inner.opcode, inner.len);
            if [op::SCHEMA, op::CHANNEL].contains(&opcode) && len <= KEPT.min(room) {
                room -= len;
                told.push((opcode, inner.bytes(len)?));
            }
            Ok(())
        });
        if let Err(reason) = walked {
            self.pay(chunk.cost());
            return Err(reason);
        }
        for (opcode, body) in &told {
            let record = mcap::parse_record(*opcode, body)
                .map_err(|error| format!("the chunk at byte {} is damaged: {error}", frame.at))?;
            self.describe(record, body.len() as u64);
        }
        Ok(())
    }

    /// Whether an attachment's checksum holds; none where it has none.
    fn attachment(&mut self, frame: &Frame) -> io::Result<Option<bool>> {
        let Some(at) = frame.end().checked_sub(4).filter(|at| *at >= frame.body()) else {
            return Ok(Some(false));
        };
        let Some(saved) = self.source.array(at)?.map(u32::from_le_bytes) else {
            return Ok(Some(false));
        };
        if saved == 0 {
            return Ok(None);
        }
        let holds = saved == self.source.checksum(frame.body(), at)?;
        if !holds {
            self.pay(frame.len);
        }
        Ok(Some(holds))
    }

    /// Work that was for nothing. Whoever makes a file of nothing else does not keep us busy for ever.
    fn pay(&mut self, bytes: u64) {
        self.budget = self.budget.saturating_sub(bytes);
    }

    /// Whether a message that no record follows is one that its topic may have.
    fn tells(&mut self, frame: &Frame) -> io::Result<bool> {
        let id = self.source.array(frame.body())?.map(u16::from_le_bytes);
        let Some(channel) = id.and_then(|id| self.channels.get(&id)) else {
            return Ok(false);
        };
        let topic = crate::topic::Topic::of(channel, &self.schemas);
        if frame.len > KEPT {
            return Ok(topic.is_none());
        }
        let len = frame.len - MESSAGE_HEAD;
        let data = self.source.bytes(frame.body() + MESSAGE_HEAD, len)?;
        Ok(topic.is_none_or(|topic| topic.decodes(&data)))
    }

    /// Visits all messages, metadata records and attachments that are whole, in the order of the
    /// file.
    pub(crate) fn visit<V: Visit>(&mut self, visitor: &mut V) -> Result<(), Stop<V::Error>> {
        for range in self.sound.clone() {
            let mut at = range.start;
            while at < range.end {
                let Some(frame) = self.source.frame(at)? else {
                    // The file has changed meanwhile.
                    return Err(Stop::Io(io::ErrorKind::UnexpectedEof.into()));
                };
                self.visit_frame(&frame, visitor)?;
                at = frame.end();
            }
        }
        Ok(())
    }

    fn visit_frame<V: Visit>(
        &mut self,
        frame: &Frame,
        visitor: &mut V,
    ) -> Result<(), Stop<V::Error>> {
        let opcode = frame.opcode;
        match opcode {
            op::MESSAGE => {
                let head = self
                    .source
                    .array::<{ MESSAGE_HEAD as usize }>(frame.body())?;
                let header = head.as_ref().and_then(header);
                let header = header.ok_or_else(|| Stop::Io(io::ErrorKind::UnexpectedEof.into()))?;
                let len = frame.len.saturating_sub(MESSAGE_HEAD);
                let mut data = vec![];
                if len <= MOST && visitor.wants(opcode, header.channel_id, len) {
                    data = self.source.bytes(frame.body() + MESSAGE_HEAD, len)?;
                }
                visitor.message(&header, &data).map_err(Stop::Visitor)
            }
            op::METADATA | op::ATTACHMENT
                if frame.len <= MOST && visitor.wants(opcode, 0, frame.len) =>
            {
                let body = self.source.bytes(frame.body(), frame.len)?;
                match mcap::parse_record(opcode, &body) {
                    Ok(record) => visitor.record(record).map_err(Stop::Visitor),
                    Err(_) => Ok(()),
                }
            }
            op::CHUNK => self.visit_chunk(frame, visitor),
            _ => Ok(()),
        }
    }

    fn visit_chunk<V: Visit>(
        &mut self,
        frame: &Frame,
        visitor: &mut V,
    ) -> Result<(), Stop<V::Error>> {
        let changed = |reason: String| Stop::Io(io::Error::other(reason));
        let chunk = self.source.chunk(frame).map_err(changed)?;
        let mut stopped = None;
        let walked = self.source.walk(&chunk, |mut inner| {
            if inner.opcode != op::MESSAGE || stopped.is_some() {
                return Ok(());
            }
            let head = inner.bytes(MESSAGE_HEAD)?;
            let head: [u8; MESSAGE_HEAD as usize] = (*head)
                .try_into()
                .map_err(|_| io::ErrorKind::UnexpectedEof)?;
            let Some(header) = header(&head) else {
                return Ok(());
            };
            let len = inner.len - MESSAGE_HEAD;
            let mut data = vec![];
            if visitor.wants(op::MESSAGE, header.channel_id, len) {
                data = inner.bytes(len)?;
            }
            if let Err(error) = visitor.message(&header, &data) {
                stopped = Some(error);
            }
            Ok(())
        });
        match (stopped, walked) {
            (Some(error), _) => Err(Stop::Visitor(error)),
            (None, walked) => walked.map_err(changed),
        }
    }
}

/// A message's head.
fn header(bytes: &[u8; MESSAGE_HEAD as usize]) -> Option<MessageHeader> {
    match mcap::parse_record(op::MESSAGE, bytes) {
        Ok(Record::Message { header, .. }) => Some(header),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
