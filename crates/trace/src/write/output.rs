//! The file that a trace is written to.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use mcap::{Compression, WriteOptions, Writer};

use crate::TraceError;

/// No chunk grows beyond this; one is closed each second in any case.
const CHUNK_BYTES: u64 = 256 * 1024;
/// Made once: it counts processors, which is as much work as a hundred steps' records. LZ4 makes
/// files a third larger than zstd at its fastest, for two fifths of the processor time.
pub(crate) static OPTIONS: LazyLock<WriteOptions> = LazyLock::new(|| {
    WriteOptions::new()
        .library(concat!("formica/", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(CHUNK_BYTES))
        .compression(Some(Compression::Lz4))
});

/// A file of mcap that is being written, renamed once it is whole.
pub(super) struct Output {
    /// Where it goes, and what it is called until then.
    pub(super) path: PathBuf,
    part: PathBuf,
    /// None once it is finished or given up.
    writer: Option<Writer<BufWriter<File>>>,
}

impl Output {
    pub(super) fn create(path: &Path, part: PathBuf) -> Result<Self, TraceError> {
        let io = |source| TraceError::Io {
            path: path.display().to_string(),
            source,
        };
        let file = BufWriter::new(File::create(&part).map_err(io)?);
        let writer = OPTIONS.clone().create(file);
        let writer = writer.map_err(|error| refused(path, &error))?;
        Ok(Self {
            path: path.to_path_buf(),
            part,
            writer: Some(writer),
        })
    }

    /// One failure is the last: what follows would be a trace with a hole.
    pub(super) fn with<T>(
        &mut self,
        work: impl FnOnce(&mut Writer<BufWriter<File>>) -> mcap::McapResult<T>,
    ) -> Result<T, TraceError> {
        let Some(writer) = &mut self.writer else {
            return Err(self.given_up());
        };
        work(writer).map_err(|error| {
            self.writer = None;
            refused(&self.path, &error)
        })
    }

    /// Puts the file in its place, whole. It is not synced, which costs more than all else: a power
    /// loss may take the newest traces along, a killed process does not.
    pub(super) fn finish(mut self) -> Result<PathBuf, TraceError> {
        self.with(|writer| writer.finish().map(drop))?;
        let Some(writer) = self.writer.take() else {
            return Err(self.given_up());
        };
        let io = |source| TraceError::Io {
            path: self.path.display().to_string(),
            source,
        };
        let written = writer.into_inner().into_inner();
        written.map_err(|error| io(error.into_error()))?;
        fs::rename(&self.part, &self.path).map_err(io)?;
        Ok(self.path)
    }

    pub(super) fn discard(mut self) {
        self.writer = None;
        let _ = fs::remove_file(&self.part);
    }

    fn given_up(&self) -> TraceError {
        refused(
            &self.path,
            &"the trace was given up after an error; free some disk space",
        )
    }
}

pub(super) fn refused(path: &Path, reason: &dyn ToString) -> TraceError {
    TraceError::Mcap {
        path: path.display().to_string(),
        reason: reason.to_string(),
    }
}
