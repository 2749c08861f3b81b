//! Reads traces: any file of MCAP that holds an episode, its messages in whatever order. One that is
//! cut off or damaged gives what is whole of it, never a panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::path::Path;

use foxglove::messages::PoseInFrame;
use mcap::records::{MessageHeader, Record, op};
use prost::Message;

use crate::message::{Choice, EdgeOutcome, End, Graph, Start, Step};
use crate::scan::{Scan, Stop, Visit};
use crate::topic::Topic;
use crate::{EpisodeMeta, METADATA, OUTCOME, Outcome, RECOVERED, TraceError, foreign};

/// Bound on a message of ours, a metadata record, or an attachment that is looked into (bytes).
const LARGEST: u64 = 16 << 20;
/// Bound on all messages that are kept (bytes, as encoded).
const KEPT: u64 = 1 << 30;

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
    /// Messages of `/step`, in the order of their steps.
    pub steps: Vec<Step>,
    /// Messages of `/choice`, likewise.
    pub choices: Vec<Choice>,
    /// Messages of `/outcome`, likewise.
    pub outcomes: Vec<EdgeOutcome>,
    /// Messages of `/end`, at most one.
    pub end: Option<End>,
    /// The graph.
    pub graph: Graph,
    /// Messages of each topic, those of other programs included.
    pub messages: BTreeMap<String, u64>,
    /// The earliest and the latest time of a message (ns since 1970).
    pub times: [u64; 2],
    /// Why the file is cut off, where it does not end as a file of MCAP does. What is before is whole.
    pub cut: Option<String>,
    /// What of the file is damaged and lost, a sentence each.
    pub damage: Vec<String>,
    /// What had been lost of the file that this one was recovered from; none of an original.
    pub recovered: Option<String>,
}

impl Trace {
    /// Whether the file is neither cut off nor damaged.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.cut.is_none() && self.damage.is_empty()
    }
}

/// What is gathered on the way through a file.
#[derive(Default)]
struct Reading {
    trace: Trace,
    /// Name of each channel's topic, and which of ours it is.
    channels: BTreeMap<u16, (String, Option<Topic>)>,
    /// Log times of steps, choices and outcomes.
    steps: Vec<(u64, Step)>,
    choices: Vec<(u64, Choice)>,
    outcomes: Vec<(u64, EdgeOutcome)>,
    goal: Option<[f32; 2]>,
    config: String,
    kept: u64,
    began: bool,
    /// Messages of channels that the file does not describe.
    orphans: u64,
    /// Messages of ours that cannot be decoded, and what is wrong with the first.
    undecoded: Option<(u64, String)>,
}

impl Visit for Reading {
    type Error = String;

    fn wants(&self, opcode: u8, channel: u16, len: u64) -> bool {
        let told = |topic: Topic| {
            use Topic::{Choice, End, Goal, Outcome, Start, Step, Structure};
            [Step, Choice, Outcome, Start, End, Structure, Goal].contains(&topic)
        };
        let own = |(_, topic): &(String, Option<Topic>)| topic.is_some_and(told);
        len <= LARGEST && (opcode != op::MESSAGE || self.channels.get(&channel).is_some_and(own))
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), String> {
        let time = header.log_time;
        let [first, last] = &mut self.trace.times;
        match std::mem::replace(&mut self.began, true) {
            true => (*first, *last) = ((*first).min(time), (*last).max(time)),
            false => (*first, *last) = (time, time),
        }
        let Some((name, topic)) = self.channels.get(&header.channel_id) else {
            self.orphans += 1;
            return Ok(());
        };
        match self.trace.messages.get_mut(name) {
            Some(count) => *count += 1,
            None => drop(self.trace.messages.insert(name.clone(), 1)),
        }
        let Some(topic) = *topic else {
            return Ok(());
        };
        self.kept += data.len() as u64;
        if self.kept > KEPT {
            return Err(format!(
                "its messages are over {KEPT} bytes, more than formica reads"
            ));
        }
        if let Err(error) = self.decode(topic, time, data) {
            let told = || (0, format!("a message of {}: {error}", topic.name()));
            self.undecoded.get_or_insert_with(told).0 += 1;
        }
        Ok(())
    }

