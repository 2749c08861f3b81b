//! The offline run: stages 1, 3a and 3b, each on its thread, and the channels.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::Scope;
use std::time::{Duration, Instant};

use agents::high::Choice;
use agents::ppo::End;
use anyhow::Context;
use config::Config;
use dataset::Dataset;
use graph::Graph;
use wire::{
    Bus, DirectiveSubscriber, GraphSubscriber, Metric, Module, Phase, Reader, Reporter, Role,
    State, Status, TrajectoryReceiver, Transition, WeightsPublisher, flags,
};

use crate::high::{self, Word};
use crate::{encoder, low, save};

/// What a training thread has to tell.
pub(crate) enum News {
    Metric {
        name: &'static str,
        step: u64,
        value: f32,
    },
    Progress {
        stage: &'static str,
        done: u64,
        total: u64,
    },
    Encoder(Vec<f32>),
    Low {
        weights: Vec<f32>,
        last: bool,
    },
    High {
        weights: Vec<f32>,
        last: bool,
    },
    Failed(anyhow::Error),
}

/// A training thread's way to tell it.
pub(crate) struct Post<'s> {
    sender: Sender<News>,
    stop: &'s AtomicBool,
}

impl Post<'_> {
    pub(crate) fn send(&self, news: News) {
        // Nobody hears it only when the process ends.
        let _ = self.sender.send(news);
    }

    pub(crate) fn metric(&self, name: &'static str, step: u64, value: f32) {
        self.send(News::Metric { name, step, value });
    }

    pub(crate) fn progress(&self, stage: &'static str, done: u64, total: u64) {
        self.send(News::Progress { stage, done, total });
    }

    pub(crate) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a stage on its thread; its failure is news.
fn spawn<'s>(
    scope: &'s Scope<'s, '_>,
    sender: &Sender<News>,
    stop: &'s AtomicBool,
    stage: impl FnOnce(&Post<'s>) -> anyhow::Result<()> + Send + 's,
) {
    let post = Post {
        sender: sender.clone(),
        stop,
    };
    scope.spawn(move || {
        if let Err(error) = stage(&post) {
            post.send(News::Failed(error));
        }
    });
}

/// The choices of a trajectory, and the node after the last; what was not settled is left out.
fn choices(record: &[Transition], config: &Config) -> (Vec<Choice>, u32) {
    let mut found: Vec<Choice> = vec![];
    let mut open: Option<(&Transition, usize)> = None;
    let mut last = None;
    for (t, step) in record.iter().enumerate() {
        let settled = step.has(flags::REACHED | flags::FAILED);
        if let Some((start, at)) = open.filter(|_| settled || step.has(flags::SUCCESS)) {
            let arrived = step.has(flags::SUCCESS) || step.node == start.goal_node;
            // The same scale as on the graph: an edge of the lag's length costs one edge.
            let cost = config.high.edge_cost * (t - at) as f64 / config.graph.lag as f64;
            let gain = if arrived {
                config.high.arrival_reward
            } else {
                0.0
            };
            found.push(Choice {
                node: start.node.max(0) as u32,
                goal: start.goal_node.max(0) as u32,
                subgoal: start.subgoal.max(0) as u32,
                log_prob: start.log_prob,
                reward: (gain - cost) as f32,
                end: if arrived { End::Terminal } else { End::Not },
            });
            last = u32::try_from(step.node).ok();
            open = None;
            if arrived {
                break;
            }
        }
        if step.has(flags::CHOICE) && step.node >= 0 && step.subgoal >= 0 && step.goal_node >= 0 {
            open = Some((step, t));
        }
    }
    if let Some(end) = found.last_mut().filter(|choice| choice.end == End::Not) {
        end.end = End::Truncated;
    }
    (found, last.unwrap_or(0))
}

