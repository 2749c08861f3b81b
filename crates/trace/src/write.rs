//! Writes one episode's trace.

mod output;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, PointCloud, Pose, PoseInFrame, PosesInFrame, Quaternion,
    Timestamp, Vector3, log,
};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Writer};
use prost::Message;
use simulator::Part;

use crate::message::{self, Choice, EdgeOutcome, End, Start, Step};
use crate::record::{ChoiceRecord, EndRecord, OutcomeRecord, StepRecord};
use crate::scene::{self, WORLD};
use crate::still::Still;
use crate::topic::Topic;
use crate::{EpisodeMeta, METADATA, OUTCOME, Outcome, TraceError};
use output::{Output, refused};

pub(crate) use output::OPTIONS;

/// Time between two flushes of what is written.
const FLUSH: Duration = Duration::from_secs(1);
/// Simulated time of a step (s) where the metadata have none.
const STEP_SECONDS: f32 = 0.1;
/// Steps between two poses of /path, between two messages of it, and of the trail that each shows:
/// a bound on the file's size.
const TRAIL: [u32; 3] = [10, 10, 100];
const LAYOUT: &str = include_str!("layout.json");

/// Writes a `.part` and renames it when the episode is whole.
pub struct EpisodeWriter {
    output: Output,
    /// None for topics that this trace does not have.
    channels: [Option<u16>; Topic::ALL.len()],
    still: Arc<Still>,
    goal: [f32; 2],
    /// Wall clock at the start, and now (ns since 1970).
    start: u64,
    now: u64,
    /// Simulated time of a step (ns).
    step_time: u64,
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

fn frames(parts: &[Part]) -> FrameTransforms {
    let transforms = parts.iter().map(|part| FrameTransform {
        parent_frame_id: WORLD.to_owned(),
        child_frame_id: part.name.to_owned(),
        ..FrameTransform::default()
    });
    FrameTransforms {
        transforms: transforms.collect(),
    }
}

/// Writes attachments, metadata and channels; the channels of the topics that the trace has.
fn head<W: Write + Seek>(
    writer: &mut Writer<W>,
    meta: &EpisodeMeta,
    still: &Still,
    start: u64,
) -> mcap::McapResult<[Option<u16>; Topic::ALL.len()]> {
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
    let mut channels = [None; Topic::ALL.len()];
    for topic in Topic::ALL
        .into_iter()
        .filter(|topic| still.scene.has(*topic))
    {
        let schema = topic.schema().map_or(Ok(0), |schema| {
            writer.add_schema(&schema.name, &schema.encoding, &schema.data)
        })?;
        let none = BTreeMap::new();
        let channel = writer.add_channel(schema, topic.name(), "protobuf", &none)?;
        channels[topic as usize] = Some(channel);
    }
    Ok(channels)
}

impl EpisodeWriter {
    /// Begins the trace of an episode: `part` is written, and put in its place at
    /// [`end`](Self::end). `state` is the simulator's at the start, if it could be saved.
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn begin(
        path: &Path,
        part: PathBuf,
        meta: &EpisodeMeta,
        still: Arc<Still>,
        state: Option<Vec<u8>>,
    ) -> Result<Self, TraceError> {
        let mut output = Output::create(path, part)?;
        let clock = SystemTime::now().duration_since(UNIX_EPOCH);
        let start = u64::try_from(clock.unwrap_or_default().as_nanos()).unwrap_or(0);
        let channels = output.with(|writer| head(writer, meta, &still, start))?;
        let step = Step {
            value: f32::NAN,
            ..Step::default()
        };
        let seconds = (meta.spaces.as_ref()).map_or(STEP_SECONDS, |spaces| spaces.control_seconds);
        let mut trace = Self {
            output,
            channels,
            goal: meta.goal,
            start,
            now: start,
            // To the microsecond: 0.1 s as f32 is 1.5 ns more than that.
            step_time: (f64::from(seconds) * 1e6).round() as u64 * 1000,
            steps: 0,
            subgoal: None,
            chosen: 0,
            trail: Vec::new(),
            flushed: Instant::now(),
            buffer: Vec::with_capacity(4096),
            step,
            transforms: frames(still.scene.parts),
            still,
        };
        trace.opening(meta, state)?;
        Ok(trace)
    }

    /// What stands still, and the start.
    fn opening(&mut self, meta: &EpisodeMeta, state: Option<Vec<u8>>) -> Result<(), TraceError> {
        let start = self.start;
        let still = Arc::clone(&self.still);
        for (topic, message) in still.messages() {
            self.buffer.clear();
            self.buffer.extend(message);
            match topic {
                Topic::Maze => self.append(&scene::goal(meta.goal, meta.success_radius))?,
                Topic::Nodes => self.append(&PosesInFrame {
                    timestamp: stamp(start),
                    ..PosesInFrame::default()
                })?,
                Topic::WallPoints | Topic::BodyPoints => self.append(&PointCloud {
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
            simulator_state: state.unwrap_or_default(),
            version_names: meta.versions.keys().cloned().collect(),
            versions: meta.versions.values().copied().collect(),
            ..Start::default()
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

    /// Writes a message; nothing of a topic that the trace does not have.
    fn put(&mut self, topic: Topic, message: &impl Message) -> Result<(), TraceError> {
        self.buffer.clear();
        self.append(message)?;
        self.put_buffer(topic)
    }

    fn put_buffer(&mut self, topic: Topic) -> Result<(), TraceError> {
        let Some(channel_id) = self.channels[topic as usize] else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id,
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
        let passed = u64::from(step).saturating_mul(self.step_time);
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

    fn put_transforms(&mut self, poses: &[[f32; 7]]) -> Result<(), TraceError> {
        let timestamp = stamp(self.now);
        for (transform, pose) in self.transforms.transforms.iter_mut().zip(poses) {
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
        self.put_transforms(&record.state.poses)?;
        if let Some(subgoal) = record.subgoal
            && self.subgoal.replace(subgoal) != Some(subgoal)
        {
            let subgoal = pose_in_world(self.now, subgoal);
            self.put(Topic::Subgoal, &subgoal)?;
        }
        let [x, y, z] = record.state.place();
        let distance = |[to_x, to_y]: [f32; 2]| (to_x - x).hypot(to_y - y);
        let step = &mut self.step;
        step.timestamp = Some(message::timestamp(self.now));
        step.step = record.step;
        step.reward = record.reward;
        step.return_so_far += record.reward;
        step.goal_distance = distance(self.goal);
        step.subgoal_distance = record.subgoal.map_or(f32::NAN, distance);
        step.node = record.node;
        step.subgoal_node = record.subgoal_node;
        step.observation.clone_from(&record.state.observation);
        step.observation_bytes
            .clone_from(&record.state.observation_bytes);
        step.action.clone_from(&record.action);
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
        self.put_transforms(&record.state.poses)?;
        let [x, y, z] = record.state.place();
        let mut path = std::mem::take(&mut self.trail);
        path.push(scene::pose(x, y, z));
        self.put(Topic::Path, &poses_in_world(self.now, path))?;
        let end = End {
            timestamp: Some(message::timestamp(self.now)),
            steps: self.steps,
            success: record.success,
            fell: record.fell,
            observation: record.state.observation.clone(),
            observation_bytes: record.state.observation_bytes.clone(),
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
