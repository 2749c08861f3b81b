//! Writes one episode's trace.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use foxglove::Encode;
use foxglove::messages::{
    FrameTransform, FrameTransforms, PoseInFrame, Quaternion, SceneUpdate, Timestamp, Vector3,
};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions, Writer};

use crate::scene::{self, BODIES, Scene};
use crate::{METADATA, TraceError};

/// A small chunk is on disk soon: about a second of simulated time.
const CHUNK_BYTES: u64 = 16 * 1024;
const STEP_NANOSECONDS: u64 = 100_000_000;

/// The numbers of one control step, as the trace holds them.
#[derive(Debug, Clone, Default, Encode)]
pub struct StepMessage {
    /// Control step in the episode.
    pub step: u32,
    /// Reward after the action.
    pub reward: f32,
    /// Distance of the torso to the goal (m).
    pub goal_distance: f32,
    /// Distance of the torso to the subgoal (m).
    pub subgoal_distance: f32,
    /// The ant's node, -1 for none.
    pub node: i32,
    /// The chosen node, -1 for none or the goal itself.
    pub subgoal_node: i32,
    /// Version of the low-level weights.
    pub low_version: u64,
    /// Version of the high-level weights.
    pub high_version: u64,
    /// Version of the graph.
    pub graph_version: u64,
    /// The observation before the action, 29 values.
    pub observation: Vec<f32>,
    /// The action, 8 values.
    pub action: Vec<f32>,
    /// Neighbours of the node that the last choice was made at.
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    pub probabilities: Vec<f32>,
}

/// One step: its numbers, where the bodies are, and where the ant is to go.
#[derive(Debug, Clone, Default)]
pub struct StepRecord {
    /// The numbers.
    pub message: StepMessage,
    /// Poses of the nine bodies: x, y, z (m), quaternion w, x, y, z.
    pub bodies: [[f32; 7]; 9],
    /// The goal (m).
    pub goal: [f32; 2],
    /// The subgoal (m).
    pub subgoal: [f32; 2],
}

#[derive(Clone, Copy)]
enum Topic {
    Scene,
    Ant,
    Transforms,
    Goal,
    Subgoal,
    Step,
}

/// Writes `PATH.part` and renames it when the episode is whole.
pub struct EpisodeWriter {
    path: PathBuf,
    part: PathBuf,
    writer: Option<Writer<BufWriter<File>>>,
    channels: [u16; 6],
    start: u64,
    steps: u32,
    buffer: Vec<u8>,
}