struct Learner<'c> {
    config: &'c Config,
    folder: &'c Path,
    receiver: TrajectoryReceiver,
    publishers: [WeightsPublisher; 3],
    graphs: GraphSubscriber,
    directives: DirectiveSubscriber,
    reporter: Reporter,
    status: Status,
    encoder: Option<Vec<f32>>,
    /// Versions of encoder, low and high.
    versions: [u64; 3],
    trained: [bool; 2],
    newest: [Vec<f32>; 2],
    progress: [[u64; 2]; 3],
    frozen: bool,
}

pub(crate) fn run(
    config: &Config,
    folder: &Path,
    bus: &Bus,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let reporter = Reporter::new(bus)?;
    let mut status = Status {
        role: Role::Learner as u32,
        ..Status::default()
    };
    status.set_text("loading the data set");
    reporter.status(&status);
    let mut learner = Learner {
        config,
        folder,
        receiver: TrajectoryReceiver::new(bus, Reader::Learner)?,
        publishers: [
            WeightsPublisher::new(bus, Module::Encoder)?,
            WeightsPublisher::new(bus, Module::Low)?,
            WeightsPublisher::new(bus, Module::High)?,
        ],
        graphs: GraphSubscriber::new(bus)?,
        directives: DirectiveSubscriber::new(bus)?,
        reporter,
        status,
        encoder: None,
        versions: [0; 3],
        trained: [false; 2],
        newest: [vec![], vec![]],
        progress: [[0; 2]; 3],
        frozen: false,
    };
    let data = Dataset::open(Path::new(&config.dataset))?;
    let halt = AtomicBool::new(false);
    let result = std::thread::scope(|scope| {
        let result = learner.work(scope, &data, &halt, stop);
        halt.store(true, Ordering::Relaxed);
        result
    });
    result?;
    learner.finish();
    Ok(())
}

