//! Writes one episode's trace.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, Pose, PoseInFrame, PosesInFrame, Quaternion, SceneUpdate,
    Timestamp, Vector3, log,
};
use foxglove::{Encode, Schema};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions, Writer};
use prost::Message;

use crate::scene::{self, BODIES, Scene, WORLD};
use crate::step::{Step, StepRecord};
use crate::{EpisodeMeta, METADATA, Outcome, TraceError};

/// No chunk grows beyond this; one is closed each simulated second in any case.
const CHUNK_BYTES: u64 = 64 * 1024;
const STEP_NANOSECONDS: u64 = 100_000_000;
const STEPS_PER_SECOND: u32 = 10;
/// Length of the trail that /path shows while the episode goes on: a bound on the file's size.
const TRAIL_STEPS: usize = 100;
const LAYOUT: &str = include_str!("layout.json");

#[derive(Clone, Copy)]
enum Topic {
    Maze,
    Ant,
    Graph,
    Nodes,
    Transforms,
    Goal,
    Subgoal,
    Step,
    Path,
    Log,
}

impl Topic {
    const ALL: [Self; 10] = [
        Self::Maze,
        Self::Ant,
        Self::Graph,
        Self::Nodes,
        Self::Transforms,
        Self::Goal,
        Self::Subgoal,
        Self::Step,
        Self::Path,
        Self::Log,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Maze => "/scene/maze",
            Self::Ant => "/scene/ant",
            Self::Graph => "/graph",
            Self::Nodes => "/graph/nodes",
            Self::Transforms => "/tf",
            Self::Goal => "/goal",
            Self::Subgoal => "/subgoal",
            Self::Step => "/step",
            Self::Path => "/path",
            Self::Log => "/log",
        }
    }

    fn schema(self) -> Option<Schema> {
        match self {
            Self::Maze | Self::Ant | Self::Graph => SceneUpdate::get_schema(),
            Self::Nodes | Self::Path => PosesInFrame::get_schema(),
            Self::Transforms => FrameTransforms::get_schema(),
            Self::Goal | Self::Subgoal => PoseInFrame::get_schema(),
            Self::Step => Some(Step::schema()),
            Self::Log => Log::get_schema(),
        }
    }
}

/// Writes `PATH.part` and renames it when the episode is whole.
pub struct EpisodeWriter {
    path: PathBuf,
    part: PathBuf,
    /// None once the trace is finished or given up.
    writer: Option<Writer<BufWriter<File>>>,
    metadata: BTreeMap<String, String>,
    channels: [u16; Topic::ALL.len()],
    start: u64,
    now: u64,
    steps: u32,
    episode_return: f32,
    value: f32,
    subgoal_node: Option<i32>,
    trail: Vec<Pose>,
    buffer: Vec<u8>,
}

fn stamp(time: u64) -> Option<Timestamp> {
    let second = 1_000_000_000;
    Timestamp::new_checked((time / second) as u32, (time % second) as u32)
}

fn pose_in_world(time: u64, [x, y]: [f32; 2]) -> PoseInFrame {
    let pose = Some(scene::pose(x, y, 0.0));
    PoseInFrame {
        timestamp: stamp(time),
        frame_id: WORLD.to_owned(),
        pose,
    }
}

fn poses_in_world(time: u64, poses: Vec<Pose>) -> PosesInFrame {
    PosesInFrame {
        timestamp: stamp(time),
        frame_id: WORLD.to_owned(),
        poses,
    }
}

fn transforms(record: &StepRecord, time: u64) -> FrameTransforms {
    let transforms = record.bodies.iter().zip(BODIES).map(|(pose, frame)| {
        let [x, y, z, qw, qx, qy, qz] = pose.map(f64::from);
        FrameTransform {
            timestamp: stamp(time),
            parent_frame_id: WORLD.to_owned(),
            child_frame_id: frame.to_owned(),
            translation: Some(Vector3 { x, y, z }),
            rotation: Some(Quaternion {
                x: qx,
                y: qy,
                z: qz,
                w: qw,
            }),
        }
    });
    FrameTransforms {
        transforms: transforms.collect(),
    }
}