impl EpisodeWriter {
    /// Begins a trace; `config` goes along as an attachment.
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn create(path: &Path, scene: &Scene, config: &str) -> Result<Self, TraceError> {
        let name = path.display().to_string();
        let io = |source| TraceError::Io { path: name.clone(), source };
        let refused =
            |error: mcap::McapError| TraceError::Mcap { path: name.clone(), reason: error.to_string() };
        let part = path.with_extension("mcap.part");
        let file = BufWriter::new(File::create(&part).map_err(io)?);
        let clock = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let start = u64::try_from(clock.as_nanos()).unwrap_or(0);
        let mut writer = WriteOptions::new()
            .library(concat!("formica/", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .create(file)
            .map_err(refused)?;
        let attachment = Attachment {
            log_time: start,
            create_time: start,
            name: "config.toml".to_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(config.as_bytes()),
        };
        writer.attach(&attachment).map_err(refused)?;
        let mut channels = [0; 6];
        let mut add = |topic: Topic, name: &str, schema: Option<foxglove::Schema>| {
            let schema = schema.map_or(Ok(0), |schema| {
                writer.add_schema(&schema.name, &schema.encoding, &schema.data)
            });
            let channel = schema
                .and_then(|schema| writer.add_channel(schema, name, "protobuf", &BTreeMap::new()));
            channel.map(|channel| channels[topic as usize] = channel)
        };
        add(Topic::Scene, "/scene", SceneUpdate::get_schema())
            .and_then(|()| add(Topic::Ant, "/ant", SceneUpdate::get_schema()))
            .and_then(|()| add(Topic::Transforms, "/tf", FrameTransforms::get_schema()))
            .and_then(|()| add(Topic::Goal, "/goal", PoseInFrame::get_schema()))
            .and_then(|()| add(Topic::Subgoal, "/subgoal", PoseInFrame::get_schema()))
            .and_then(|()| add(Topic::Step, "/step", StepMessage::get_schema()))
            .map_err(refused)?;
        let writer = Some(writer);
        let buffer = Vec::with_capacity(4096);
        let mut trace =
            Self { path: path.to_path_buf(), part, writer, channels, start, steps: 0, buffer };
        trace.put(Topic::Scene, start, &scene.message())?;
        trace.put(Topic::Ant, start, &scene::ant())?;
        Ok(trace)
    }

    fn refused(&self, reason: impl ToString) -> TraceError {
        TraceError::Mcap { path: self.path.display().to_string(), reason: reason.to_string() }
    }

    fn put<M: Encode>(&mut self, topic: Topic, time: u64, message: &M) -> Result<(), TraceError> {
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(|error| self.refused(error))?;
        let header = MessageHeader {
            channel_id: self.channels[topic as usize],
            sequence: self.steps,
            log_time: time,
            publish_time: time,
        };
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let written = writer.write_to_known_channel(&header, &self.buffer);
        written.map_err(|error| self.refused(error))
    }

    /// Writes one step.
    ///
    /// # Errors
    /// What the system or mcap refuses; the trace is then given up.
    pub fn step(&mut self, record: &StepRecord) -> Result<(), TraceError> {
        let time = self.start + u64::from(record.message.step) * STEP_NANOSECONDS;
        let second = 1_000_000_000;
        let stamp = Timestamp::new_checked((time / second) as u32, (time % second) as u32);
        let transforms = record.bodies.iter().zip(BODIES).map(|(pose, frame)| {
            let [x, y, z, qw, qx, qy, qz] = pose.map(f64::from);
            FrameTransform {
                timestamp: stamp,
                parent_frame_id: "world".to_owned(),
                child_frame_id: frame.to_owned(),
                translation: Some(Vector3 { x, y, z }),
                rotation: Some(Quaternion { x: qx, y: qy, z: qz, w: qw }),
            }
        });
        let transforms = FrameTransforms { transforms: transforms.collect() };
        self.put(Topic::Transforms, time, &transforms)?;
        for (topic, [x, y]) in [(Topic::Goal, record.goal), (Topic::Subgoal, record.subgoal)] {
            let pose = Some(scene::pose(x, y, 0.0));
            let message = PoseInFrame { timestamp: stamp, frame_id: "world".to_owned(), pose };
            self.put(topic, time, &message)?;
        }
        self.put(Topic::Step, time, &record.message)?;
        self.steps += 1;
        Ok(())
    }

    /// Ends the trace with its metadata and puts it in its place, whole.
    ///
    /// # Errors
    /// What the system or mcap refuses.
    pub fn finish(mut self, mut metadata: BTreeMap<String, String>) -> Result<PathBuf, TraceError> {
        let Some(mut writer) = self.writer.take() else { return Ok(self.path.clone()) };
        metadata.insert("steps".to_owned(), self.steps.to_string());
        let record = Metadata { name: METADATA.to_owned(), metadata };
        let ended = writer.write_metadata(&record).and_then(|()| writer.finish());
        ended.map_err(|error| self.refused(error))?;
        let io = |source| TraceError::Io { path: self.path.display().to_string(), source };
        let file = writer.into_inner().into_inner().map_err(|error| io(error.into_error()))?;
        file.sync_all().map_err(io)?;
        fs::rename(&self.part, &self.path).map_err(io)?;
        Ok(self.path.clone())
    }

    /// Gives the trace up and removes what was written of it.
    pub fn discard(mut self) {
        if let Some(mut writer) = self.writer.take() {
            let _ = writer.finish();
        }
        let _ = fs::remove_file(&self.part);
    }
}

impl Drop for EpisodeWriter {
    /// The file of an episode that was cut off stays a `.part`, closed as far as it goes.
    fn drop(&mut self) {
        if let Some(mut writer) = self.writer.take() {
            let _ = writer.finish();
        }
    }
}
