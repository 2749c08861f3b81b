//! Random access to bytes whose number is known: nothing is allocated for bytes that are not there.

use std::io::{self, BufReader, Read, Seek, SeekFrom, Take};

/// A file, or bytes in memory.
pub(crate) struct Source<R> {
    inner: BufReader<R>,
    len: u64,
}

impl<R: Read + Seek> Source<R> {
    pub(crate) fn new(mut inner: R) -> io::Result<Self> {
        let len = inner.seek(SeekFrom::End(0))?;
        let inner = BufReader::with_capacity(64 << 10, inner);
        Ok(Self { inner, len })
    }

    /// Bytes in all.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// The bytes from `at`, at most `len`.
    pub(crate) fn section(&mut self, at: u64, len: u64) -> io::Result<Take<&mut BufReader<R>>> {
        let now = self.inner.stream_position()?;
        match i64::try_from(i128::from(at) - i128::from(now)) {
            // What is in the buffer stays there.
            Ok(offset) => self.inner.seek_relative(offset)?,
            Err(_) => drop(self.inner.seek(SeekFrom::Start(at))?),
        }
        Ok(Read::take(
            &mut self.inner,
            len.min(self.len.saturating_sub(at)),
        ))
    }

    /// `N` bytes from `at`; none where there are fewer.
    pub(crate) fn array<const N: usize>(&mut self, at: u64) -> io::Result<Option<[u8; N]>> {
        let there = at.checked_add(N as u64).is_some_and(|end| end <= self.len);
        if !there {
            return Ok(None);
        }
        let mut bytes = [0; N];
        self.section(at, N as u64)?.read_exact(&mut bytes)?;
        Ok(Some(bytes))
    }

    /// All bytes from `at` to `at + len`, or as many of them as there are.
    pub(crate) fn bytes(&mut self, at: u64, len: u64) -> io::Result<Vec<u8>> {
        let mut bytes = vec![];
        self.section(at, len)?.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// The checksum of `from..to`.
    pub(crate) fn checksum(&mut self, from: u64, to: u64) -> io::Result<u32> {
        let mut hasher = crc32fast::Hasher::new();
        let mut section = self.section(from, to.saturating_sub(from))?;
        let mut buffer = [0; 16 << 10];
        loop {
            match section.read(&mut buffer)? {
                0 => return Ok(hasher.finalize()),
                read => hasher.update(&buffer[..read]),
            }
        }
    }
}
