//! What a chunk holds, decompressed as a stream: memory is taken for a record that is wanted, never
//! for a chunk.

use std::io::{self, Read, Seek};

use mcap::records::op;

use super::frame::{Frame, HEAD, MESSAGE_HEAD};
use super::source::Source;

/// Bound on what a chunk comes to when it is decompressed (bytes).
const MOST: u64 = 1 << 30;
/// Bound on the name of a compression (bytes).
const NAME: u64 = 64;

/// A chunk's head.
#[derive(Debug)]
pub(crate) struct Chunk {
    /// Its first byte in the file.
    at: u64,
    /// Where its compressed records are, and how many bytes.
    data: u64,
    compressed: u64,
    uncompressed: u64,
    /// 0 for none.
    crc: u32,
    compression: String,
}

impl Chunk {
    /// Whether it has no record at all, which is what zeros in its place look like.
    pub(crate) fn is_empty(&self) -> bool {
        self.crc == 0 && self.compressed == 0
    }

    pub(crate) fn has_checksum(&self) -> bool {
        self.crc != 0
    }

    /// Bytes to look through.
    pub(crate) fn cost(&self) -> u64 {
        self.compressed.saturating_add(self.uncompressed.min(MOST))
    }
}

/// A record within a chunk, of which nothing has been read yet.
pub(crate) struct Inner<'a> {
    pub(crate) opcode: u8,
    pub(crate) len: u64,
    body: &'a mut dyn Read,
}

impl Inner<'_> {
    /// The next `len` bytes of it.
    pub(crate) fn bytes(&mut self, len: u64) -> io::Result<Vec<u8>> {
        let mut bytes = vec![];
        self.body.take(len).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < len {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(bytes)
    }
}

/// A reader that adds up what it has read.
struct Summed<R> {
    inner: R,
    hasher: crc32fast::Hasher,
    read: u64,
}

impl<R: Read> Read for Summed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..read]);
        self.read += read as u64;
        Ok(read)
    }
}

impl<R: Read + Seek> Source<R> {
    /// The head of the chunk in a frame whose shape was looked at.
    pub(crate) fn chunk(&mut self, frame: &Frame) -> Result<Chunk, String> {
        let told = |told: &str| format!("the chunk at byte {} {told}", frame.at);
        let unread = |error: io::Error| told(&format!("cannot be read: {error}"));
        let at = frame.body() + 16;
        let head: [u8; 16] = (self.array(at).map_err(unread)?).ok_or(told("does not end"))?;
        let [
            u0,
            u1,
            u2,
            u3,
            u4,
            u5,
            u6,
            u7,
            c0,
            c1,
            c2,
            c3,
            n0,
            n1,
            n2,
            n3,
        ] = head;
        let name = u64::from(u32::from_le_bytes([n0, n1, n2, n3]));
        if name > NAME {
            return Err(told("has no sound head"));
        }
        let compression = self.bytes(at + 16, name).map_err(unread)?;
        let compression = String::from_utf8(compression);
        let size = self.array(at + 16 + name).map_err(unread)?;
        let compressed = size.map(u64::from_le_bytes).ok_or(told("does not end"))?;
        let data = at + 24 + name;
        if data > frame.end() || compressed > frame.end() - data {
            return Err(told("has no sound head"));
        }
        Ok(Chunk {
            at: frame.at,
            data,
            compressed,
            uncompressed: u64::from_le_bytes([u0, u1, u2, u3, u4, u5, u6, u7]),
            crc: u32::from_le_bytes([c0, c1, c2, c3]),
            compression: compression.map_err(|_| told("has no sound head"))?,
        })
    }

    /// Calls `visit` with each record of a chunk, and looks whether its checksum holds in the end.
    ///
    /// # Errors
    /// Why the chunk is not whole; what was visited is then not to be believed.
    pub(crate) fn walk(
        &mut self,
        chunk: &Chunk,
        mut visit: impl FnMut(Inner<'_>) -> io::Result<()>,
    ) -> Result<(), String> {
        let told = |told: &str| format!("the chunk at byte {} {told}", chunk.at);
        let unread = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => told("holds less than it says"),
            _ if chunk.compression.is_empty() => told(&format!("cannot be read: {error}")),
            _ => told(&format!("is damaged: it cannot be decompressed ({error})")),
        };
        let size = chunk.uncompressed;
        if size > MOST {
            return Err(told(&format!(
                "would take {size} bytes decompressed, and formica reads no chunk over {MOST}"
            )));
        }
        let data = self.section(chunk.data, chunk.compressed).map_err(unread)?;
        let records: Box<dyn Read + '_> = match &*chunk.compression {
            "" | "none" => Box::new(data),
            "lz4" => Box::new(lz4::Decoder::new(data).map_err(unread)?),
            "zstd" => Box::new(zstd::stream::read::Decoder::with_buffer(data).map_err(unread)?),
            other => {
                return Err(told(&format!(
                    "is compressed with '{}', and formica reads lz4, zstd and none; compress it \
                     anew with one of these, as `mcap compress` does",
                    other.escape_debug()
                )));
            }
        };
        let mut records = Summed {
            inner: records,
            hasher: crc32fast::Hasher::new(),
            read: 0,
        };
        while records.read < size {
            let mut head = [0; HEAD as usize];
            records.read_exact(&mut head).map_err(unread)?;
            let [opcode, len @ ..] = head;
            let len = u64::from_le_bytes(len);
            let short = opcode == op::MESSAGE && len < MESSAGE_HEAD;
            if short || opcode == 0 || len > size.saturating_sub(records.read) {
                return Err(told("holds a record that does not end"));
            }
            let end = records.read + len;
            let mut body = (&mut records).take(len);
            let body: &mut dyn Read = &mut body;
            visit(Inner { opcode, len, body }).map_err(unread)?;
            let rest = end.saturating_sub(records.read);
            io::copy(&mut (&mut records).take(rest), &mut io::sink()).map_err(unread)?;
            if records.read < end {
                return Err(told("holds less than it says"));
            }
        }
        let more = records.inner.read(&mut [0]).map_err(unread)?;
        if more > 0 || records.read > size {
            return Err(told("holds more than it says"));
        }
        let crc = records.hasher.finalize();
        match chunk.crc {
            // None was made of it.
            0 => Ok(()),
            saved if saved == crc => Ok(()),
            _ => Err(told("is damaged: its checksum does not hold")),
        }
    }
}
