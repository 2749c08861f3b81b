//! Sizes that a run's services are made with, and what they come to.

use simulator::{RowLayout, Spaces};

use crate::directive::Directive;
use crate::reader::Reader;
use crate::records::{LAYOUT, PARTS};
use crate::status::{EpisodeResult, Metric, Status};

/// One of an algorithm's networks, as its weights travel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Its name: lower-case letters, digits and hyphens.
    pub name: String,
    /// Number of its weights.
    pub values: usize,
    /// Whether there may be fewer, as over the nodes of a graph that grows.
    pub grows: bool,
}

impl Part {
    pub(crate) fn service(&self) -> String {
        format!("weights-{}", self.name)
    }

    fn to_text(&self) -> String {
        let size = if self.grows { "most" } else { "exactly" };
        format!("{}:{}:{size}", self.name, self.values)
    }

    fn from_text(text: &str) -> Option<Self> {
        let mut parts = text.split(':');
        let name = parts.next()?;
        let sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        let part = Self {
            name: name.to_owned(),
            values: parts.next()?.parse().ok()?,
            grows: match parts.next()? {
                "most" => true,
                "exactly" => false,
                _ => return None,
            },
        };
        let named = (1..=32).contains(&name.len()) && name.chars().all(sound);
        (named && parts.next().is_none()).then_some(part)
    }
}

/// Sizes that a run's services are made with.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Actors at a time, attached ones included.
    pub max_actors: usize,
    /// Trajectories that an actor may have unacknowledged.
    pub window: usize,
    /// Shapes of what is observed and done.
    pub spaces: Spaces,
    /// Rows of a trajectory, its final row included.
    pub trajectory_rows: usize,
    /// Words of the choices that end in a trajectory.
    pub choice_words: usize,
    /// The algorithm's networks, fewer than [`PARTS`].
    pub parts: Vec<Part>,
    /// Bytes of a graph.
    pub graph_bytes: usize,
    /// Readers that must have every trajectory.
    pub readers: Vec<Reader>,
}

/// Places kept free beyond the processes that are planned: dead ones not yet swept, tools.
pub(crate) const SPARE: usize = 4;
/// A trajectory buffer's places beyond the window: hello, bye.
const BUFFER_SPARE: usize = 4;
/// Loaned, and held by readers, at a time.
pub(crate) const HELD: usize = 2;
const REPORT_BUFFER: usize = 256;

/// Open files of a learner without actors; it has the most of all processes.
const FILES: u64 = 130;
/// Open files of a learner for each actor.
const FILES_OF_AN_ACTOR: u64 = 14;
/// Address space of a learner without its channels and its data set (bytes).
const PROGRAM: u64 = 192 << 20;

/// Places and buffers of a service.
pub(crate) struct Qos {
    pub(crate) publishers: usize,
    pub(crate) subscribers: usize,
    pub(crate) buffer: usize,
    pub(crate) history: usize,
    pub(crate) overflow: bool,
}

impl Qos {
    fn chunks_of_a_publisher(&self) -> u64 {
        (self.subscribers * (self.buffer + HELD) + self.history + HELD) as u64
    }
}

/// Bytes of a chunk: it has a header, and sizes are rounded up to a power of two in the worst case.
fn sized(bytes: usize) -> u64 {
    (bytes as u64 + 256) * 2
}

impl Limits {
    pub(crate) fn processes(&self) -> usize {
        self.max_actors + 3 + SPARE
    }

    pub(crate) fn trajectory_qos(&self) -> Qos {
        Qos {
            publishers: self.max_actors + SPARE,
            subscribers: 2 + SPARE,
            buffer: self.window + BUFFER_SPARE,
            history: 0,
            overflow: false,
        }
    }

    pub(crate) fn latest_qos(&self) -> Qos {
        Qos {
            publishers: 2,
            subscribers: self.processes(),
            // A place for the newest, and one for what is refused.
            buffer: 2,
            history: 1,
            overflow: true,
        }
    }

    pub(crate) fn report_qos(&self) -> Qos {
        Qos {
            publishers: self.processes(),
            subscribers: 2,
            buffer: REPORT_BUFFER,
            history: 0,
            overflow: true,
        }
    }

    /// Shared memory that the run can come to use, every place taken (bytes).
    #[must_use]
    pub fn shared_memory_bytes(&self) -> u64 {
        let chunks = |qos: &Qos| qos.publishers as u64 * qos.chunks_of_a_publisher();
        let latest = self.latest_qos();
        let snapshots: u64 = self
            .parts
            .iter()
            .map(|part| part.values * 4)
            .chain([self.graph_bytes, size_of::<Directive>()])
            .map(|bytes| chunks(&latest) * sized(bytes))
            .sum();
        let reports: u64 = [
            size_of::<Status>(),
            size_of::<Metric>(),
            size_of::<EpisodeResult>(),
        ]
        .into_iter()
        .map(|bytes| chunks(&self.report_qos()) * sized(bytes))
        .sum();
        let trajectories = chunks(&self.trajectory_qos()) * sized(self.trajectory_bytes());
        trajectories + snapshots + reports
    }

