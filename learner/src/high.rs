//! Stage 3b on a thread: the high level, on the graph and from rollouts.

use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use agents::high::{High, Settings, Settled};
use agents::navigator::Patience;
use agents::ppo;
use config::Config;
use graph::Graph;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::offline::{News, Post};

/// Updates between two publications.
const PUBLISH: u64 = 10;
/// Pairs of nodes that the quality is measured over.
const PAIRS: usize = 400;
/// Updates with each new version of the graph, once the planned steps are done.
const REFRESH: usize = 4;
/// And where the version has other nodes: new ones have everything to learn.
const RELEARN: usize = 60;
/// Least share of the step size, and that on new nodes.
const LEAST_RATE: f32 = 0.1;
const RELEARN_RATE: f32 = 0.5;

/// Choices of one rollout in the physics, and the node after the last.
pub(crate) type Rollout = (Vec<Settled>, u32);

/// What the main thread tells.
pub(crate) enum Word {
    /// A new version of the graph.
    Graph(Box<Graph>),
    /// A rollout on nodes of this structure.
    Rollout(u64, Rollout),
    /// The rollouts of a round, on the newest graph's nodes, and the graph after it.
    Round(Vec<Rollout>, Box<Graph>),
    /// The final graph: the weights on it are final too.
    Settle(Box<Graph>),
}

/// The config's settings for the agent.
fn settings(config: &Config) -> Settings {
    let h = &config.high;
    let e = &config.execution;
    Settings {
        hidden: h.hidden.clone(),
        learning_rate: h.learning_rate as f32,
        environments: h.environments,
        horizon: h.horizon,
        ppo: ppo::Settings {
            epochs: h.epochs,
            minibatch: h.minibatch,
            clip: h.clip as f32,
            entropy: h.entropy as f32,
            value_loss: 0.5,
            max_gradient_norm: 0.5,
            discount: h.discount as f32,
            gae_lambda: h.gae_lambda as f32,
            target_kl: None,
        },
        arrival_reward: h.arrival_reward as f32,
        edge_cost: h.edge_cost as f32,
        max_edges: h.max_edges,
        knowledge: match config.graph.knowledge {
            config::Knowledge::Nothing => graph::Knowledge::Nothing,
            config::Knowledge::Data => graph::Knowledge::Data,
            config::Knowledge::Rollouts => graph::Knowledge::Rollouts,
        },
        patience: Patience {
            factor: e.timeout_factor as f32,
            most: e.max_edge_steps,
        },
    }
}

pub(crate) fn train(
    config: &Config,
    graph: Graph,
    words: &Receiver<Word>,
    post: &Post<'_>,
) -> anyhow::Result<()> {
    anyhow::ensure!(
        graph.len() >= 2,
        "the graph's largest connected part has {} nodes; give more data or lower graph.nodes",
        graph.len()
    );
    let h = &config.high;
    let mut rng = Pcg64Mcg::seed_from_u64(config.run.seed + 17);
    let high = High::new(&graph, settings(config), &mut rng);
    let batch = (h.environments * h.horizon) as f64;
    let most = (batch * h.physics_share / (1.0 - h.physics_share).max(0.01)) as usize;
    let mut trainer = Trainer {
        config,
        post,
        graph,
        high,
        rng,
        most,
        updates: 0,
        relearn: 0,
    };
    let start = Instant::now();
    let (mut done, mut extra) = (false, 0);
    loop {
        // Without work to do, the next word is waited for.
        let mut word = if done && extra == 0 {
            words.recv_timeout(Duration::from_millis(200)).ok()
        } else {
            words.try_recv().ok()
        };
        while let Some(told) = word {
            match told {
                Word::Graph(newer) => {
                    let updates = trainer.adopt(*newer);
                    extra = if done { extra.max(updates) } else { 0 };
                }
                Word::Rollout(structure, rollout) => {
                    if structure == trainer.graph.structure() {
                        trainer.add(&rollout);
                    }
                }
                Word::Round(rollouts, newer) => {
                    rollouts.iter().for_each(|rollout| trainer.add(rollout));
                    trainer.update();
                    let updates = trainer.adopt(*newer);
                    (0..updates).for_each(|_| trainer.update());
                    trainer.measure();
                    trainer.publish(true);
                }
                Word::Settle(last) => {
                    let updates = trainer.adopt(*last).max(extra);
                    (0..updates).for_each(|_| trainer.update());
                    trainer.measure();
                    trainer.publish(true);
                    post.send(News::Settled);
                    return Ok(());
                }
            }
            word = words.try_recv().ok();
        }
        if post.stopped() {
            return Ok(());
        }
        if done && extra == 0 {
            continue;
        }
        extra = extra.saturating_sub(1);
        trainer.update();
        let finished = !done && trainer.high.steps >= h.steps as u64;
        if finished {
            done = true;
            post.metric(
                "time/high_s",
                trainer.high.steps,
                start.elapsed().as_secs_f32(),
            );
            trainer.measure();
        }
        if trainer.updates.is_multiple_of(PUBLISH) || finished || (done && extra == 0) {
            trainer.publish(done);
        }
    }
}

