//! Stage 3b on a thread: the high level, on the graph and from rollouts.

use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use agents::high::{self, High, Settings, Settled};
use agents::navigator::Patience;
use agents::ppo;
use config::Config;
use graph::Graph;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::offline::{News, Post};
use crate::save::Keeper;

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

/// How far the stage is.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Progress {
    updates: u64,
    /// Updates that are left since the nodes changed.
    relearn: usize,
    /// Updates that are left once the planned ones are done.
    extra: usize,
    /// The planned updates are done.
    done: bool,
    /// The weights are final.
    settled: bool,
    rounds: u32,
}

/// Where the stage is.
#[derive(Serialize, Deserialize)]
struct State {
    progress: Progress,
    rng: Pcg64Mcg,
    high: high::State,
    graph: Vec<u8>,
    seconds: f32,
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
    let mut trainer = Trainer::new(config, graph, post);
    if trainer.progress.updates > 0 {
        trainer.publish();
    }
    let mut settle: Option<Box<Graph>> = None;
    while !trainer.progress.settled {
        // Without work to do, the next word is waited for.
        let mut word = if trainer.is_idle() && settle.is_none() {
            words.recv_timeout(Duration::from_millis(200)).ok()
        } else {
            words.try_recv().ok()
        };
        while let Some(told) = word {
            match told {
                Word::Graph(newer) => trainer.go_on_with(*newer),
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
                    trainer.progress.rounds += 1;
                    trainer.keep();
                    trainer.publish();
                }
                Word::Settle(last) => settle = Some(last),
            }
            word = words.try_recv().ok();
        }
        if post.stopped() {
            trainer.keep();
            return Ok(());
        }
        if trainer.progress.done
            && let Some(last) = settle.take()
        {
            let updates = trainer.adopt(*last).max(trainer.progress.extra);
            (0..updates).for_each(|_| trainer.update());
            trainer.measure();
            trainer.progress.settled = true;
            trainer.keep();
            trainer.publish();
        } else if !trainer.is_idle() {
            trainer.go_on();
        }
    }
    post.send(News::Settled);
    Ok(())
}

/// The high level in training on the newest graph.
struct Trainer<'t, 's> {
    config: &'t Config,
    post: &'t Post<'s>,
    keeper: Keeper,
    graph: Graph,
    high: High,
    rng: Pcg64Mcg,
    /// Choices of rollouts that an update takes, at most.
    most: usize,
    progress: Progress,
    /// Choices of rollouts that were more than an update takes.
    surplus: u64,
    start: Instant,
    earlier: f32,
}

impl<'t, 's> Trainer<'t, 's> {
    /// On a graph, or from where the newest state was.
    fn new(config: &'t Config, graph: Graph, post: &'t Post<'s>) -> Self {
        let h = &config.high;
        let (keeper, kept) = post.keeper::<State>("high", config);
        let seeded = || Pcg64Mcg::seed_from_u64(config.run.seed + 17);
        let restored = kept.and_then(|kept| {
            let before = Graph::from_bytes(&kept.graph).ok()?;
            let mut high = High::new(&before, settings(config), &mut seeded());
            high.restore(kept.high.clone())
                .then_some((high, before, kept))
        });
        let batch = (h.environments * h.horizon) as f64;
        let most = (batch * h.physics_share / (1.0 - h.physics_share).max(0.01)) as usize;
        let trainer = |high, graph, rng| Self {
            config,
            post,
            keeper,
            graph,
            high,
            rng,
            most,
            progress: Progress::default(),
            surplus: 0,
            start: Instant::now(),
            earlier: 0.0,
        };
        let Some((high, before, kept)) = restored else {
            let mut rng = seeded();
            let high = High::new(&graph, settings(config), &mut rng);
            return trainer(high, graph, rng);
        };
        let mut trainer = Self {
            progress: kept.progress,
            earlier: kept.seconds,
            ..trainer(high, before, kept.rng)
        };
        // In rounds a graph goes with its rollouts.
        if !config.run.deterministic && !trainer.progress.settled {
            trainer.go_on_with(graph);
        }
        trainer
    }

    /// Adopts a newer graph; once the planned updates are done, more follow on it.
    fn go_on_with(&mut self, newer: Graph) {
        let updates = self.adopt(newer);
        if self.progress.done {
            self.progress.extra = self.progress.extra.max(updates);
        }
    }

    /// Nothing to do until somebody says something.
    fn is_idle(&self) -> bool {
        self.progress.done && self.progress.extra == 0
    }

    fn keep(&mut self) {
        let state = State {
            progress: self.progress,
            rng: self.rng.clone(),
            high: self.high.state(),
            graph: self.graph.to_bytes(),
            seconds: self.earlier + self.start.elapsed().as_secs_f32(),
        };
        self.keeper
            .keep(self.progress.updates, self.progress.rounds, &state);
    }

    /// One update more, and what goes with it.
    fn go_on(&mut self) {
        self.progress.extra = self.progress.extra.saturating_sub(1);
        self.update();
        let finished = !self.progress.done && self.high.steps >= self.config.high.steps as u64;
        if finished {
            self.progress.done = true;
            let seconds = self.earlier + self.start.elapsed().as_secs_f32();
            self.post.metric("time/high_s", self.high.steps, seconds);
            self.measure();
        }
        // Whoever hears that training is done must find it done again.
        if finished || self.keeper.is_due() {
            self.keep();
        }
        if self.progress.updates.is_multiple_of(PUBLISH) || finished || self.is_idle() {
            self.publish();
        }
    }
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
            self.progress.relearn = RELEARN;
            return RELEARN;
        }
        REFRESH
    }

    fn add(&mut self, (choices, last): &Rollout) {
        if self.high.pending() < self.most {
            self.high.add_rollout(&self.graph, choices, *last);
        } else {
            self.surplus += choices.len() as u64;
        }
    }

    fn update(&mut self) {
        let h = &self.config.high;
        let left = 1.0 - self.high.steps as f32 / h.steps as f32;
        let least = if self.progress.relearn > 0 {
            RELEARN_RATE
        } else {
            LEAST_RATE
        };
        self.progress.relearn = self.progress.relearn.saturating_sub(1);
        // Without the bonus in the end, near ties are settled and the most likely choices lead on.
        self.high.anneal(left.max(least), left.max(0.0));
        let physical = self.high.pending();
        let report = self.high.update(&self.graph, &mut self.rng);
        self.progress.updates += 1;
        if self.progress.updates.is_multiple_of(PUBLISH) {
            let (post, step) = (self.post, self.high.steps);
            post.metric("high/entropy_nats", step, report.entropy);
            post.metric("high/kl", step, report.kl);
            post.metric("high/clip_fraction", step, report.clip_fraction);
            post.metric("high/value_loss", step, report.value_loss);
            post.metric("high/physical_choices", step, physical as f32);
            post.metric("high/surplus_choices", step, self.surplus as f32);
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

    fn publish(&self) {
        self.post.send(News::High {
            weights: self.high.weights(),
            version: self.progress.updates,
            graph: self.graph.version,
            structure: self.graph.structure(),
            rounds: self.progress.rounds,
            last: self.progress.done,
        });
    }
}
