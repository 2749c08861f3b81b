//! Sizes that a run's services are made with, and what they come to.

use crate::records::{Directive, EpisodeResult, LAYOUT, Metric, Reader, Status, Transition};

/// Sizes that a run's services are made with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Actors at a time, attached ones included.
    pub max_actors: usize,
    /// Trajectories that an actor may have unacknowledged.
    pub window: usize,
    /// Transitions of a trajectory, its final row included.
    pub trajectory_steps: usize,
    /// Values of each module's weights, in the order of [`Module::ALL`](crate::Module::ALL); 0 for none.
    pub weights: [usize; 4],
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
            .weights
            .iter()
            .map(|values| values * 4)
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
        let snapshots = self.weights.iter().map(|values| values * 4);
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

    fn trajectory_bytes(&self) -> usize {
        self.trajectory_steps * size_of::<Transition>()
    }

    pub(crate) fn to_text(&self) -> String {
        let weights = self.weights.map(|values| values.to_string()).join(",");
        let readers: Vec<&str> = self.readers.iter().map(|reader| reader.name()).collect();
        format!(
            "layout={LAYOUT}\nmax_actors={}\nwindow={}\ntrajectory_steps={}\nweights={weights}\n\
             graph_bytes={}\nreaders={}\n",
            self.max_actors,
            self.window,
            self.trajectory_steps,
            self.graph_bytes,
            readers.join(","),
        )
    }

    /// Reads [`to_text`](Self::to_text)'s lines: the layout and the limits.
    pub(crate) fn from_text(text: &str) -> Option<(u32, Self)> {
        let value = |key: &str| {
            text.lines()
                .find_map(|line| line.strip_prefix(key)?.strip_prefix('='))
        };
        let number = |key: &str| value(key)?.parse().ok();
        let layout = value("layout")?.parse().ok()?;
        let mut weights = [0; 4];
        for (slot, text) in weights.iter_mut().zip(value("weights")?.split(',')) {
            *slot = text.parse().ok()?;
        }
        let named = |name: &str| Reader::ALL.into_iter().find(|reader| reader.name() == name);
        let limits = Self {
            max_actors: number("max_actors")?,
            window: number("window")?,
            trajectory_steps: number("trajectory_steps")?,
            weights,
            graph_bytes: number("graph_bytes")?,
            readers: value("readers")?.split(',').filter_map(named).collect(),
        };
        Some((layout, limits))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn limits() -> Limits {
        Limits {
            max_actors: 4,
            window: 4,
            trajectory_steps: 65,
            weights: [100, 0, 0, 50],
            graph_bytes: 1000,
            readers: vec![Reader::Learner],
        }
    }

    #[test]
    fn limits_travel_as_text() {
        let mut limits = limits();
        limits.readers = Reader::ALL.to_vec();
        assert_eq!(Limits::from_text(&limits.to_text()), Some((LAYOUT, limits)));
        assert_eq!(Limits::from_text("layout=1\nwindow=x"), None);
    }
}