/// The high level in training on the newest graph.
struct Trainer<'t, 's> {
    config: &'t Config,
    post: &'t Post<'s>,
    graph: Graph,
    high: High,
    rng: Pcg64Mcg,
    /// Choices of rollouts that an update takes, at most.
    most: usize,
    updates: u64,
    /// Updates that are left since the nodes changed.
    relearn: usize,
}

impl Trainer<'_, '_> {
    /// Goes on with a newer graph; the updates that it asks for.
    fn adopt(&mut self, newer: Graph) -> usize {
        if newer.len() < 2 || newer.version <= self.graph.version {
            return 0;
        }
        let changed = self.graph.structure() != newer.structure();
        self.high.adopt(&self.graph, &newer, &mut self.rng);
        self.graph = newer;
        if changed {
            self.relearn = RELEARN;
            return RELEARN;
        }
        REFRESH
    }

    fn add(&mut self, (choices, last): &Rollout) {
        if self.high.pending() < self.most {
            self.high.add_rollout(&self.graph, choices, *last);
        }
    }

    fn update(&mut self) {
        let h = &self.config.high;
        let left = 1.0 - self.high.steps as f32 / h.steps as f32;
        let least = if self.relearn > 0 {
            RELEARN_RATE
        } else {
            LEAST_RATE
        };
        self.relearn = self.relearn.saturating_sub(1);
        // Without the bonus in the end, near ties are settled and the most likely choices lead on.
        self.high.anneal(left.max(least), left.max(0.0));
        let physical = self.high.pending();
        let report = self.high.update(&self.graph, &mut self.rng);
        self.updates += 1;
        if self.updates.is_multiple_of(PUBLISH) {
            let (post, step) = (self.post, self.high.steps);
            post.metric("high/entropy_nats", step, report.entropy);
            post.metric("high/kl", step, report.kl);
            post.metric("high/clip_fraction", step, report.clip_fraction);
            post.metric("high/value_loss", step, report.value_loss);
            post.metric("high/physical_choices", step, physical as f32);
            if let Some((arrived, reward)) = self.high.take_walks() {
                post.metric("high/walks_arrived", step, arrived);
                post.metric("high/return", step, reward);
            }
        }
        let total = h.steps as u64;
        self.post
            .progress("high", self.high.steps.min(total), total);
    }

    /// How far the most likely choices lead, and how straight.
    fn measure(&mut self) {
        let (arrived, ratio) = self.high.quality(&self.graph, PAIRS, &mut self.rng);
        let step = self.high.steps;
        self.post.metric("high/greedy_arrived", step, arrived);
        self.post.metric("high/path_over_cheapest", step, ratio);
    }

    fn publish(&self, last: bool) {
        self.post.send(News::High {
            weights: self.high.weights.clone(),
            graph: self.graph.version,
            structure: self.graph.structure(),
            last,
        });
    }
}