impl EpisodeWriter {
    /// Begins the trace of a described episode; [`end`](Self::end) completes it.
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn begin(path: &Path, meta: &EpisodeMeta, scene: &Scene) -> Result<Self, TraceError> {
        let mut writer = Self::create(path, scene, &meta.config_toml)?;
        writer.metadata = meta.record();
        Ok(writer)
    }

    /// Begins a trace whose metadata come with [`finish`](Self::finish); `config` goes along as
    /// an attachment.
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn create(path: &Path, scene: &Scene, config: &str) -> Result<Self, TraceError> {
        let name = path.display().to_string();
        let io = |source| TraceError::Io {
            path: name.clone(),
            source,
        };
        let refused = |error: mcap::McapError| TraceError::Mcap {
            path: name.clone(),
            reason: error.to_string(),
        };
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let file = BufWriter::new(File::create(&part).map_err(io)?);
        let clock = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let start = u64::try_from(clock.as_nanos()).unwrap_or(0);
        // Threads for so little data would only take the simulator's cores.
        let mut writer = WriteOptions::new()
            .library(concat!("formica/", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .compression_threads(0)
            .create(file)
            .map_err(refused)?;
        for (name, media_type, text) in [
            ("config.toml", "application/toml", config),
            ("layout.json", "application/json", LAYOUT),
        ] {
            let attachment = Attachment {
                log_time: start,
                create_time: start,
                name: name.to_owned(),
                media_type: media_type.to_owned(),
                data: Cow::Borrowed(text.as_bytes()),
            };
            writer.attach(&attachment).map_err(refused)?;
        }
        let mut channels = [0; Topic::ALL.len()];
        for topic in Topic::ALL {
            let schema = topic.schema().map_or(Ok(0), |schema| {
                writer.add_schema(&schema.name, &schema.encoding, &schema.data)
            });
            let channel = schema.and_then(|schema| {
                writer.add_channel(schema, topic.name(), "protobuf", &BTreeMap::new())
            });
            channels[topic as usize] = channel.map_err(refused)?;
        }
        let mut trace = Self {
            path: path.to_path_buf(),
            part,
            writer: Some(writer),
            metadata: BTreeMap::new(),
            channels,
            start,
            now: start,
            steps: 0,
            episode_return: 0.0,
            value: f32::NAN,
            subgoal_node: None,
            trail: Vec::new(),
            buffer: Vec::with_capacity(4096),
        };
        trace.put(Topic::Maze, &scene.maze())?;
        trace.put(Topic::Ant, &scene::ant())?;
        trace.put(Topic::Graph, &scene.graph())?;
        trace.put(Topic::Nodes, &poses_in_world(start, scene.node_poses()))?;
        trace.log("the episode begins")?;
        trace.flush()?;
        Ok(trace)
    }

    fn refused(&self, reason: &dyn ToString) -> TraceError {
        TraceError::Mcap {
            path: self.path.display().to_string(),
            reason: reason.to_string(),
        }
    }

    fn io(&self, source: std::io::Error) -> TraceError {
        TraceError::Io {
            path: self.path.display().to_string(),
            source,
        }
    }

    fn given_up(&self) -> TraceError {
        self.refused(&"the trace was given up after an error; free some disk space")
    }

    /// One failure is the last: what follows would be a trace with a hole.
    fn with_writer<T>(
        &mut self,
        work: impl FnOnce(&mut Writer<BufWriter<File>>, &[u8]) -> mcap::McapResult<T>,
    ) -> Result<T, TraceError> {
        let Some(writer) = &mut self.writer else {
            return Err(self.given_up());
        };
        work(writer, &self.buffer).map_err(|error| {
            self.writer = None;
            self.refused(&error)
        })
    }

    fn put<M: Encode>(&mut self, topic: Topic, message: &M) -> Result<(), TraceError> {
        self.buffer.clear();
        message
            .encode(&mut self.buffer)
            .map_err(|error| self.refused(&error))?;
        self.put_buffer(topic)
    }

    fn put_buffer(&mut self, topic: Topic) -> Result<(), TraceError> {
        let header = MessageHeader {
            channel_id: self.channels[topic as usize],
            sequence: self.steps,
            log_time: self.now,
            publish_time: self.now,
        };
        self.with_writer(|writer, data| writer.write_to_known_channel(&header, data))
    }

    fn flush(&mut self) -> Result<(), TraceError> {
        self.with_writer(|writer, _| writer.flush())
    }

    /// Tells the value of the state, for the steps from here on: a hierarchy estimates it only
    /// where it chooses.
    pub fn set_value(&mut self, value: f32) {
        self.value = value;
    }

    /// Writes a line of `/log` at the time of the last step.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn log(&mut self, message: &str) -> Result<(), TraceError> {
        let line = Log {
            timestamp: stamp(self.now),
            level: log::Level::Info as i32,
            message: message.to_owned(),
            name: "actor".to_owned(),
            ..Log::default()
        };
        self.put(Topic::Log, &line)
    }

    /// Writes one step.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn step(&mut self, record: &StepRecord) -> Result<(), TraceError> {
        let step = &record.message;
        let time = self
            .start
            .saturating_add(u64::from(step.step) * STEP_NANOSECONDS);
        self.now = self.now.max(time);
        self.episode_return += step.reward;
        self.put(Topic::Transforms, &transforms(record, self.now))?;
        self.put(Topic::Goal, &pose_in_world(self.now, record.goal))?;
        self.put(Topic::Subgoal, &pose_in_world(self.now, record.subgoal))?;
        self.buffer.clear();
        Step::new(record, self.now, self.episode_return, self.value)
            .encode(&mut self.buffer)
            .map_err(|error| self.refused(&error))?;
        self.put_buffer(Topic::Step)?;
        if self.subgoal_node.replace(step.subgoal_node) != Some(step.subgoal_node) {
            let to = match step.subgoal_node {
                ..0 => "the goal".to_owned(),
                node => format!("node {node}"),
            };
            self.log(&format!(
                "step {}: at node {}, on to {to}",
                step.step, step.node
            ))?;
        }
        let [x, y, z, ..] = record.bodies[0];
        self.trail.push(scene::pose(x, y, z));
        self.steps += 1;
        if self.steps.is_multiple_of(STEPS_PER_SECOND) {
            let trail = &self.trail[self.trail.len().saturating_sub(TRAIL_STEPS)..];
            let trail = trail.to_vec();
            self.put(Topic::Path, &poses_in_world(self.now, trail))?;
            self.flush()?;
        }
        Ok(())
    }