    /// Bytes of the largest file that a process makes in shared memory.
    pub(crate) fn largest_segment(&self) -> u64 {
        let of = |qos: &Qos, bytes: usize| qos.chunks_of_a_publisher() * sized(bytes);
        let latest = self.latest_qos();
        let snapshots = self.parts.iter().map(|part| part.values * 4);
        snapshots
            .chain([self.graph_bytes, size_of::<Directive>()])
            .map(|bytes| of(&latest, bytes))
            .chain([
                of(&self.trajectory_qos(), self.trajectory_bytes()),
                of(&self.report_qos(), size_of::<Metric>()),
            ])
            .max()
            .unwrap_or(0)
    }

    /// Open files that a process of the run can come to need, as measured.
    pub(crate) fn open_files(&self) -> u64 {
        FILES + FILES_OF_AN_ACTOR * (self.max_actors + SPARE) as u64
    }

    /// Address space that a process of the run takes at the least (bytes).
    pub(crate) fn address_space(&self) -> u64 {
        PROGRAM + self.shared_memory_bytes()
    }

    /// Words of the longest trajectory.
    pub(crate) fn trajectory_words(&self) -> usize {
        self.trajectory_rows * RowLayout::new(&self.spaces).stride() + self.choice_words
    }

    fn trajectory_bytes(&self) -> usize {
        self.trajectory_words() * size_of::<u32>()
    }

    pub(crate) fn to_text(&self) -> String {
        let parts: Vec<String> = self.parts.iter().map(Part::to_text).collect();
        let readers: Vec<&str> = self.readers.iter().map(|reader| reader.name()).collect();
        format!(
            "layout={LAYOUT}\nmax_actors={}\nwindow={}\nspaces={}\ntrajectory_rows={}\n\
             choice_words={}\nparts={}\ngraph_bytes={}\nreaders={}\n",
            self.max_actors,
            self.window,
            self.spaces,
            self.trajectory_rows,
            self.choice_words,
            parts.join(","),
            self.graph_bytes,
            readers.join(","),
        )
    }

    /// Reads [`to_text`](Self::to_text)'s lines: the layout, and the limits where they are of this one.
    pub(crate) fn from_text(text: &str) -> Option<(u32, Option<Self>)> {
        let value = |key: &str| {
            text.lines()
                .find_map(|line| line.strip_prefix(key)?.strip_prefix('='))
        };
        let layout = value("layout")?.parse().ok()?;
        let list = |key| value(key).map(|list| list.split(',').filter(|item| !item.is_empty()));
        let number = |key| value(key)?.parse().ok();
        let named = |name: &str| Reader::ALL.into_iter().find(|reader| reader.name() == name);
        let read = || {
            let parts: Vec<Part> = list("parts")?.map(Part::from_text).collect::<Option<_>>()?;
            let limits = Self {
                max_actors: number("max_actors")?,
                window: number("window")?,
                spaces: Spaces::parse(value("spaces")?).ok()?,
                trajectory_rows: number("trajectory_rows")?,
                choice_words: number("choice_words")?,
                parts,
                graph_bytes: number("graph_bytes")?,
                readers: list("readers")?.filter_map(named).collect(),
            };
            (limits.parts.len() < PARTS).then_some(limits)
        };
        Some((layout, read()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use simulator::Space;

    use super::*;

    fn part(name: &str, values: usize, grows: bool) -> Part {
        Part {
            name: name.to_owned(),
            values,
            grows,
        }
    }

    pub(crate) fn limits() -> Limits {
        Limits {
            max_actors: 4,
            window: 4,
            spaces: Spaces {
                observation: Space::vector(4),
                action: Space::vector(2),
                goal: 2,
                control_seconds: 0.1,
            },
            trajectory_rows: 65,
            choice_words: 8,
            parts: vec![part("encoder", 100, false), part("high", 50, true)],
            graph_bytes: 1000,
            readers: vec![Reader::Learner],
        }
    }

    #[test]
    fn limits_travel_as_text() {
        let mut limits = limits();
        limits.readers = Reader::ALL.to_vec();
        let text = limits.to_text();
        assert_eq!(
            Limits::from_text(&text),
            Some((LAYOUT, Some(limits.clone())))
        );
        for (from, to) in [
            ("encoder", "En coder"),
            (":exactly", ":about"),
            ("f32:4", "f32:0"),
            ("window=4", "window=-1"),
        ] {
            let text = text.replace(from, to);
            assert_eq!(Limits::from_text(&text), Some((LAYOUT, None)), "{to}");
        }
        assert_eq!(Limits::from_text("layout=1\nwindow=x"), Some((1, None)));
        limits.parts.clear();
        let text = limits.to_text();
        assert_eq!(Limits::from_text(&text), Some((LAYOUT, Some(limits))));
    }
}
