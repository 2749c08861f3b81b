//! What the main thread asks of a stage's thread, through a bounded queue.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};

use agents::Rollout;
use graph::Graph;
use wire::{GRAPH, OwnedTrajectory};

/// A rollout on its way to a stage.
#[derive(Debug, Clone)]
pub(crate) struct OwnedRollout {
    pub(crate) trajectory: OwnedTrajectory,
    /// Structure of the graph that was acted on, 0 where it is not known any more.
    pub(crate) structure: u64,
}

impl OwnedRollout {
    pub(crate) fn view(&self) -> Rollout<'_> {
        let header = &self.trajectory.header;
        let view = self.trajectory.view();
        Rollout {
            rows: view.rows,
            choices: view.choices,
            graph_version: header.versions[GRAPH],
            structure: self.structure,
            episode: header.name(),
        }
    }
}

/// What a stage's thread is asked to do.
#[derive(Clone)]
pub(crate) enum Command {
    /// Go on with a newer version of the graph.
    Graph(Arc<Graph>),
    /// Learn from a rollout.
    Rollout(Arc<OwnedRollout>),
    /// Learn from the rollouts of a round, and go on with the graph after it.
    Round(Arc<Vec<OwnedRollout>>, Option<Arc<Graph>>),
    /// End on the final graph.
    Settle(Option<Arc<Graph>>),
}

/// Commands that wait for a stage; when there are more, actors wait.
const WAITING: usize = 256;

/// Bounded queue to a stage. While it is full, no trajectories are received, and actors wait in turn.
pub(crate) struct CommandQueue {
    sender: SyncSender<Command>,
    backlog: VecDeque<Command>,
}

impl CommandQueue {
    pub(crate) fn new() -> (Self, Receiver<Command>) {
        let (sender, receiver) = mpsc::sync_channel(WAITING);
        let backlog = VecDeque::new();
        (Self { sender, backlog }, receiver)
    }

    pub(crate) fn push(&mut self, command: Command) {
        self.backlog.push_back(command);
        self.flush();
    }

    /// Returns whether all commands have been sent.
    pub(crate) fn flush(&mut self) -> bool {
        while let Some(command) = self.backlog.pop_front() {
            if let Err(TrySendError::Full(command)) = self.sender.try_send(command) {
                self.backlog.push_front(command);
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_beyond_the_bound_wait_and_keep_their_order() {
        let (mut queue, receiver) = CommandQueue::new();
        for version in 0..WAITING as u64 + 3 {
            let graph = Graph {
                version,
                ids: vec![],
                latent_dim: 1,
                latents: vec![],
                places: vec![],
                offsets: vec![0],
                edges: vec![],
                mean_edge_steps: 1.0,
            };
            queue.push(Command::Graph(Arc::new(graph)));
        }
        assert!(!queue.flush());
        for expected in 0..WAITING as u64 + 3 {
            queue.flush();
            let Ok(Command::Graph(graph)) = receiver.try_recv() else {
                panic!("nothing came");
            };
            assert_eq!(graph.version, expected);
        }
        assert!(queue.flush());
        // A stage that has ended takes nothing any more, and holds nobody up.
        drop(receiver);
        queue.push(Command::Settle(None));
        assert!(queue.flush());
    }
}
