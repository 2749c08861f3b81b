//! The stages of the run's algorithm, as the main thread sees them.

use agents::{Parts, Plan, Progress, StageSpec};
use wire::{State, Status};

use crate::commands::{Command, CommandQueue};

/// One stage.
struct Entry {
    spec: StageSpec,
    progress: Progress,
    /// To its thread, once it has one.
    queue: Option<CommandQueue>,
    done: bool,
    settled: bool,
}

/// All stages.
pub(crate) struct Stages(Vec<Entry>);

impl Stages {
    pub(crate) fn new(plan: &dyn Plan) -> Self {
        let entry = |spec| Entry {
            spec,
            progress: Progress::default(),
            queue: None,
            done: false,
            settled: false,
        };
        Self(plan.stages().into_iter().map(entry).collect())
    }

    /// Stages that can begin with these parts and have not begun, by number.
    pub(crate) fn ready(&self, parts: &Parts) -> Vec<(usize, StageSpec)> {
        let ready = |entry: &Entry| {
            let after = &entry.spec.after;
            entry.queue.is_none()
                && after
                    .iter()
                    .all(|network| parts.weights(*network).is_some())
                && (!entry.spec.needs_graph || parts.graph().is_some())
        };
        let numbered = self.0.iter().enumerate();
        numbered
            .filter(|(_, entry)| ready(entry))
            .map(|(number, entry)| (number, entry.spec.clone()))
            .collect()
    }

    pub(crate) fn begin(&mut self, stage: usize, queue: CommandQueue) {
        self.0[stage].queue = Some(queue);
    }

    /// Sends a command to every stage that goes on learning.
    pub(crate) fn push(&mut self, command: &Command) {
        let online = self.0.iter_mut().filter(|entry| entry.spec.online);
        for queue in online.filter_map(|entry| entry.queue.as_mut()) {
            queue.push(command.clone());
        }
    }

    /// Returns whether every command has been sent.
    pub(crate) fn flush(&mut self) -> bool {
        let queues = self.0.iter_mut().filter_map(|entry| entry.queue.as_mut());
        let mut sent = true;
        for queue in queues {
            sent &= queue.flush();
        }
        sent
    }

    pub(crate) fn set_progress(&mut self, stage: usize, progress: Progress) {
        self.0[stage].progress = progress;
    }

    pub(crate) fn set_done(&mut self, stage: usize) {
        self.0[stage].done = true;
    }

    pub(crate) fn set_settled(&mut self, stage: usize) {
        let entry = &mut self.0[stage];
        (entry.done, entry.settled) = (true, true);
    }

    pub(crate) fn is_online(&self, stage: usize) -> bool {
        self.0[stage].spec.online
    }

    /// Whether a stage goes on learning from rollouts.
    pub(crate) fn any_online(&self) -> bool {
        self.0.iter().any(|entry| entry.spec.online)
    }

    pub(crate) fn all_done(&self) -> bool {
        self.0.iter().all(|entry| entry.done)
    }

    pub(crate) fn all_settled(&self) -> bool {
        self.0.iter().all(|entry| entry.settled)
    }

    /// Writes what is being done into the status.
    pub(crate) fn describe(&self, status: &mut Status) {
        let begun = || self.0.iter().filter(|entry| entry.queue.is_some());
        let share = |entry: &Entry| 100 * entry.progress.done / entry.progress.total.max(1);
        let running: Vec<&Entry> = begun().filter(|entry| !entry.done).collect();
        let waiting = running.is_empty() && begun().count() < self.0.len();
        let shown: Vec<&Entry> = match running.is_empty() {
            // The longest stages are the last.
            true => begun().filter(|entry| entry.progress.total > 0).collect(),
            false => running,
        };
        let parts = shown
            .iter()
            .map(|entry| format!("{} {}%", entry.spec.name, share(entry)));
        let text: Vec<String> = parts.collect();
        status.set_text(&match waiting {
            true => "waits for the graph".to_owned(),
            false => text.join(", "),
        });
        // Of all that run, the one that has most before it.
        let furthest = shown.into_iter().filter(|entry| entry.progress.total > 0);
        if let Some(entry) = furthest.min_by_key(|entry| share(entry)) {
            status.progress = [entry.progress.done, entry.progress.total];
        }
        status.state = if waiting {
            State::Waiting
        } else if self.all_settled() {
            State::Settled
        } else if self.all_done() {
            State::Trained
        } else {
            State::Working
        } as u32;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use agents::Weights;

    use super::*;

    fn plan() -> Box<dyn Plan> {
        let text = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";
        let config = agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap();
        agents::plan(&config).unwrap()
    }

    #[test]
    fn a_stage_begins_once_all_that_it_needs_is_there() {
        let plan = plan();
        let mut stages = Stages::new(&*plan);
        let mut parts = Parts::new(plan.networks().len());
        let names = |stages: &Stages, parts: &Parts| {
            let ready = stages.ready(parts).into_iter();
            ready.map(|(_, spec)| spec.name).collect::<Vec<_>>()
        };
        let mut status = Status::default();
        assert_eq!(names(&stages, &parts), ["encoder"]);
        stages.begin(0, CommandQueue::new().0);
        stages.set_progress(0, Progress { done: 5, total: 10 });
        stages.describe(&mut status);
        assert_eq!(
            (status.text().as_str(), status.progress),
            ("encoder 50%", [5, 10])
        );
        assert!(names(&stages, &parts).is_empty());
        stages.set_settled(0);
        stages.describe(&mut status);
        assert_eq!(status.text(), "waits for the graph");
        assert_eq!(status.state, State::Waiting as u32);
        let weights = Weights {
            version: 1,
            structure: 0,
            values: Arc::new([]),
        };
        parts.set_weights(0, weights);
        assert!(names(&stages, &parts).is_empty(), "the graph is missing");
        assert!(!stages.all_done() && stages.any_online());
    }
}
