//! Writes npz files that OGBench's package opens.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use durable::{Existing, Output, Staged};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::npy;
use crate::error::io_error;
use crate::{Dataset, DatasetError, Element};

/// Deflate level: higher ones take long and save little.
const LEVEL: i64 = 1;

/// Values that are encoded at a time.
const BLOCK: usize = 1 << 14;

/// Writes a file in OGBench's layout to a path where nothing is: it is whole, or nothing. Rewards,
/// terminals and goals have no place in it. `qpos` holds x and y of images; `qpos` and `qvel` are left
/// out where an observation is not known to be positions and velocities.
///
/// # Errors
/// Something at `path`, and what the system or the format refuses.
pub fn write(path: &Path, data: &Dataset) -> Result<(), DatasetError> {
    let output = Output::file(path, Existing::Refuse, &[])?;
    Ok(stage(&output, data)?.place()?)
}

/// [`write()`], up to the point where the file is put in its place.
pub(crate) fn stage(output: &Output, data: &Dataset) -> Result<Staged, DatasetError> {
    let path = output.path();
    let n = data.len();
    let ends = data.episodes.iter().map(|episode| episode.end - 1);
    let mut terminals = vec![0; n];
    ends.for_each(|row| terminals[row] = 1);
    let shape = data.shape();
    let [observation, action] = [shape.observation(), shape.action()];
    let states = || data.observations.chunks_exact(observation.max(1));
    let part = |from: usize, to: usize| states().flat_map(move |state| &state[from..to]).copied();
    output.stage(|file| {
        let mut archive = Archive {
            path,
            zip: ZipWriter::new(Sink {
                file,
                failed: false,
                position: 0,
            }),
        };
        let floats = data.observations.iter().copied();
        match shape.element() {
            Element::F32 => archive.floats("observations", &[n, observation], floats)?,
            Element::U8 => {
                let sides = [&[n], shape.sides()].concat();
                archive.start("observations", "|u1", &sides, 1)?;
                archive.bytes(&data.images)?;
            }
        }
        archive.floats("actions", &[n, action], data.actions.iter().copied())?;
        archive.start("terminals", "|b1", &[n], 1)?;
        archive.bytes(&terminals)?;
        if let Some(positions) = shape.positions() {
            let velocities = observation - positions;
            archive.floats("qpos", &[n, positions], part(0, positions))?;
            archive.floats("qvel", &[n, velocities], part(positions, observation))?;
        }
        if shape.element() == Element::U8 {
            let places = data.image_places.as_flattened().iter().copied();
            archive.floats("qpos", &[n, 2], places)?;
        }
        archive.zip.finish().map_err(|error| refused(path, error))?;
        Ok(())
    })
}

/// Where OGBench looks for the validation data of a training file: `X-val.npz` for `X.npz`.
#[must_use]
pub fn validation_path(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push("-val.npz");
    path.with_file_name(name)
}

fn refused(path: &Path, error: zip::result::ZipError) -> DatasetError {
    match error {
        zip::result::ZipError::Io(source) => io_error(path, source),
        error => DatasetError::Format {
            path: path.to_path_buf(),
            reason: format!("cannot be written: {error}"),
        },
    }
}

/// A file that takes anything once it has failed: [`ZipWriter`] writes on when it is dropped, and
/// would tell standard error that this fails as well.
struct Sink<'a> {
    file: &'a mut BufWriter<File>,
    failed: bool,
    /// Where the next byte goes.
    position: u64,
}

impl Sink<'_> {
    fn noted<T>(&mut self, result: io::Result<T>) -> io::Result<T> {
        self.failed |= result.is_err();
        result
    }
}

impl Write for Sink<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = if self.failed {
            bytes.len()
        } else {
            let taken = self.file.write(bytes);
            self.noted(taken)?
        };
        self.position += taken as u64;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.failed {
            return Ok(());
        }
        let flushed = self.file.flush();
        self.noted(flushed)
    }
}

impl Seek for Sink<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.position = match (self.failed, to) {
            (true, SeekFrom::Start(position)) => position,
            (true, SeekFrom::Current(by) | SeekFrom::End(by)) => {
                self.position.saturating_add_signed(by)
            }
            (false, to) => {
                let sought = self.file.seek(to);
                self.noted(sought)?
            }
        };
        Ok(self.position)
    }
}

/// An archive that is being written.
struct Archive<'a> {
    path: &'a Path,
    zip: ZipWriter<Sink<'a>>,
}

impl Archive<'_> {
    /// Begins an array.
    fn start(
        &mut self,
        name: &str,
        descr: &str,
        shape: &[usize],
        size: usize,
    ) -> Result<(), DatasetError> {
        let bytes = shape.iter().product::<usize>() * size;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(LEVEL))
            // Deflate can add to what does not shrink.
            .large_file(bytes > u32::MAX as usize / 2);
        self.zip
            .start_file(format!("{name}.npy"), options)
            .map_err(|error| refused(self.path, error))?;
        self.bytes(&npy::written(descr, shape))
    }

    fn bytes(&mut self, bytes: &[u8]) -> Result<(), DatasetError> {
        self.zip
            .write_all(bytes)
            .map_err(|error| io_error(self.path, error))
    }

    /// A whole array of f32 values.
    fn floats(
        &mut self,
        name: &str,
        shape: &[usize],
        mut values: impl Iterator<Item = f32>,
    ) -> Result<(), DatasetError> {
        self.start(name, "<f4", shape, size_of::<f32>())?;
        let mut block = Vec::with_capacity(BLOCK * size_of::<f32>());
        loop {
            block.clear();
            block.extend(values.by_ref().take(BLOCK).flat_map(f32::to_le_bytes));
            if block.is_empty() {
                return Ok(());
            }
            self.bytes(&block)?;
        }
    }
}
