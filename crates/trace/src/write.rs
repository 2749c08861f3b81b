//! Writes one episode's trace.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, PointCloud, Pose, PoseInFrame, PosesInFrame, Quaternion,
    Timestamp, Vector3, log,
};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use prost::Message;

use crate::message::{self, Choice, EdgeOutcome, End, Start, Step};
use crate::record::{ChoiceRecord, EndRecord, OutcomeRecord, StartRecord, StepRecord};
use crate::scene::{self, BODIES, WORLD};
use crate::still::Still;
use crate::topic::Topic;
use crate::{EpisodeMeta, METADATA, OUTCOME, Outcome, TraceError};

/// No chunk grows beyond this; one is closed each second in any case.
const CHUNK_BYTES: u64 = 256 * 1024;
/// Time between two flushes of what is written.
const FLUSH: Duration = Duration::from_secs(1);
const STEP_NANOSECONDS: u64 = 100_000_000;
/// Steps between two poses of /path, between two messages of it, and of the trail that each shows:
/// a bound on the file's size.
const TRAIL: [u32; 3] = [10, 10, 100];
/// Made once: it counts processors, which is as much work as a hundred steps' records. LZ4 makes
/// files a third larger than zstd at its fastest, for two fifths of the processor time.
pub(crate) static OPTIONS: LazyLock<WriteOptions> = LazyLock::new(|| {
    WriteOptions::new()
        .library(concat!("formica/", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(CHUNK_BYTES))
        .compression(Some(Compression::Lz4))
});
const LAYOUT: &str = include_str!("layout.json");

/// A file of mcap that is being written, renamed once it is whole.
struct Output {
    /// Where it goes, and what it is called until then.
    path: PathBuf,
    part: PathBuf,
    /// None once it is finished or given up.
    writer: Option<Writer<BufWriter<File>>>,
}

impl Output {
    fn create(path: &Path, part: PathBuf) -> Result<Self, TraceError> {
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
    fn with<T>(
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
    fn finish(mut self) -> Result<PathBuf, TraceError> {
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

    fn discard(mut self) {
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

fn refused(path: &Path, reason: &dyn ToString) -> TraceError {
    TraceError::Mcap {
        path: path.display().to_string(),
        reason: reason.to_string(),
    }
}

/// Writes a `.part` and renames it when the episode is whole.
pub struct EpisodeWriter {
    output: Output,
    channels: [u16; Topic::ALL.len()],
    still: Arc<Still>,
    goal: [f32; 2],
    start: u64,
    now: u64,
    steps: u32,
    subgoal: Option<[f32; 2]>,
    /// Step of the last choice.
    chosen: u32,
    trail: Vec<Pose>,
    flushed: Instant,
    buffer: Vec<u8>,
    /// Filled anew for each step.
    step: Step,
    transforms: FrameTransforms,
}

fn stamp(time: u64) -> Option<Timestamp> {
    let second = 1_000_000_000;
    Timestamp::new_checked((time / second) as u32, (time % second) as u32)
}

fn pose_in_world(time: u64, [x, y]: [f32; 2]) -> PoseInFrame {
    PoseInFrame {
        timestamp: stamp(time),
        frame_id: WORLD.to_owned(),
        pose: Some(scene::pose(x, y, 0.0)),
    }
}

fn poses_in_world(time: u64, poses: Vec<Pose>) -> PosesInFrame {
    PosesInFrame {
        timestamp: stamp(time),
        frame_id: WORLD.to_owned(),
        poses,
    }
}

fn frames() -> FrameTransforms {
    let transforms = BODIES.iter().map(|frame| FrameTransform {
        parent_frame_id: WORLD.to_owned(),
        child_frame_id: (*frame).to_owned(),
        ..FrameTransform::default()
    });
    FrameTransforms {
        transforms: transforms.collect(),
    }
}

impl EpisodeWriter {
    /// Begins the trace of an episode: `part` is written, and put in its place at
    /// [`end`](Self::end).
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn begin(
        path: &Path,
        part: PathBuf,
        meta: &EpisodeMeta,
        still: Arc<Still>,
        from: &StartRecord,
    ) -> Result<Self, TraceError> {
        let mut output = Output::create(path, part)?;
        let clock = SystemTime::now().duration_since(UNIX_EPOCH);
        let start = u64::try_from(clock.unwrap_or_default().as_nanos()).unwrap_or(0);
        let channels = output.with(|writer| {
            for (name, media_type, text) in [
                ("config.toml", "application/toml", &*meta.config_toml),
                ("layout.json", "application/json", LAYOUT),
            ] {
                writer.attach(&Attachment {
                    log_time: start,
                    create_time: start,
                    name: name.to_owned(),
                    media_type: media_type.to_owned(),
                    data: Cow::Borrowed(text.as_bytes()),
                })?;
            }
            writer.write_metadata(&Metadata {
                name: METADATA.to_owned(),
                metadata: meta.record(),
            })?;
            let mut channels = [0; Topic::ALL.len()];
            for topic in Topic::ALL {
                let schema = topic.schema().map_or(Ok(0), |schema| {
                    writer.add_schema(&schema.name, &schema.encoding, &schema.data)
                })?;
                let none = BTreeMap::new();
                channels[topic as usize] =
                    writer.add_channel(schema, topic.name(), "protobuf", &none)?;
            }
            Ok(channels)
        })?;
        let step = Step {
            value: f32::NAN,
            low_version: meta.low_version,
            high_version: meta.high_version,
            graph_version: meta.graph_version,
            ..Step::default()
        };
        let mut trace = Self {
            output,
            channels,
            goal: meta.goal,
            start,
            now: start,
            steps: 0,
            subgoal: None,
            chosen: 0,
            trail: Vec::new(),
            flushed: Instant::now(),
            buffer: Vec::with_capacity(4096),
            step,
            transforms: frames(),
            still,
        };
        trace.opening(from, meta.success_radius)?;
        Ok(trace)
    }

    /// What stands still, and the start.
    fn opening(&mut self, from: &StartRecord, goal_radius: f32) -> Result<(), TraceError> {
        let start = self.start;
        let still = Arc::clone(&self.still);
        for (topic, message) in still.messages() {
            self.buffer.clear();
            self.buffer.extend(message);
            match topic {
                Topic::Maze => self.append(&scene::goal(self.goal, goal_radius))?,
                Topic::Nodes => self.append(&PosesInFrame {
                    timestamp: stamp(start),
                    ..PosesInFrame::default()
                })?,
                Topic::WallPoints | Topic::AntPoints => self.append(&PointCloud {
                    timestamp: stamp(start),
                    ..PointCloud::default()
                })?,
                Topic::Structure => self.append(&message::Graph {
                    timestamp: Some(message::timestamp(start)),
                    ..message::Graph::default()
                })?,
                _ => {}
            }
            self.put_buffer(topic)?;
        }
        self.put(Topic::Goal, &pose_in_world(start, self.goal))?;
        let from = Start {
            timestamp: Some(message::timestamp(start)),
            state: from.state.to_vec(),
            exits: from.exits,
        };
        self.put(Topic::Start, &from)?;
        self.log(log::Level::Info, "the episode begins")?;
        self.flush()
    }

    /// Puts a message behind what is in the buffer.
    fn append(&mut self, message: &impl Message) -> Result<(), TraceError> {
        let encoded = message.encode(&mut self.buffer);
        encoded.map_err(|error| refused(&self.output.path, &error))
    }

    fn put(&mut self, topic: Topic, message: &impl Message) -> Result<(), TraceError> {
        self.buffer.clear();
        self.append(message)?;
        self.put_buffer(topic)
    }

    fn put_buffer(&mut self, topic: Topic) -> Result<(), TraceError> {
        let header = MessageHeader {
            channel_id: self.channels[topic as usize],
            sequence: self.steps,
            log_time: self.now,
            publish_time: self.now,
        };
        let data = &self.buffer;
        let written = |writer: &mut Writer<_>| writer.write_to_known_channel(&header, data);
        self.output.with(written)
    }

    /// Puts what was written where a killed process does not take it along.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn flush(&mut self) -> Result<(), TraceError> {
        self.flushed = Instant::now();
        self.output.with(Writer::flush)
    }

    /// When the next flush is due.
    pub(crate) fn flush_due(&self) -> Instant {
        self.flushed + FLUSH
    }

    fn log(&mut self, level: log::Level, message: &str) -> Result<(), TraceError> {
        let line = Log {
            timestamp: stamp(self.now),
            level: level as i32,
            message: message.to_owned(),
            name: "actor".to_owned(),
            ..Log::default()
        };
        self.put(Topic::Log, &line)
    }

    /// Turns the clock to a step.
    fn at(&mut self, step: u32) {
        let passed = u64::from(step).saturating_mul(STEP_NANOSECONDS);
        self.now = self.now.max(self.start.saturating_add(passed));
    }

    /// Writes what became of a choice.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn outcome(&mut self, record: &OutcomeRecord) -> Result<(), TraceError> {
        self.at(record.step);
        let steps = record.step.saturating_sub(self.chosen);
        let message = EdgeOutcome {
            timestamp: Some(message::timestamp(self.now)),
            step: record.step,
            node: record.node,
            subgoal_node: record.subgoal_node,
            reached: record.reached,
            steps,
        };
        self.put(Topic::Outcome, &message)?;
        let to = record.subgoal_node;
        match record.reached {
            true => self.log(
                log::Level::Info,
                &format!("node {to} reached in {steps} steps"),
            ),
            false => self.log(
                log::Level::Warning,
                &format!("node {to} given up after {steps} steps"),
            ),
        }
    }

    /// Writes a choice of the high level.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn choice(&mut self, record: ChoiceRecord) -> Result<(), TraceError> {
        self.at(record.step);
        self.chosen = record.step;
        self.step.value = record.value;
        let (node, subgoal) = (record.node, record.subgoal_node);
        let message = Choice {
            timestamp: Some(message::timestamp(self.now)),
            step: record.step,
            node,
            goal_node: record.goal_node,
            subgoal_node: subgoal,
            value: record.value,
            neighbours: record.neighbours,
            probabilities: record.probabilities,
        };
        self.put(Topic::Choice, &message)?;
        self.put(Topic::ChoiceScene, &self.still.scene.choice(node, subgoal))?;
        self.log(
            log::Level::Info,
            &format!("at node {node}, on to node {subgoal}"),
        )
    }

    fn put_transforms(&mut self, bodies: &[[f32; 7]; 9]) -> Result<(), TraceError> {
        let timestamp = stamp(self.now);
        for (transform, pose) in self.transforms.transforms.iter_mut().zip(bodies) {
            let [x, y, z, qw, qx, qy, qz] = pose.map(f64::from);
            transform.timestamp = timestamp;
            transform.translation = Some(Vector3 { x, y, z });
            transform.rotation = Some(Quaternion {
                x: qx,
                y: qy,
                z: qz,
                w: qw,
            });
        }
        self.buffer.clear();
        let encoded = Message::encode(&self.transforms, &mut self.buffer);
        encoded.map_err(|error| refused(&self.output.path, &error))?;
        self.put_buffer(Topic::Transforms)
    }

    /// Writes one step.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn step(&mut self, record: &StepRecord) -> Result<(), TraceError> {
        self.at(record.step);
        self.put_transforms(&record.bodies)?;
        if self.subgoal.replace(record.subgoal) != Some(record.subgoal) {
            let subgoal = pose_in_world(self.now, record.subgoal);
            self.put(Topic::Subgoal, &subgoal)?;
        }
        let [x, y, z, ..] = record.observation;
        let distance = |[to_x, to_y]: [f32; 2]| (to_x - x).hypot(to_y - y);
        let step = &mut self.step;
        step.timestamp = Some(message::timestamp(self.now));
        step.step = record.step;
        step.reward = record.reward;
        step.return_so_far += record.reward;
        step.goal_distance = distance(self.goal);
        step.subgoal_distance = distance(record.subgoal);
        step.node = record.node;
        step.subgoal_node = record.subgoal_node;
        step.observation.clear();
        step.observation.extend(record.observation);
        step.action.clear();
        step.action.extend(record.action);
        self.buffer.clear();
        let encoded = Message::encode(&self.step, &mut self.buffer);
        encoded.map_err(|error| refused(&self.output.path, &error))?;
        self.put_buffer(Topic::Step)?;
        let [pose_every, path_every, length] = TRAIL;
        if self.steps.is_multiple_of(pose_every) {
            self.trail.push(scene::pose(x, y, z));
        }
        self.steps += 1;
        if self.steps.is_multiple_of(path_every) {
            let length = (length / pose_every) as usize;
            let trail = &self.trail[self.trail.len().saturating_sub(length)..];
            let trail = poses_in_world(self.now, trail.to_vec());
            self.put(Topic::Path, &trail)?;
        }
        if Instant::now() >= self.flush_due() {
            self.flush()?;
        }
        Ok(())
    }

    /// Writes the state after the last step and puts the trace in its place, whole.
    ///
    /// # Errors
    /// What the system or mcap refuses; the file stays a `.part`.
    pub fn end(mut self, record: &EndRecord) -> Result<PathBuf, TraceError> {
        self.at(self.steps);
        self.put_transforms(&record.bodies)?;
        let [x, y, z, ..] = record.observation;
        let mut path = std::mem::take(&mut self.trail);
        path.push(scene::pose(x, y, z));
        self.put(Topic::Path, &poses_in_world(self.now, path))?;
        let end = End {
            timestamp: Some(message::timestamp(self.now)),
            steps: self.steps,
            success: record.success,
            fell: record.fell,
            observation: record.observation.to_vec(),
        };
        self.put(Topic::End, &end)?;
        let outcome = Outcome {
            success: record.success,
            fell: record.fell,
            steps: self.steps,
            episode_return: self.step.return_so_far,
        };
        let (told, level) = match (record.success, record.fell) {
            (true, _) => ("the goal is reached", log::Level::Info),
            (false, true) => ("it ends on its back, without the goal", log::Level::Warning),
            (false, false) => ("it ends without the goal", log::Level::Warning),
        };
        self.log(level, &format!("{told}, after {} steps", self.steps))?;
        self.output.with(|writer| {
            writer.write_metadata(&Metadata {
                name: OUTCOME.to_owned(),
                metadata: outcome.record(),
            })
        })?;
        self.output.finish()
    }

    /// Gives the trace up and removes what was written of it.
    pub fn discard(self) {
        self.output.discard();
    }
}
