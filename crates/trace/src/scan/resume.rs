//! Where whole records go on after damage.

use std::io::{self, Read, Seek};

use mcap::records::op;

use super::frame::{Frame, HEAD, Shape};
use super::{MAGIC, Scan};

/// Bytes looked at together.
const BLOCK: u64 = 64 << 10;

impl<R: Read + Seek> Scan<R> {
    /// The next place from `at` on where a whole record begins; the end of the file where there is
    /// none, or where the search costs too much.
    pub(super) fn resume(&mut self, mut at: u64) -> io::Result<u64> {
        let len = self.source.len();
        while at + HEAD <= len {
            let block = self.source.bytes(at, BLOCK + HEAD - 1)?;
            for window in block.windows(HEAD as usize) {
                let [opcode, length @ ..] = window else {
                    break;
                };
                let length = <[u8; 8]>::try_from(length).map_or(u64::MAX, u64::from_le_bytes);
                let known = (op::HEADER..=op::DATA_END).contains(opcode);
                if known && length <= len - at - HEAD {
                    let frame = Frame {
                        at,
                        opcode: *opcode,
                        len: length,
                    };
                    if self.begins(&frame)? {
                        return Ok(at);
                    }
                    if self.budget == 0 {
                        let told = "it is too damaged to look for whole records in all of it";
                        self.notes.push(told.to_owned());
                        return Ok(len);
                    }
                }
                at += 1;
            }
        }
        Ok(len)
    }

    /// Whether a whole record begins here, by a checksum or by its shape and what follows.
    fn begins(&mut self, frame: &Frame) -> io::Result<bool> {
        let shape = self.source.shape(frame)?;
        self.pay(HEAD);
        Ok(match (frame.opcode, shape) {
            (op::CHUNK, Shape::Exact | Shape::Loose) => self.chunk_is_whole(frame)?,
            (op::ATTACHMENT, Shape::Exact) => match self.attachment(frame)? {
                Some(whole) => whole,
                None => self.source.is_chain(frame.end())?,
            },
            (op::FOOTER, Shape::Exact) => {
                let end = frame.end();
                end + MAGIC == self.source.len() && self.source.is_magic(end)?
            }
            (op::MESSAGE, Shape::Exact | Shape::Loose) => self.source.is_chain(frame.end())?,
            (_, Shape::Exact) => self.source.is_chain(frame.end())?,
            _ => false,
        })
    }

    fn chunk_is_whole(&mut self, frame: &Frame) -> io::Result<bool> {
        let Ok(chunk) = self.source.chunk(frame) else {
            return Ok(false);
        };
        let whole = self.source.walk(&chunk, |_| Ok(())).is_ok();
        if !whole {
            self.pay(chunk.cost());
        }
        // One without a checksum may be empty by accident.
        Ok(whole && (chunk.has_checksum() || self.source.is_chain(frame.end())?))
    }
}
