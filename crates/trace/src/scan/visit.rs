//! What whole records hold.

use std::io::{self, Read, Seek};

use mcap::records::{MessageHeader, Record, op};

use super::frame::{Frame, MESSAGE_HEAD};
use super::{MOST, Scan};

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

impl<R: Read + Seek> Scan<R> {
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

    pub(super) fn visit_frame<V: Visit>(
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