    /// Ends a trace that was begun with its metadata.
    ///
    /// # Errors
    /// What the system or mcap refuses; the file stays a `.part`.
    pub fn end(self, outcome: Outcome) -> Result<PathBuf, TraceError> {
        self.finish(outcome.record())
    }

    /// Ends the trace with metadata, the number of steps added, and puts it in its place, whole.
    ///
    /// # Errors
    /// What the system or mcap refuses; the file stays a `.part`.
    pub fn finish(mut self, metadata: BTreeMap<String, String>) -> Result<PathBuf, TraceError> {
        let trail = std::mem::take(&mut self.trail);
        self.put(Topic::Path, &poses_in_world(self.now, trail))?;
        let outcome = metadata
            .get("outcome")
            .map_or("unknown outcome", String::as_str);
        self.log(&format!(
            "the episode ends: {outcome} after {} steps",
            self.steps
        ))?;
        let mut all = std::mem::take(&mut self.metadata);
        all.extend(metadata);
        all.insert("steps".to_owned(), self.steps.to_string());
        let record = Metadata {
            name: METADATA.to_owned(),
            metadata: all,
        };
        self.with_writer(|writer, _| {
            writer.write_metadata(&record)?;
            writer.finish()
        })?;
        let Some(writer) = self.writer.take() else {
            return Err(self.given_up());
        };
        let file = writer
            .into_inner()
            .into_inner()
            .map_err(|error| self.io(error.into_error()))?;
        file.sync_all().map_err(|error| self.io(error))?;
        fs::rename(&self.part, &self.path).map_err(|error| self.io(error))?;
        // The new name lasts once the folder is on disk; some systems cannot do that.
        let folder = self
            .path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let _ = File::open(folder.unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all());
        Ok(self.path.clone())
    }

    /// Gives the trace up and removes what was written of it.
    pub fn discard(mut self) {
        self.writer = None;
        let _ = fs::remove_file(&self.part);
    }
}
