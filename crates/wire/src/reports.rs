//! Reports to the launcher: status, metrics, results. They may drop and never block; what must
//! arrive (results) is sent again until the launcher's directive says that it did.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;

use crate::WireError;
use crate::bus::{Bus, Ipc};
use crate::records::SnapshotHeader;
use crate::status::{EpisodeResult, Metric, Status};

/// A role's end.
pub struct Reporter {
    status: Publisher<Ipc, [Status], SnapshotHeader>,
    metrics: Publisher<Ipc, [Metric], SnapshotHeader>,
    results: Publisher<Ipc, [EpisodeResult], SnapshotHeader>,
}

impl Reporter {
    /// For a role.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let (status, metrics, results) = (
            bus.report("status")?,
            bus.report("metrics")?,
            bus.report("results")?,
        );
        Ok(Self {
            status: bus.port("status", "get a publisher", || {
                status.publisher_builder().create()
            })?,
            metrics: bus.port("metrics", "get a publisher", || {
                metrics.publisher_builder().create()
            })?,
            results: bus.port("results", "get a publisher", || {
                results.publisher_builder().create()
            })?,
        })
    }

    /// Sends the pulse.
    pub fn status(&self, status: &Status) {
        if let Ok(sample) = self.status.loan_slice_uninit(1) {
            let _ = sample.write_from_fn(|_| *status).send();
        }
    }

    /// Sends a number.
    pub fn metric(&self, metric: &Metric) {
        if let Ok(sample) = self.metrics.loan_slice_uninit(1) {
            let _ = sample.write_from_fn(|_| *metric).send();
        }
    }

    /// Sends an episode's result.
    pub fn result(&self, result: &EpisodeResult) {
        if let Ok(sample) = self.results.loan_slice_uninit(1) {
            let _ = sample.write_from_fn(|_| *result).send();
        }
    }
}

/// The launcher's end.
pub struct ReportReader {
    status: Subscriber<Ipc, [Status], SnapshotHeader>,
    metrics: Subscriber<Ipc, [Metric], SnapshotHeader>,
    results: Subscriber<Ipc, [EpisodeResult], SnapshotHeader>,
}

impl ReportReader {
    /// For the launcher.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let (status, metrics, results) = (
            bus.report("status")?,
            bus.report("metrics")?,
            bus.report("results")?,
        );
        Ok(Self {
            status: bus.port("status", "get a subscriber", || {
                status.subscriber_builder().create()
            })?,
            metrics: bus.port("metrics", "get a subscriber", || {
                metrics.subscriber_builder().create()
            })?,
            results: bus.port("results", "get a subscriber", || {
                results.subscriber_builder().create()
            })?,
        })
    }

    /// All that came since the last call.
    pub fn read(
        &self,
        mut status: impl FnMut(&Status),
        mut metric: impl FnMut(&Metric),
        mut result: impl FnMut(&EpisodeResult),
    ) {
        while let Ok(Some(sample)) = self.status.receive() {
            sample.payload().iter().for_each(&mut status);
        }
        while let Ok(Some(sample)) = self.metrics.receive() {
            sample.payload().iter().for_each(&mut metric);
        }
        while let Ok(Some(sample)) = self.results.receive() {
            sample.payload().iter().for_each(&mut result);
        }
    }
}
