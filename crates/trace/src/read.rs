//! Reads traces. No length that a file tells is believed before it is checked, and a file that
//! is cut off or altered is an error, never a panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;

use crate::message::{Choice, EdgeOutcome, End, Graph, Start, Step};
use crate::topic::Topic;
use crate::{EpisodeMeta, METADATA, OUTCOME, Outcome, TraceError};

/// Bound on the length of any record or chunk of a trace (bytes).
const MAX_RECORD: usize = 16 << 20;
/// Bound on the number of messages of a trace.
const MAX_MESSAGES: u64 = 10_000_000;
/// Bound on the number of its steps, which are kept.
const MAX_STEPS: usize = 2_000_000;

/// A trace as read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Both metadata records as they are: versions, seeds, outcome.
    pub metadata: BTreeMap<String, String>,
    /// Which episode it is of.
    pub meta: EpisodeMeta,
    /// How the episode ended; none when the trace does not say.
    pub outcome: Option<Outcome>,
    /// Messages of `/start`, at most one.
    pub start: Option<Start>,
    /// Messages of `/step`, in order.
    pub steps: Vec<Step>,
    /// Messages of `/choice`.
    pub choices: Vec<Choice>,
    /// Messages of `/outcome`.
    pub outcomes: Vec<EdgeOutcome>,
    /// Messages of `/end`, at most one.
    pub end: Option<End>,
    /// The graph.
    pub graph: Graph,
    /// Messages of each topic.
    pub messages: BTreeMap<String, u64>,
    /// Times of the first and last message (ns since 1970).
    pub times: [u64; 2],
    /// Where the file is cut off or damaged, why it ends there: what is before it is whole.
    pub cut: Option<String>,
}

/// Why a scan ended before its time.
pub(crate) enum Stop {
    /// The file ends or is damaged; what was visited before is whole.
    Cut(String),
    /// The visitor refused, or the system did.
    Error(TraceError),
}

/// Calls `visit` with each record, those within chunks as well.
pub(crate) fn scan(
    path: &Path,
    mut visit: impl FnMut(Record<'_>) -> Result<(), String>,
) -> Result<(), Stop> {
    let name = path.display().to_string();
    let io = |source| {
        Stop::Error(TraceError::Io {
            path: name.clone(),
            source,
        })
    };
    let mut file = File::open(path).map_err(io)?;
    // A chunk is looked at as a whole before any message of it is believed.
    let options = LinearReaderOptions::default()
        .with_check_finishes_after_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(MAX_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| Stop::Cut(error.to_string()))? {
            LinearReadEvent::ReadRequest(need) => {
                let read = file.read(reader.insert(need.min(MAX_RECORD))).map_err(io)?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                let record = mcap::parse_record(opcode, data);
                let record = record.map_err(|error| Stop::Cut(error.to_string()))?;
                visit(record).map_err(Stop::Cut)?;
            }
        }
    }
    Ok(())
}

/// What is gathered on the way through a file.
#[derive(Default)]
struct Reading {
    trace: Trace,
    topics: BTreeMap<u16, String>,
    config: String,
    total: u64,
    began: bool,
}

impl Reading {
    fn take(&mut self, record: Record<'_>) -> Result<(), String> {
        match record {
            Record::Channel(channel) => {
                self.topics.insert(channel.id, channel.topic);
            }
            Record::Message { header, data } => {
                let topic = self.topics.get(&header.channel_id).cloned();
                let topic = topic.ok_or("a message names a channel that does not exist")?;
                let times = &mut self.trace.times;
                if !self.began {
                    *times = [header.log_time; 2];
                    self.began = true;
                }
                if header.log_time < times[1] {
                    return Err(format!(
                        "time runs backwards on {topic}: {} ns after {} ns",
                        header.log_time, times[1]
                    ));
                }
                times[1] = header.log_time;
                self.total += 1;
                if self.total > MAX_MESSAGES {
                    return Err(format!("it has more than {MAX_MESSAGES} messages"));
                }
                self.message(&topic, &data)?;
                *self.trace.messages.entry(topic).or_default() += 1;
            }
            Record::Metadata(record) if [METADATA, OUTCOME].contains(&&*record.name) => {
                self.trace.metadata.extend(record.metadata);
            }
            Record::Attachment { header, data, .. } if header.name == "config.toml" => {
                self.config = String::from_utf8_lossy(&data).into_owned();
            }
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, topic: &str, data: &[u8]) -> Result<(), String> {
        let is = |known: Topic| topic == known.name();
        let told = |error: prost::DecodeError| format!("a message of {topic}: {error}");
        let trace = &mut self.trace;
        if is(Topic::Step) {
            if trace.steps.len() >= MAX_STEPS {
                return Err(format!("it has more than {MAX_STEPS} steps"));
            }
            trace.steps.push(Step::decode(data).map_err(told)?);
        } else if is(Topic::Choice) {
            trace.choices.push(Choice::decode(data).map_err(told)?);
        } else if is(Topic::Outcome) {
            let outcome = EdgeOutcome::decode(data).map_err(told)?;
            trace.outcomes.push(outcome);
        } else if is(Topic::Start) {
            trace.start = Some(Start::decode(data).map_err(told)?);
        } else if is(Topic::End) {
            trace.end = Some(End::decode(data).map_err(told)?);
        } else if is(Topic::Structure) {
            trace.graph = Graph::decode(data).map_err(told)?;
        }
        Ok(())
    }
}

fn damaged(path: &Path, reason: String) -> TraceError {
    TraceError::Mcap {
        path: path.display().to_string(),
        reason,
    }
}

/// Reads a trace and checks it as it goes: checksums, the order of time, and that the metadata
/// tell as many steps as there are. Of one that is cut off or damaged it gives what comes before,
/// and says so in [`Trace::cut`].
///
/// # Errors
/// What the system refuses, and a file that is damaged before it says which episode it is of.
pub fn read(path: &Path) -> Result<Trace, TraceError> {
    let mut reading = Reading::default();
    let cut = match scan(path, |record| reading.take(record)) {
        Ok(()) => None,
        Err(Stop::Cut(reason)) => Some(reason),
        Err(Stop::Error(error)) => return Err(error),
    };
    let Reading {
        mut trace, config, ..
    } = reading;
    if trace.metadata.is_empty() {
        let reason = cut.map_or(String::new(), |reason| format!(" ({reason})"));
        let reason = format!("it has no record '{METADATA}'{reason}: it is no trace of an episode");
        return Err(damaged(path, reason));
    }
    trace.meta = EpisodeMeta::of(&trace.metadata, config);
    trace.outcome = Outcome::of(&trace.metadata);
    trace.cut = cut;
    let told = trace.metadata.get("steps");
    let steps = trace.steps.len();
    if let Some(told) = told.filter(|told| trace.cut.is_none() && **told != steps.to_string()) {
        trace.cut = Some(format!(
            "its metadata tell {told} steps, but it holds {steps}"
        ));
    }
    Ok(trace)
}

/// Reads a whole trace, as [`read`] does.
///
/// # Errors
/// What the system refuses, or any damage.
pub fn read_whole(path: &Path) -> Result<Trace, TraceError> {
    let trace = read(path)?;
    match trace.cut {
        Some(reason) => Err(damaged(path, reason)),
        None => Ok(trace),
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