impl<'c> Learner<'c> {
    fn work<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        data: &'s Dataset,
        halt: &'s AtomicBool,
        stop: &AtomicBool,
    ) -> anyhow::Result<()>
    where
        'c: 's,
    {
        let (sender, news): (Sender<News>, Receiver<News>) = mpsc::channel();
        let (words, ears) = mpsc::channel();
        let mut ears = Some(ears);
        let config = self.config;
        spawn(scope, &sender, halt, move |post| {
            encoder::train(config, data, post)
        });
        self.status.state = State::Working as u32;
        let mut pulse = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let phase = self.directives.latest().phase();
            if phase != Phase::Train && !self.frozen {
                self.frozen = true;
                let _ = words.send(Word::Freeze);
                self.checkpoint()?;
            }
            let frozen = self.frozen;
            self.receiver.receive(16, |_, record| {
                if !frozen {
                    let (choices, last) = choices(record, config);
                    if !choices.is_empty() {
                        let _ = words.send(Word::Rollout(choices, last));
                    }
                }
            });
            self.receiver.acknowledge();
            self.publishers
                .iter()
                .for_each(WeightsPublisher::keep_alive);
            while let Ok(told) = news.try_recv() {
                self.hear(told)?;
            }
            if let Some((_, bytes)) = self.graphs.latest() {
                let graph = Graph::from_bytes(&bytes).context("the graph that was published")?;
                self.status.versions[2] = graph.version;
                if let (Some(ears), Some(encoder)) = (ears.take(), &self.encoder) {
                    let (own, encoder) = (graph.clone(), encoder.clone());
                    spawn(scope, &sender, halt, move |post| {
                        low::train(config, data, &own, &encoder, post)
                    });
                    spawn(scope, &sender, halt, move |post| {
                        high::train(config, graph, &ears, post)
                    });
                } else {
                    let _ = words.send(Word::Graph(Box::new(graph)));
                }
            }
            if pulse.elapsed() > Duration::from_millis(500) {
                self.pulse();
                pulse = Instant::now();
            }
            if phase == Phase::Finish && self.receiver.all_left() {
                return Ok(());
            }
            self.receiver.wait(Duration::from_millis(50));
        }
        Ok(())
    }

    fn hear(&mut self, news: News) -> anyhow::Result<()> {
        match news {
            News::Metric { name, step, value } => {
                let value = f64::from(value);
                self.reporter
                    .metric(&Metric::new(Role::Learner, 0, name, step, value));
            }
            News::Progress { stage, done, total } => {
                let at = match stage {
                    "encoder" => 0,
                    "low" => 1,
                    _ => 2,
                };
                self.progress[at] = [done, total];
            }
            News::Encoder(weights) => {
                self.publish(0, &weights)?;
                save::module(self.folder, "encoder", self.config, 1, &weights)?;
                self.encoder = Some(weights);
            }
            News::Low { weights, last } => {
                self.trained[0] |= last;
                self.publish(1, &weights)?;
                self.newest[0] = weights;
            }
            News::High { weights, last } if !self.frozen => {
                self.trained[1] |= last;
                self.publish(2, &weights)?;
                self.newest[1] = weights;
            }
            News::High { .. } => {}
            News::Failed(error) => return Err(error),
        }
        Ok(())
    }

    fn publish(&mut self, module: usize, weights: &[f32]) -> anyhow::Result<()> {
        self.versions[module] += 1;
        self.publishers[module].publish(self.versions[module], 0, weights)?;
        Ok(())
    }

    fn checkpoint(&self) -> anyhow::Result<()> {
        for (name, weights, version) in [
            ("low", &self.newest[0], self.versions[1]),
            ("high", &self.newest[1], self.versions[2]),
        ] {
            if !weights.is_empty() {
                save::module(self.folder, name, self.config, version, weights)?;
            }
        }
        Ok(())
    }

    fn pulse(&mut self) {
        let share = |[done, total]: [u64; 2]| 100 * done / total.max(1);
        let [encoder, low, high] = self.progress.map(share);
        let text = if self.encoder.is_none() {
            format!("encoder {encoder}%")
        } else if self.status.versions[2] == 0 {
            "waits for the graph".to_owned()
        } else {
            format!("low {low}%, high {high}%")
        };
        let s = &mut self.status;
        s.set_text(&text);
        let trained = self.trained == [true; 2];
        s.state = if trained {
            State::Trained
        } else {
            State::Working
        } as u32;
        self.receiver.report(s);
        s.updates = self.progress[1][0];
        s.versions[..2].copy_from_slice(&self.versions[1..]);
        self.reporter.status(s);
    }

    fn finish(&mut self) {
        self.pulse();
        self.status.state = State::Finished as u32;
        self.reporter.status(&self.status);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> Config {
        let text = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";
        Config::parse(text, "x.toml", "x", &[]).unwrap()
    }

    #[test]
    fn choices_are_settled_one_by_one_and_the_last_open_one_is_left_out() {
        let step = |node, subgoal, flags| Transition {
            node,
            subgoal,
            goal_node: 9,
            log_prob: -0.5,
            flags,
            ..Transition::default()
        };
        let record = [
            step(1, 2, flags::CHOICE),
            step(1, 2, 0),
            step(2, 3, flags::REACHED | flags::CHOICE),
            step(2, 3, 0),
            step(2, 4, flags::FAILED | flags::CHOICE),
        ];
        let (found, last) = choices(&record, &config());
        let ends: Vec<_> = found.iter().map(|c| (c.node, c.subgoal, c.end)).collect();
        assert_eq!(ends, [(1, 2, End::Not), (2, 3, End::Truncated)]);
        assert_eq!(last, 2);
        assert!((found[0].reward + 0.02 * 2.0 / 15.0).abs() < 1e-6);

        let record = [step(1, 2, flags::CHOICE), step(9, 2, flags::REACHED)];
        let (found, last) = choices(&record, &config());
        assert_eq!((found[0].end, last), (End::Terminal, 9));
        assert!(found[0].reward > 0.9);
    }
}
