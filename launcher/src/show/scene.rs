//! The state of a run that is shown.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use runs::metrics::Newest;
use wire::{Phase, Role, Status};

use crate::record::throughput::Throughput;

/// Newest status of each process, and when it arrived.
pub(crate) type Statuses = BTreeMap<(Role, u32), (Status, Instant)>;

/// A process slot of the run.
pub(crate) struct SlotState {
    pub(crate) role: Role,
    pub(crate) id: u32,
    /// The newest process, also after its end.
    pub(crate) pid: u32,
    pub(crate) is_alive: bool,
    /// Whether another process will be started in place of one that has ended.
    pub(crate) will_restart: bool,
    /// Time since the last status, or since the start.
    pub(crate) silence: Duration,
    pub(crate) restarts: usize,
}

/// The state of a run at one moment.
pub(crate) struct Scene<'r> {
    pub(crate) phase: Phase,
    /// Time that the run has taken (s).
    pub(crate) seconds: f64,
    pub(crate) statuses: &'r Statuses,
    pub(crate) slots: Vec<SlotState>,
    pub(crate) newest: &'r Newest,
    pub(crate) throughput: &'r Throughput,
    /// Successes and episodes of the evaluation so far, if there are any.
    pub(crate) score: Option<(usize, usize)>,
    /// Episodes of the evaluation.
    pub(crate) episodes: usize,
}