    fn record(&mut self, record: Record<'_>) -> Result<(), String> {
        match record {
            Record::Metadata(record) if [METADATA, OUTCOME].contains(&&*record.name) => {
                self.trace.metadata.extend(record.metadata);
            }
            Record::Metadata(mut record) if record.name == RECOVERED => {
                let lost = record.metadata.remove("lost").unwrap_or_default();
                self.trace.recovered = Some(match self.trace.recovered.take() {
                    Some(before) => format!("{before}; {lost}"),
                    None => lost,
                });
            }
            Record::Attachment { header, data, .. } if header.name == "config.toml" => {
                self.config = String::from_utf8_lossy(&data).into_owned();
            }
            _ => {}
        }
        Ok(())
    }
}

impl Reading {
    fn decode(&mut self, topic: Topic, time: u64, data: &[u8]) -> Result<(), prost::DecodeError> {
        let trace = &mut self.trace;
        match topic {
            Topic::Step => self.steps.push((time, Step::decode(data)?)),
            Topic::Choice => self.choices.push((time, Choice::decode(data)?)),
            Topic::Outcome => self.outcomes.push((time, EdgeOutcome::decode(data)?)),
            Topic::Start => trace.start = Some(Start::decode(data)?),
            Topic::End => trace.end = Some(End::decode(data)?),
            Topic::Structure => trace.graph = Graph::decode(data)?,
            Topic::Goal => {
                let goal = PoseInFrame::decode(data)?
                    .pose
                    .and_then(|pose| pose.position);
                self.goal = goal.map(|goal| [goal.x as f32, goal.y as f32]);
            }
            _ => {}
        }
        Ok(())
    }

    /// Puts what is in the order of time into the trace, and says what is wrong with it.
    fn finish(mut self, scan_damage: Vec<String>, cut: Option<String>) -> Trace {
        let mut trace = self.trace;
        self.steps.sort_by_key(|(time, step)| (step.step, *time));
        self.choices
            .sort_by_key(|(time, choice)| (choice.step, *time));
        self.outcomes
            .sort_by_key(|(time, outcome)| (outcome.step, *time));
        trace.steps = self.steps.into_iter().map(|(_, step)| step).collect();
        trace.choices = self.choices.into_iter().map(|(_, choice)| choice).collect();
        trace.outcomes = self.outcomes.into_iter().map(|(_, o)| o).collect();
        trace.meta = EpisodeMeta::of(&trace.metadata, self.config);
        if let Some(goal) = self.goal.filter(|_| !trace.metadata.contains_key("goal")) {
            trace.meta.goal = goal;
        }
        trace.outcome = Outcome::of(&trace.metadata).or_else(|| {
            // Its record is lost, or another program has left it out.
            let end = trace.end.as_ref()?;
            Some(Outcome {
                success: end.success,
                fell: end.fell,
                steps: end.steps,
                episode_return: trace.steps.iter().map(|step| step.reward).sum(),
            })
        });
        (trace.cut, trace.damage) = (cut, scan_damage);
        let version = &trace.meta.version;
        if let Some((count, first)) = self.undecoded {
            let by = match version == env!("CARGO_PKG_VERSION") || version.is_empty() {
                true => String::new(),
                false => {
                    format!("; formica {version} wrote the trace, use that version to read it")
                }
            };
            let told = format!("{count} messages cannot be decoded, the first is {first}{by}");
            trace.damage.push(told);
        }
        if self.orphans > 0 {
            let told = "messages belong to channels that the file does not describe";
            trace.damage.push(format!("{} {told}", self.orphans));
        }
        let told = trace
            .metadata
            .get("steps")
            .filter(|_| trace.recovered.is_none());
        let steps = trace.steps.len();
        if let Some(told) = told.filter(|told| trace.is_whole() && **told != steps.to_string()) {
            let told = format!("its metadata tell {told} steps, but it holds {steps}");
            trace.damage.push(told);
        }
        trace
    }
}

