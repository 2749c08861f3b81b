//! Makes what is whole of a trace that is cut off or damaged into a trace.

use std::collections::BTreeMap;
use std::io::{Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};

use durable::{Existing, Output};
use mcap::records::{MessageHeader, Metadata, Record, op};
use mcap::{Attachment, Writer};

use crate::read::{damaged, open, read_scan, refused};
use crate::scan::{Scan, Stop, Visit};
use crate::write::OPTIONS;
use crate::{Lost, METADATA, OUTCOME, RECOVERED, Trace, TraceError};

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// Where it is.
    pub path: PathBuf,
    /// Control steps.
    pub steps: usize,
    /// Messages of each topic that were kept.
    pub messages: BTreeMap<String, u64>,
    /// Why the file is cut off; none where it ends as it should.
    pub cut: Option<String>,
    /// Bytes of it that are lost, those after the last whole record included.
    pub lost: Vec<Lost>,
    /// What else is wrong with it, a sentence each.
    pub damage: Vec<String>,
}

impl Recovered {
    /// Whether the file was whole.
    #[must_use]
    pub fn was_whole(&self) -> bool {
        self.cut.is_none() && self.lost.is_empty() && self.damage.is_empty()
    }
}

/// Copies what is whole of a trace to `to`, before damage and after it, with index and statistics as
/// any tool wants them, and reads it again to see that nothing is missing. Until then it has no name
/// in the folder but a temporary one, and where anything fails nothing is left.
///
/// # Errors
/// What the system refuses, a file of which no message is whole ([`TraceError::Nothing`]), and a
/// target that is not to be written to ([`TraceError::Output`]): the damaged file itself, and what is
/// there already unless it is to be replaced.
pub fn recover(from: &Path, to: &Path, existing: Existing) -> Result<Recovered, TraceError> {
    let file = open(from)?;
    let output = Output::file(to, existing, &[from])?;
    let io = |error| refused(to, error);
    if let Some(folder) = to.parent().filter(|folder| *folder != Path::new("")) {
        // A folder that is misspelled is not made.
        std::fs::metadata(folder).map_err(io)?;
    }
    let mut scan = Scan::of(file).map_err(|error| refused(from, error))?;
    let mut recovered = None;
    let staged = output.stage::<TraceError>(|file| {
        let before = copy(from, to, &mut scan, &mut *file)?.0;
        file.flush().map_err(io)?;
        let written = file.get_ref().try_clone().map_err(io)?;
        recovered = Some(verified(to, &mut scan, before, written)?);
        Ok(())
    })?;
    staged.place()?;
    recovered.ok_or_else(|| refused(to, std::io::ErrorKind::UnexpectedEof.into()))
}

/// As [`recover`], of a file's bytes; the recovered file's bytes beside.
///
/// # Errors
/// As those of [`recover`].
pub fn recover_bytes(path: &Path, bytes: &[u8]) -> Result<(Recovered, Vec<u8>), TraceError> {
    let mut scan = Scan::of(Cursor::new(bytes)).map_err(|error| refused(path, error))?;
    let (before, copied) = copy(path, path, &mut scan, Cursor::new(vec![]))?;
    let written = copied.into_inner();
    let recovered = verified(path, &mut scan, before, Cursor::new(&written))?;
    Ok((recovered, written))
}

/// Copies, and tells what the file held.
fn copy<R: Read + Seek, W: Write + Seek>(
    from: &Path,
    to: &Path,
    scan: &mut Scan<R>,
    output: W,
) -> Result<(Trace, W), TraceError> {
    let nothing = |reason: String| TraceError::Nothing {
        path: from.display().to_string(),
        reason,
    };
    let beginning = scan.beginning().map_err(|error| refused(from, error))?;
    if let Some(kind) = crate::foreign::kind(&beginning, scan.has_records())
        && !scan.has_records()
    {
        return Err(nothing(kind));
    }
    let before = match read_scan(from, scan) {
        Err(TraceError::Mcap { reason, .. }) => return Err(nothing(reason)),
        before => before?,
    };
    if before.start.is_none() && before.steps.is_empty() {
        let reason = match &before.cut {
            Some(_) => "it was cut off before its first chunk was whole",
            None => "it holds no step of an episode",
        };
        return Err(nothing(reason.to_owned()));
    }
    let mcap = |error: mcap::McapError| damaged(to, error.to_string());
    let mut copy = Copy {
        writer: OPTIONS.clone().create(output).map_err(mcap)?,
        ids: BTreeMap::new(),
    };
    // Also those without a message, as they were.
    for id in scan.channels.keys().copied().collect::<Vec<u16>>() {
        copy.channel(scan, id).map_err(mcap)?;
    }
    match scan.visit(&mut copy) {
        Ok(()) => {}
        Err(Stop::Io(error)) => return Err(refused(from, error)),
        Err(Stop::Visitor(error)) => return Err(mcap(error)),
    }
    for (name, metadata) in added(&before, scan) {
        let name = name.to_owned();
        let record = Metadata { name, metadata };
        copy.writer.write_metadata(&record).map_err(mcap)?;
    }
    copy.writer.finish().map_err(mcap)?;
    Ok((before, copy.writer.into_inner()))
}

