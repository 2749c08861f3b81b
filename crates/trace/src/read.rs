//! Reads traces. No length that a file tells is believed before it is checked, and a file that
//! is cut off or altered is an error, never a panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;

use crate::{EpisodeMeta, METADATA, Outcome, Step, TraceError};

/// Bound on the length of any record or chunk of a trace (bytes).
const MAX_RECORD: usize = 16 << 20;
/// Bound on the number of messages of a trace.
const MAX_MESSAGES: u64 = 10_000_000;

/// A trace at a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The episode's metadata record as it is: outcome, versions, seeds.
    pub metadata: BTreeMap<String, String>,
    /// The same, typed.
    pub meta: EpisodeMeta,
    /// How the episode ended; none when the record does not say.
    pub outcome: Option<Outcome>,
    /// Control steps: messages of `/step`.
    pub steps: u64,
    /// Messages of each topic.
    pub messages: BTreeMap<String, u64>,
    /// Times of the first and last message (ns since 1970).
    pub times: [u64; 2],
}

/// Calls `visit` with each record, those within chunks as well.
fn scan(
    path: &Path,
    mut visit: impl FnMut(Record<'_>) -> Result<(), String>,
) -> Result<(), TraceError> {
    let name = path.display().to_string();
    let io = |source| TraceError::Io {
        path: name.clone(),
        source,
    };
    let damaged = |reason: String| TraceError::Mcap {
        path: name.clone(),
        reason,
    };
    let mut file = File::open(path).map_err(io)?;
    let options = LinearReaderOptions::default()
        .with_check_finishes_after_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(MAX_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| damaged(error.to_string()))? {
            LinearReadEvent::ReadRequest(need) => {
                let read = file.read(reader.insert(need.min(MAX_RECORD))).map_err(io)?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                let record = mcap::parse_record(opcode, data);
                let record = record.map_err(|error| damaged(error.to_string()))?;
                visit(record).map_err(damaged)?;
            }
        }
    }
    Ok(())
}

/// Reads a whole trace and checks it as it goes: checksums, the order of time, and that the
/// metadata tell as many steps as there are.
///
/// # Errors
/// What the system refuses, or any damage.
pub fn summary(path: &Path) -> Result<Summary, TraceError> {
    let mut topics = BTreeMap::new();
    let mut messages = BTreeMap::<String, u64>::new();
    let mut times: Option<[u64; 2]> = None;
    let mut total = 0;
    let mut metadata = None;
    let mut config = String::new();
    scan(path, |record| {
        match record {
            Record::Channel(channel) => {
                topics.insert(channel.id, channel.topic);
            }
            Record::Message { header, .. } => {
                let topic = topics.get(&header.channel_id);
                let topic = topic.ok_or("a message names a channel that does not exist")?;
                let [first, last] = times.unwrap_or([header.log_time; 2]);
                if header.log_time < last {
                    return Err(format!(
                        "time runs backwards on {topic}: {} ns after {last} ns",
                        header.log_time
                    ));
                }
                times = Some([first, header.log_time]);
                total += 1;
                if total > MAX_MESSAGES {
                    return Err(format!("it has more than {MAX_MESSAGES} messages"));
                }
                *messages.entry(topic.clone()).or_default() += 1;
            }
            Record::Metadata(record) if record.name == METADATA => metadata = Some(record.metadata),
            Record::Attachment { header, data, .. } if header.name == "config.toml" => {
                config = String::from_utf8_lossy(&data).into_owned();
            }
            _ => {}
        }
        Ok(())
    })?;
    let damaged = |reason| TraceError::Mcap {
        path: path.display().to_string(),
        reason,
    };
    let metadata = metadata.ok_or_else(|| {
        damaged(format!(
            "it has no record '{METADATA}': not a trace, or of an unfinished episode"
        ))
    })?;
    let steps = messages.get("/step").copied().unwrap_or_default();
    let told = metadata.get("steps").map_or("none", String::as_str);
    if told != steps.to_string() {
        return Err(damaged(format!(
            "its metadata tell {told} steps, but it holds {steps}"
        )));
    }
    Ok(Summary {
        meta: EpisodeMeta::of(&metadata, config),
        outcome: Outcome::of(&metadata),
        metadata,
        steps,
        messages,
        times: times.unwrap_or_default(),
    })
}

/// Every message of `/step`, in order.
///
/// # Errors
/// What the system refuses, or any damage.
pub fn steps(path: &Path) -> Result<Vec<Step>, TraceError> {
    let mut channels = Vec::new();
    let mut steps = Vec::new();
    scan(path, |record| {
        match record {
            Record::Channel(channel) if channel.topic == "/step" => channels.push(channel.id),
            Record::Message { header, data } if channels.contains(&header.channel_id) => {
                if steps.len() as u64 >= MAX_MESSAGES {
                    return Err(format!("it has more than {MAX_MESSAGES} steps"));
                }
                let step = Step::decode(&*data);
                steps.push(step.map_err(|error| format!("step {}: {error}", steps.len()))?);
            }
            _ => {}
        }
        Ok(())
    })?;
    Ok(steps)
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