pub(crate) fn damaged(path: &Path, reason: String) -> TraceError {
    TraceError::Mcap {
        path: path.display().to_string(),
        reason,
    }
}

pub(crate) fn refused(path: &Path, source: std::io::Error) -> TraceError {
    TraceError::Io {
        path: path.display().to_string(),
        source,
    }
}

/// Opens a regular file: any other has no end that is known before.
pub(crate) fn open(path: &Path) -> Result<File, TraceError> {
    let io = |error| refused(path, error);
    let about = std::fs::metadata(path).map_err(io)?;
    if !about.is_file() {
        let told = match about.is_dir() {
            true => "it is a folder; name a trace in it",
            false => "it is a device or a pipe; copy what it gives to a file",
        };
        return Err(damaged(path, told.to_owned()));
    }
    File::open(path).map_err(io)
}

/// Looks through a file, and refuses one that is none of MCAP.
pub(crate) fn scanned<R: Read + Seek>(path: &Path, inner: R) -> Result<Scan<R>, TraceError> {
    let io = |error| refused(path, error);
    let mut scan = Scan::of(inner).map_err(io)?;
    let beginning = scan.beginning().map_err(io)?;
    match foreign::kind(&beginning, scan.has_records()) {
        Some(kind) => Err(damaged(path, kind)),
        None => Ok(scan),
    }
}

/// Reads a trace and checks it as it goes: checksums, and that the metadata tell as many steps as
/// there are. Of one that is cut off or damaged it gives what is whole, and says so in
/// [`Trace::cut`] and [`Trace::damage`].
///
/// # Errors
/// What the system refuses, and a file that is no trace of an episode, or so damaged that nothing
/// is left of one.
pub fn read(path: &Path) -> Result<Trace, TraceError> {
    read_from(path, open(path)?)
}

/// As [`read`], of a file's bytes.
///
/// # Errors
/// As those of [`read`].
pub fn read_bytes(path: &Path, bytes: &[u8]) -> Result<Trace, TraceError> {
    read_from(path, Cursor::new(bytes))
}

fn read_from<R: Read + Seek>(path: &Path, inner: R) -> Result<Trace, TraceError> {
    read_scan(path, &mut scanned(path, inner)?)
}

pub(crate) fn read_scan<R: Read + Seek>(
    path: &Path,
    scan: &mut Scan<R>,
) -> Result<Trace, TraceError> {
    let channels = scan.channels.iter().map(|(id, channel)| {
        let topic = Topic::of(channel, &scan.schemas);
        (*id, (channel.topic.clone(), topic))
    });
    let mut reading = Reading {
        channels: channels.collect(),
        ..Reading::default()
    };
    match scan.visit(&mut reading) {
        Ok(()) => {}
        Err(Stop::Io(error)) => return Err(refused(path, error)),
        Err(Stop::Visitor(reason)) => return Err(damaged(path, reason)),
    }
    let (cut, len) = (scan.cut.clone(), scan.len());
    // The end of one that is cut off is told with the cut.
    let lost = scan
        .lost
        .iter()
        .filter(|lost| cut.is_none() || lost.to < len);
    let damage = lost.map(ToString::to_string);
    let damage = damage.chain(scan.notes.iter().cloned()).collect();
    let trace = reading.finish(damage, cut);
    let begins = trace.start.is_some() || !trace.steps.is_empty();
    if trace.metadata.is_empty() && (trace.is_whole() || !begins) {
        let reason = trace.cut.iter().chain(&trace.damage).next();
        let reason = reason.map_or(String::new(), |reason| format!(" ({reason})"));
        let reason = format!("it has no record '{METADATA}'{reason}: it is no trace of an episode");
        return Err(damaged(path, reason));
    }
    Ok(trace)
}

/// Reads a whole trace, as [`read`] does.
///
/// # Errors
/// What the system refuses, or any damage.
pub fn read_whole(path: &Path) -> Result<Trace, TraceError> {
    let mut trace = read(path)?;
    match trace.cut.take().or_else(|| trace.damage.pop()) {
        Some(reason) => Err(damaged(path, reason)),
        None => Ok(trace),
    }
}