/// Metadata records that a recovered trace has beyond those of the damaged one.
fn added<R>(before: &Trace, scan: &Scan<R>) -> Vec<(&'static str, BTreeMap<String, String>)> {
    let record = |entries: &[(&str, &str)]| {
        let entries = entries.iter();
        entries
            .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
            .collect()
    };
    let mut added = vec![];
    if !before.metadata.contains_key("formica") && !before.metadata.contains_key("run") {
        // Without one it would be no trace.
        added.push((
            METADATA,
            record(&[("recovered", "the record of the episode is lost")]),
        ));
    }
    let steps = before.steps.len().to_string();
    match before.outcome {
        _ if before.metadata.contains_key("outcome") => {}
        Some(outcome) => added.push((OUTCOME, outcome.record())),
        None => added.push((
            OUTCOME,
            record(&[("outcome", "cut off"), ("steps", &steps)]),
        )),
    }
    if !before.is_whole() {
        let lost = scan.lost.iter().map(ToString::to_string);
        let rest = before
            .damage
            .iter()
            .filter(|told| !told.starts_with("bytes "))
            .cloned();
        let lost = lost.chain(rest).collect::<Vec<String>>().join("; ");
        added.push((RECOVERED, record(&[("steps", &steps), ("lost", &lost)])));
    }
    added
}

/// Reads what was written, and compares it with what was whole.
fn verified<R: Read + Seek, S: Read + Seek>(
    to: &Path,
    scan: &mut Scan<R>,
    before: Trace,
    written: S,
) -> Result<Recovered, TraceError> {
    let io = |error| refused(to, error);
    let mut again = Scan::of(written).map_err(io)?;
    let after = read_scan(to, &mut again)?;
    let lost = again.lost.iter().map(ToString::to_string);
    let wrong = lost
        .chain(again.notes.clone())
        .chain(again.cut.clone())
        .next();
    let same = sums(scan).map_err(io)? == sums(&mut again).map_err(io)?;
    let wrong = wrong.or_else(|| (!same).then(|| "messages differ".to_owned()));
    if let Some(reason) = wrong {
        let reason = format!("what was recovered does not read back: {reason}; it is not kept");
        return Err(damaged(to, reason));
    }
    let is_not_lost = |told: &String| scan.lost.iter().all(|lost| lost.to_string() != *told);
    Ok(Recovered {
        path: to.to_path_buf(),
        steps: after.steps.len(),
        messages: after.messages,
        cut: before.cut,
        damage: before.damage.into_iter().filter(is_not_lost).collect(),
        lost: scan.lost.clone(),
    })
}

/// Messages of each topic, and a checksum of all of them in whatever order.
type Sums = BTreeMap<String, (u64, u64)>;

fn sums<R: Read + Seek>(scan: &mut Scan<R>) -> std::io::Result<Sums> {
    let topics = scan.channels.iter();
    let mut sum = Sum {
        topics: topics
            .map(|(id, channel)| (*id, channel.topic.clone()))
            .collect(),
        sums: Sums::new(),
    };
    match scan.visit(&mut sum) {
        Ok(()) => Ok(sum.sums),
        Err(Stop::Io(error)) => Err(error),
        Err(Stop::Visitor(never)) => match never {},
    }
}

struct Sum {
    topics: BTreeMap<u16, String>,
    sums: Sums,
}

impl Visit for Sum {
    type Error = std::convert::Infallible;

    fn wants(&self, opcode: u8, channel: u16, _: u64) -> bool {
        opcode == op::MESSAGE && self.topics.contains_key(&channel)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), Self::Error> {
        let Some(topic) = self.topics.get(&header.channel_id) else {
            return Ok(());
        };
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&header.sequence.to_le_bytes());
        hasher.update(&header.log_time.to_le_bytes());
        hasher.update(&header.publish_time.to_le_bytes());
        hasher.update(data);
        let (count, sum) = self.sums.entry(topic.clone()).or_default();
        *count += 1;
        *sum = sum.wrapping_add(hasher.finalize().into());
        Ok(())
    }

    fn record(&mut self, _: Record<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Writes what it is told of.
struct Copy<W: Write + Seek> {
    writer: Writer<W>,
    /// Ids in the new file of channels of the old one.
    ids: BTreeMap<u16, u16>,
}

impl<W: Write + Seek> Copy<W> {
    fn channel<R>(&mut self, scan: &Scan<R>, id: u16) -> mcap::McapResult<()> {
        let Some(channel) = scan.channels.get(&id) else {
            return Ok(());
        };
        let schema = match scan.schemas.get(&channel.schema_id) {
            Some(s) if channel.schema_id != 0 => {
                self.writer.add_schema(&s.name, &s.encoding, &s.data)?
            }
            _ => 0,
        };
        let (topic, encoding) = (&channel.topic, &channel.message_encoding);
        let new = self
            .writer
            .add_channel(schema, topic, encoding, &channel.metadata)?;
        self.ids.insert(id, new);
        Ok(())
    }
}

impl<W: Write + Seek> Visit for Copy<W> {
    type Error = mcap::McapError;

    fn wants(&self, opcode: u8, channel: u16, _: u64) -> bool {
        opcode != op::MESSAGE || self.ids.contains_key(&channel)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> mcap::McapResult<()> {
        let Some(channel_id) = self.ids.get(&header.channel_id).copied() else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id,
            ..*header
        };
        self.writer.write_to_known_channel(&header, data)
    }

    fn record(&mut self, record: Record<'_>) -> mcap::McapResult<()> {
        match record {
            Record::Metadata(metadata) => self.writer.write_metadata(&metadata),
            Record::Attachment { header, data, .. } => self.writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            }),
            _ => Ok(()),
        }
    }
}
