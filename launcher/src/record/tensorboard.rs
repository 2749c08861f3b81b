//! Event files of TensorBoard: every metric as a scalar.
//!
//! A file is a sequence of records: length, its masked checksum, the event, its masked checksum.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use prost::Message;

/// The first event of a file.
const VERSION: &str = "brain.Event:2";

/// `tensorflow.Event` of event.proto, with the fields for scalars.
#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

/// `tensorflow.Summary` of summary.proto.
#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Value>,
}

/// `tensorflow.Summary.Value`.
#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

/// An event file.
pub(crate) struct EventFile(BufWriter<File>);

impl EventFile {
    /// Creates a file in a folder, which is created if it is missing. TensorBoard reads all files of a folder as
    /// one.
    pub(crate) fn create(folder: &Path) -> io::Result<Self> {
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
        let name = rustix::system::uname();
        let host: String = name
            .nodename()
            .to_string_lossy()
            .chars()
            .map(|c| if c.is_alphanumeric() { c } else { '-' })
            .collect();
        let now = unix_seconds();
        // After a resume within the same second the name exists.
        let mut seconds = now as u64;
        let file = loop {
            let path = folder.join(format!("events.out.tfevents.{seconds}.{host}"));
            let opened = OpenOptions::new()
                .write(true)
                .create_new(true)
                .mode(0o600)
                .open(path);
            match opened {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => seconds += 1,
                other => break other?,
            }
        };
        let mut events = Self(BufWriter::new(file));
        events.write(&Event {
            wall_time: now,
            file_version: Some(VERSION.to_owned()),
            ..Event::default()
        })?;
        Ok(events)
    }

    /// Adds a scalar, in single precision as the format requires.
    pub(crate) fn scalar(&mut self, tag: String, step: u64, value: f64) -> io::Result<()> {
        self.write(&Event {
            wall_time: unix_seconds(),
            step: i64::try_from(step).unwrap_or(i64::MAX),
            summary: Some(Summary {
                value: vec![Value {
                    tag,
                    simple_value: Some(value as f32),
                }],
            }),
            ..Event::default()
        })
    }

    fn write(&mut self, event: &Event) -> io::Result<()> {
        self.0.write_all(&record(&event.encode_to_vec()))
    }

    pub(crate) fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

fn unix_seconds() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.unwrap_or_default().as_secs_f64()
}

/// A record: bytes with length and checksums.
fn record(bytes: &[u8]) -> Vec<u8> {
    let length = (bytes.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(bytes.len() + 16);
    record.extend_from_slice(&length);
    record.extend_from_slice(&masked(&length).to_le_bytes());
    record.extend_from_slice(bytes);
    record.extend_from_slice(&masked(bytes).to_le_bytes());
    record
}

/// CRC-32C, masked as the format requires.
fn masked(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes)
        .rotate_right(15)
        .wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The events of a file, with all checksums verified.
    fn events(mut bytes: &[u8]) -> Vec<Event> {
        let mut events = vec![];
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_at(8);
            let (sum, rest) = rest.split_at(4);
            assert_eq!(masked(length).to_le_bytes(), sum);
            let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
            let (event, rest) = rest.split_at(length);
            let (sum, rest) = rest.split_at(4);
            assert_eq!(masked(event).to_le_bytes(), sum);
            events.push(Event::decode(event).unwrap());
            bytes = rest;
        }
        events
    }

    #[test]
    fn a_file_says_its_version_and_gives_every_scalar_back() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("tensorboard");
        for _ in 0..2 {
            let mut file = EventFile::create(&folder).unwrap();
            file.scalar("low/policy_loss".to_owned(), 7, 0.25).unwrap();
            file.scalar("x".to_owned(), u64::MAX, f64::MAX).unwrap();
            file.flush().unwrap();
        }
        let files: Vec<_> = std::fs::read_dir(&folder).unwrap().flatten().collect();
        assert_eq!(files.len(), 2, "none is written over");
        for file in files {
            let name = file.file_name().into_string().unwrap();
            assert!(name.starts_with("events.out.tfevents.1"), "{name}");
            let events = events(&std::fs::read(file.path()).unwrap());
            assert_eq!(events[0].file_version.as_deref(), Some(VERSION));
            assert!((unix_seconds() - events[1].wall_time).abs() < 3600.0);
            let scalars: Vec<_> = events[1..]
                .iter()
                .map(|event| {
                    let value = &event.summary.as_ref().unwrap().value[0];
                    (value.tag.as_str(), event.step, value.simple_value)
                })
                .collect();
            let expected = [
                ("low/policy_loss", 7, Some(0.25)),
                ("x", i64::MAX, Some(f32::INFINITY)),
            ];
            assert_eq!(scalars, expected);
        }
    }

    #[test]
    fn checksums_are_those_of_the_format() {
        // RFC 3720, B.4: 32 bytes of zeroes.
        assert_eq!(crc32c::crc32c(&[0; 32]), 0x8a91_36aa);
        // Rotated right by 15 bits, plus a constant.
        assert_eq!(masked(&[0; 32]), 0x0fd7_fffa);
        // Length and checksum of a record of 24 bytes, with which TensorBoard's own writer starts each file
        // (`brain.Event:2` and a time).
        assert_eq!(
            record(&[0; 24])[..12],
            [24, 0, 0, 0, 0, 0, 0, 0, 0xa3, 0x7f, 0x4b, 0x22]
        );
    }
}
