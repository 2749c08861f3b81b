//! Plays traces over Foxglove's own protocol, on loopback, at the speed of the simulated world. It
//! reads what was recorded, so that nobody who looks on slows a simulation.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foxglove::{
    ChannelBuilder, Context, PartialMetadata, RawChannel, WebSocketServer, WebSocketServerHandle,
};
use mcap::records::{MessageHeader, Record, op};

use crate::TraceError;
use crate::read::{damaged, open, refused, scanned};
use crate::scan::{Stop, Visit};
use crate::topic::Topic;

/// What stands still is told again so often, for those who come late.
const AGAIN: Duration = Duration::from_secs(1);
/// Longest sleep without a look at whether to stop.
const LOOK: Duration = Duration::from_millis(50);

/// A server that any Foxglove or Lichtblick on this machine connects to.
pub struct Server {
    handle: WebSocketServerHandle,
    /// Channels live as long as it does.
    _context: Arc<Context>,
    channels: Vec<Arc<RawChannel>>,
}

/// A message of a trace: its topic, time (ns) and bytes.
struct Timed(usize, u64, Vec<u8>);

impl Server {
    /// Listens on 127.0.0.1; port 0 takes any that is free.
    ///
    /// # Errors
    /// A port that is taken.
    pub fn start(port: u16) -> Result<Self, TraceError> {
        let refused = |error: foxglove::FoxgloveError| TraceError::Io {
            path: format!("127.0.0.1:{port}"),
            source: std::io::Error::other(error),
        };
        let context = Context::new();
        let handle = WebSocketServer::new()
            .name(concat!("formica ", env!("CARGO_PKG_VERSION")))
            .context(&context)
            .bind("127.0.0.1", port)
            .start_blocking()
            .map_err(refused)?;
        let channel = |topic: Topic| {
            ChannelBuilder::new(topic.name())
                .context(&context)
                .message_encoding("protobuf")
                .schema(topic.schema())
                .build_raw()
        };
        let channels: Result<_, _> = Topic::ALL.into_iter().map(channel).collect();
        Ok(Self {
            handle,
            _context: context,
            channels: channels.map_err(refused)?,
        })
    }

    /// The port.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.handle.port()
    }

    /// Plays a trace from its start to its end, `speed` times as fast as it was simulated to be,
    /// unless `stopped` says so before.
    ///
    /// # Errors
    /// A trace that cannot be read.
    pub fn play(
        &self,
        path: &Path,
        speed: f64,
        stopped: &dyn Fn() -> bool,
    ) -> Result<(), TraceError> {
        let messages = messages(path)?;
        let Some(Timed(_, first, _)) = messages.first() else {
            return Ok(());
        };
        let first = *first;
        // Time may go back from one trace to the next.
        self.handle.clear_session(None);
        let mut counts = [0; Topic::ALL.len()];
        messages
            .iter()
            .for_each(|Timed(topic, ..)| counts[*topic] += 1);
        let once = |topic: usize| counts[topic] == 1 && Topic::ALL[topic] != Topic::End;
        let start = Instant::now();
        let mut told = start;
        for Timed(topic, time, data) in &messages {
            let due = start + Duration::from_nanos(time - first).div_f64(speed);
            loop {
                if stopped() {
                    return Ok(());
                }
                let now = Instant::now();
                if now >= told + AGAIN {
                    let still = messages.iter().filter(|Timed(topic, ..)| once(*topic));
                    still.for_each(|Timed(topic, _, data)| self.tell(*topic, *time, data));
                    told = now;
                }
                if now >= due {
                    break;
                }
                std::thread::sleep(LOOK.min(due - now));
            }
            self.tell(*topic, *time, data);
        }
        Ok(())
    }

    fn tell(&self, topic: usize, time: u64, data: &[u8]) {
        if let Some(channel) = self.channels.get(topic) {
            channel.log_with_meta(data, PartialMetadata::with_log_time(time));
        }
    }

    /// Ends all connections.
    pub fn stop(self) {
        self.handle.stop().wait_blocking();
    }
}

/// Bound on the messages of a trace that is played (bytes).
const MOST: u64 = 1 << 30;

/// The messages of a trace in the order of time, of topics that this version knows.
fn messages(path: &Path) -> Result<Vec<Timed>, TraceError> {
    let mut scan = scanned(path, open(path)?)?;
    let topics = scan.channels.iter().filter_map(|(id, channel)| {
        let topic = Topic::of(channel, &scan.schemas)?;
        Some((*id, topic as usize))
    });
    let mut known = Known {
        topics: topics.collect(),
        messages: vec![],
        bytes: 0,
    };
    match scan.visit(&mut known) {
        Ok(()) => {}
        Err(Stop::Io(error)) => return Err(refused(path, error)),
        Err(Stop::Visitor(reason)) => return Err(damaged(path, reason)),
    }
    // Where time does not tell them apart, the file's order stays.
    known.messages.sort_by_key(|Timed(_, time, _)| *time);
    Ok(known.messages)
}

struct Known {
    topics: BTreeMap<u16, usize>,
    messages: Vec<Timed>,
    bytes: u64,
}

impl Visit for Known {
    type Error = String;

    fn wants(&self, opcode: u8, channel: u16, _: u64) -> bool {
        opcode == op::MESSAGE && self.topics.contains_key(&channel)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), String> {
        if let Some(topic) = self.topics.get(&header.channel_id) {
            self.bytes += data.len() as u64;
            if self.bytes > MOST {
                return Err(format!(
                    "its messages are over {MOST} bytes, more than is played"
                ));
            }
            self.messages
                .push(Timed(*topic, header.log_time, data.to_vec()));
        }
        Ok(())
    }

    fn record(&mut self, _: Record<'_>) -> Result<(), String> {
        Ok(())
    }
}
