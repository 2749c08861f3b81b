//! Makes what is whole of a trace that was cut off into a trace.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata, Record};
use mcap::{Attachment, Writer};

use crate::read::{Stop, scan};
use crate::write::Output;
use crate::{METADATA, OUTCOME, TraceError, read};

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// Where it is.
    pub path: PathBuf,
    /// Control steps.
    pub steps: usize,
    /// Why the file ended there; none where it was whole.
    pub cut: Option<String>,
}

/// Copies what is whole of a trace to `to`, with index and statistics as any tool wants them, and
/// reads it again to see that it is.
///
/// # Errors
/// What the system refuses, and a file of which nothing is whole: its first chunk says how the
/// episode starts.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, TraceError> {
    let before = read(from)?;
    if before.start.is_none() {
        return Err(TraceError::Mcap {
            path: from.display().to_string(),
            reason: "it was cut off before its first chunk was whole".to_owned(),
        });
    }
    let mut part = OsString::from(to.as_os_str());
    // Never the file that is read: X.mcap.part may well go to X.mcap.
    part.push(".recovering");
    let mut output = Output::create(to, PathBuf::from(part))?;
    let mut copy = Copy::default();
    let mut failed = None;
    let copied = scan(from, |record| {
        output
            .with(|writer| copy.take(writer, record))
            .map_err(|error| {
                let told = error.to_string();
                failed = Some(error);
                told
            })
    });
    match (copied, failed) {
        (_, Some(error)) | (Err(Stop::Error(error)), None) => {
            output.discard();
            return Err(error);
        }
        (Ok(()) | Err(Stop::Cut(_)), None) => {}
    }
    if before.outcome.is_none() {
        let steps = before.steps.len().to_string();
        let record = [("outcome", "cut off".to_owned()), ("steps", steps)];
        let record = record.map(|(key, value)| (key.to_owned(), value));
        output.with(|writer| {
            writer.write_metadata(&Metadata {
                name: OUTCOME.to_owned(),
                metadata: record.into(),
            })
        })?;
    }
    let path = output.finish()?;
    let after = read(&path)?;
    if after.cut.is_some() || after.messages != before.messages {
        let reason = after
            .cut
            .unwrap_or_else(|| "messages are missing".to_owned());
        return Err(TraceError::Mcap {
            path: path.display().to_string(),
            reason: format!("what was recovered does not read back: {reason}"),
        });
    }
    Ok(Recovered {
        path,
        steps: after.steps.len(),
        cut: before.cut,
    })
}

/// Ids in the new file of schemas and channels of the old one.
#[derive(Default)]
struct Copy {
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    /// A file that was whole has its schemas and channels again in its summary.
    over: bool,
}

impl Copy {
    fn take<W: std::io::Write + std::io::Seek>(
        &mut self,
        writer: &mut Writer<W>,
        record: Record<'_>,
    ) -> mcap::McapResult<()> {
        match record {
            Record::DataEnd(_) => self.over = true,
            _ if self.over => {}
            Record::Schema { header, data } => {
                let id = writer.add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                let id = writer.add_channel(schema, topic, encoding, &channel.metadata)?;
                self.channels.insert(channel.id, id);
            }
            Record::Message { header, data } => {
                if let Some(channel_id) = self.channels.get(&header.channel_id).copied() {
                    let header = MessageHeader {
                        channel_id,
                        ..header
                    };
                    writer.write_to_known_channel(&header, &data)?;
                }
            }
            Record::Metadata(metadata) if [METADATA, OUTCOME].contains(&&*metadata.name) => {
                writer.write_metadata(&metadata)?;
            }
            Record::Attachment { header, data, .. } => writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            _ => {}
        }
        Ok(())
    }
}
