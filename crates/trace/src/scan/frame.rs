//! The frames of records, an opcode and a length, and whether what stands in one has the shape of
//! its kind.

use std::io::{self, Read, Seek};

use mcap::MAGIC;
use mcap::records::op;

use super::source::Source;

/// Bytes of opcode and length.
pub(crate) const HEAD: u64 = 9;
/// Bytes of a message before its data.
pub(crate) const MESSAGE_HEAD: u64 = 22;

/// Records of kinds that the format does not know, in a row, that are looked behind.
const UNKNOWN: usize = 1000;
/// Records in a row that are no accident.
const CHAIN: usize = 3;

/// A record that ends within the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Frame {
    /// Its first byte.
    pub(crate) at: u64,
    pub(crate) opcode: u8,
    /// Bytes after the head.
    pub(crate) len: u64,
}

impl Frame {
    pub(crate) fn body(&self) -> u64 {
        self.at + HEAD
    }

    pub(crate) fn end(&self) -> u64 {
        self.at + HEAD + self.len
    }

    /// What the kind is called.
    pub(crate) fn name(&self) -> &'static str {
        match self.opcode {
            op::HEADER => "header",
            op::FOOTER => "footer",
            op::SCHEMA => "schema",
            op::CHANNEL => "channel",
            op::MESSAGE => "message",
            op::CHUNK => "chunk",
            op::ATTACHMENT => "attachment",
            op::METADATA => "metadata record",
            op::DATA_END => "end of the data section",
            op::MESSAGE_INDEX..=op::SUMMARY_OFFSET => "index record",
            _ => "record",
        }
    }
}

/// A part of a record: so many bytes, or a count and as many bytes as it says.
#[derive(Clone, Copy)]
enum Part {
    Fixed(u64),
    Counted32,
    Counted64,
}

/// The parts of a kind of record; none of a kind that the format does not know. What follows them
/// is data in a message, and fields of later versions elsewhere.
fn parts(opcode: u8) -> Option<&'static [Part]> {
    use Part::{Counted32, Counted64, Fixed};
    Some(match opcode {
        op::HEADER | op::METADATA => &[Counted32, Counted32],
        op::FOOTER => &[Fixed(20)],
        op::SCHEMA => &[Fixed(2), Counted32, Counted32, Counted32],
        op::CHANNEL => &[Fixed(4), Counted32, Counted32, Counted32],
        op::MESSAGE => &[Fixed(MESSAGE_HEAD)],
        op::CHUNK => &[Fixed(28), Counted32, Counted64],
        op::MESSAGE_INDEX => &[Fixed(2), Counted32],
        op::CHUNK_INDEX => &[Fixed(32), Counted32, Fixed(8), Counted32, Fixed(16)],
        op::ATTACHMENT => &[Fixed(16), Counted32, Counted32, Counted64, Fixed(4)],
        op::ATTACHMENT_INDEX => &[Fixed(40), Counted32, Counted32],
        op::STATISTICS => &[Fixed(42), Counted32],
        op::METADATA_INDEX => &[Fixed(16), Counted32],
        op::SUMMARY_OFFSET => &[Fixed(17)],
        op::DATA_END => &[Fixed(4)],
        _ => return None,
    })
}

/// How the parts of a record fill its frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// To the last byte.
    Exact,
    /// With bytes left: data, or fields of a later version of the format.
    Loose,
    /// A kind of record that the format does not know.
    Unknown,
    /// Not at all.
    Broken,
}

impl<R: Read + Seek> Source<R> {
    /// The frame at `at`; none where none begins there that ends within the file.
    pub(crate) fn frame(&mut self, at: u64) -> io::Result<Option<Frame>> {
        let Some([opcode, len @ ..]) = self.array::<{ HEAD as usize }>(at)? else {
            return Ok(None);
        };
        let len = u64::from_le_bytes(len);
        let fits = len <= self.len() - at - HEAD;
        Ok(fits.then_some(Frame { at, opcode, len }))
    }

    pub(crate) fn shape(&mut self, frame: &Frame) -> io::Result<Shape> {
        let Some(parts) = parts(frame.opcode) else {
            let reserved = frame.opcode == 0;
            return Ok(if reserved {
                Shape::Broken
            } else {
                Shape::Unknown
            });
        };
        let mut at = frame.body();
        for part in parts {
            let count = match part {
                Part::Fixed(bytes) => Some(*bytes),
                Part::Counted32 => self
                    .array(at)?
                    .map(|c| 4 + u64::from(u32::from_le_bytes(c))),
                Part::Counted64 => self.array(at)?.map(u64::from_le_bytes),
            };
            let counted = matches!(part, Part::Counted64);
            let next = count.and_then(|count| at.checked_add(count));
            let next = next.and_then(|next| next.checked_add(if counted { 8 } else { 0 }));
            match next.filter(|next| *next <= frame.end()) {
                Some(next) => at = next,
                None => return Ok(Shape::Broken),
            }
        }
        let exact = at == frame.end();
        Ok(if exact { Shape::Exact } else { Shape::Loose })
    }

    /// Whether a record follows at `at`, or the end of the file: what to expect where all was well
    /// before. Kinds that the format does not know may stand between.
    pub(crate) fn follows(&mut self, mut at: u64) -> io::Result<bool> {
        for _ in 0..UNKNOWN {
            if at == self.len() || self.is_magic(at)? {
                return Ok(true);
            }
            let Some(frame) = self.frame(at)? else {
                return Ok(false);
            };
            match self.shape(&frame)? {
                Shape::Broken => return Ok(false),
                Shape::Exact | Shape::Loose => return Ok(true),
                Shape::Unknown => at = frame.end(),
            }
        }
        Ok(false)
    }

    /// Whether records begin at `at`, after damage: so many in a row, of kinds that the format knows
    /// and of exactly their shape, that it is no accident. Files are full of small numbers with seven
    /// zeros behind, which look like frames.
    pub(crate) fn is_chain(&mut self, mut at: u64) -> io::Result<bool> {
        for _ in 0..CHAIN {
            if at == self.len() || self.is_magic(at)? && at + 8 == self.len() {
                return Ok(true);
            }
            let Some(frame) = self.frame(at)? else {
                return Ok(false);
            };
            match (frame.opcode, self.shape(&frame)?) {
                (op::MESSAGE, Shape::Exact | Shape::Loose) | (_, Shape::Exact) => {}
                // After the compressed records there may be padding.
                (op::CHUNK, Shape::Loose) => {}
                _ => return Ok(false),
            }
            at = frame.end();
        }
        Ok(true)
    }

    /// Whether the bytes that begin and end a file stand at `at`.
    pub(crate) fn is_magic(&mut self, at: u64) -> io::Result<bool> {
        Ok(self
            .array(at)?
            .is_some_and(|bytes: [u8; 8]| bytes == *MAGIC))
    }
}
