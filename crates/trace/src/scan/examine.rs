//! Whether a record is whole.

use std::io::{self, Read, Seek};

use mcap::records::{Record, op};

use super::frame::{Frame, MESSAGE_HEAD, Shape};
use super::{DESCRIPTIONS, KEPT, MAGIC, Scan, Schema};

impl<R: Read + Seek> Scan<R> {
    /// Whether a record is whole, or why it is not. What describes messages is kept.
    pub(super) fn examine(&mut self, frame: &Frame) -> io::Result<Result<(), String>> {
        let shape = self.source.shape(frame)?;
        let (name, at) = (frame.name(), frame.at);
        let broken = || Err(format!("the {name} at byte {at} is damaged"));
        if shape == Shape::Broken {
            return Ok(broken());
        }
        match frame.opcode {
            op::CHUNK => return Ok(self.chunk(frame, shape)),
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
        // Bytes that are missing from its middle make it end in the next one, which begins within it.
        if !sound || !followed && self.resume(at + 1)? < frame.end() {
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
            // Zeros in the place of a record outside of chunks may leave its id and nothing else; the
            // summary has the channel again.
            Record::Channel(channel)
                if (self.channels.get(&channel.id)).is_none_or(|known| known.topic.is_empty()) =>
            {
                self.described += len;
                self.channels.insert(channel.id, channel);
            }
            _ => {}
        }
    }

    /// Looks through a chunk; its schemas and channels count once all of it is whole.
    fn chunk(&mut self, frame: &Frame, shape: Shape) -> Result<(), String> {
        let chunk = self.source.chunk(frame)?;
        if chunk.is_empty() && shape == Shape::Loose {
            return Err(format!(
                "the chunk at byte {} holds less than its length",
                frame.at
            ));
        }
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
    pub(super) fn attachment(&mut self, frame: &Frame) -> io::Result<Option<bool>> {
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
    pub(super) fn pay(&mut self, bytes: u64) {
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
}
