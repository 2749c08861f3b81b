//! A stage on its thread: updates, commands, checkpoints.

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::thread::Scope;
use std::time::{Duration, Instant};

use agents::{Inputs, Metrics, Parts, Plan, Progress, Publication, Stage, StageSpec};
use config::Config;
use dataset::Dataset;
use graph::Graph;
use serde::{Deserialize, Serialize};

use crate::commands::Command;
use crate::save::Keeper;

/// What a stage's thread reports. Stages are counted as in the plan.
pub(crate) enum StageEvent {
    /// Values of metrics.
    Metrics(Metrics),
    /// How far it is.
    Progress { stage: usize, progress: Progress },
    /// Weights to publish.
    Published {
        stage: usize,
        publications: Vec<Publication>,
        /// Rounds learned from.
        rounds: u32,
        /// Whether the planned updates are done.
        done: bool,
    },
    /// No more weights will come.
    Settled { stage: usize },
    /// It cannot go on.
    Failed(anyhow::Error),
}

/// A stage's way to report and to keep its state.
pub(crate) struct StageContext<'s> {
    pub(crate) sender: Sender<StageEvent>,
    pub(crate) stop: &'s AtomicBool,
    pub(crate) folder: &'s Path,
    pub(crate) config: &'s Config,
    /// States of more rounds are not continued from.
    pub(crate) rounds: u32,
    /// The thread came to its end, or said why not.
    pub(crate) ended: Cell<bool>,
}

impl Drop for StageContext<'_> {
    fn drop(&mut self) {
        if !self.ended.get() {
            let error = anyhow::anyhow!("a thread of the learner panicked");
            self.send(StageEvent::Failed(error));
        }
    }
}

impl StageContext<'_> {
    fn send(&self, event: StageEvent) {
        // The receiver is gone only when the process ends.
        let _ = self.sender.send(event);
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// What a stage begins with.
pub(crate) struct Start<'s> {
    pub(crate) plan: &'s dyn Plan,
    pub(crate) number: usize,
    pub(crate) spec: StageSpec,
    pub(crate) data: Arc<Dataset>,
    pub(crate) parts: Parts,
    pub(crate) commands: Receiver<Command>,
}

/// Runs a stage on a thread; its failure is an event.
pub(crate) fn spawn<'s>(scope: &'s Scope<'s, '_>, start: Start<'s>, context: StageContext<'s>) {
    scope.spawn(move || {
        let result = Trainer::new(start, &context).and_then(Trainer::run);
        context.ended.set(true);
        if let Err(error) = result {
            context.send(StageEvent::Failed(error));
        }
    });
}

/// What is kept of a stage.
#[derive(Serialize, Deserialize)]
struct Kept {
    state: Vec<u8>,
    seconds: f32,
    /// The weights are final.
    settled: bool,
}

struct Trainer<'t, 's> {
    context: &'t StageContext<'s>,
    number: usize,
    spec: StageSpec,
    stage: Box<dyn Stage>,
    commands: Receiver<Command>,
    keeper: Keeper,
    metrics: Metrics,
    began: Instant,
    /// Time of the training before this process (s).
    earlier: f32,
    settled: bool,
}

impl<'t, 's> Trainer<'t, 's> {
    /// From the inputs, or from where the newest state was.
    fn new(start: Start<'_>, context: &'t StageContext<'s>) -> anyhow::Result<Self> {
        let began = Instant::now();
        let name = start.spec.name;
        let (keeper, kept) =
            Keeper::open::<Kept>(context.folder, name, context.config, context.rounds);
        let inputs = Inputs {
            data: &start.data,
            folder: context.folder,
            parts: &start.parts,
            in_rounds: context.config.run.deterministic,
        };
        let saved = kept.as_ref().map(|kept| kept.state.as_slice());
        let stage = start.plan.start(start.number, &inputs, saved)?;
        let kept = kept.filter(|_| stage.updates() > 0);
        Ok(Self {
            context,
            number: start.number,
            spec: start.spec,
            stage,
            commands: start.commands,
            keeper,
            metrics: Metrics::default(),
            began,
            earlier: kept.as_ref().map_or(0.0, |kept| kept.seconds),
            settled: kept.is_some_and(|kept| kept.settled),
        })
    }

    fn run(mut self) -> anyhow::Result<()> {
        self.publish();
        let mut settle: Option<Option<Arc<Graph>>> = None;
        while !self.settled && (self.spec.online || !self.stage.is_done()) {
            self.obey(&mut settle);
            if self.context.stopped() {
                self.keep();
                return Ok(());
            }
            if self.stage.is_done()
                && let Some(graph) = settle.take()
            {
                self.stage.settle(graph.as_ref(), &mut self.metrics);
                self.settled = true;
                self.keep();
                self.publish();
            } else if !self.stage.is_idle() {
                self.update();
            }
        }
        self.context
            .send(StageEvent::Settled { stage: self.number });
        Ok(())
    }

    /// Carries out the commands that wait. Without work to do, the next one is waited for.
    fn obey(&mut self, settle: &mut Option<Option<Arc<Graph>>>) {
        let mut command = if self.stage.is_idle() && settle.is_none() {
            self.commands.recv_timeout(Duration::from_millis(200)).ok()
        } else {
            self.commands.try_recv().ok()
        };
        while let Some(next) = command {
            match next {
                Command::Graph(graph) => self.stage.adopt(&graph),
                Command::Rollout(rollout) => self.stage.learn(&rollout.view()),
                Command::Round(rollouts, graph) => {
                    for rollout in rollouts.iter() {
                        self.stage.learn(&rollout.view());
                    }
                    self.stage.end_round(graph.as_ref(), &mut self.metrics);
                    self.keep();
                    self.publish();
                }
                Command::Settle(graph) => *settle = Some(graph),
            }
            command = self.commands.try_recv().ok();
        }
    }

    /// One update more, and what goes with it.
    fn update(&mut self) {
        let before = self.stage.is_done();
        let publish = self.stage.update(&mut self.metrics);
        let finished = !before && self.stage.is_done();
        if finished {
            self.stage.measure(&mut self.metrics);
            let step = self.stage.progress().done;
            self.metrics.add(self.spec.time, step, self.seconds());
        }
        // The state is written before the stage is reported to be done.
        if finished || self.keeper.is_due() {
            self.keep();
        }
        if publish {
            self.publish();
        } else if !self.metrics.0.is_empty() {
            self.report();
        }
    }

    fn seconds(&self) -> f32 {
        self.earlier + self.began.elapsed().as_secs_f32()
    }

    fn keep(&mut self) {
        let kept = Kept {
            state: self.stage.save(),
            seconds: self.seconds(),
            settled: self.settled,
        };
        // What is settled has as many updates as before, and a number of its own.
        let number = 2 * self.stage.updates() + u64::from(self.settled);
        self.keeper.keep(number, self.stage.rounds(), &kept);
    }

    fn report(&mut self) {
        let metrics = std::mem::take(&mut self.metrics);
        if !metrics.0.is_empty() {
            self.context.send(StageEvent::Metrics(metrics));
        }
        self.context.send(StageEvent::Progress {
            stage: self.number,
            progress: self.stage.progress(),
        });
    }

    /// Publishes weights that were trained.
    fn publish(&mut self) {
        self.report();
        let mut publications = self.stage.publications();
        publications.retain(|publication| publication.version > 0);
        if !publications.is_empty() {
            self.context.send(StageEvent::Published {
                stage: self.number,
                publications,
                rounds: self.stage.rounds(),
                done: self.stage.is_done(),
            });
        }
    }
}
