//! Stage 3b on a thread: the high level, on the graph and from rollouts.

use std::sync::mpsc::Receiver;
use std::time::Duration;

use agents::high::{Choice, High, Settings};
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

/// What the main thread tells.
pub(crate) enum Word {
    /// A new version of the graph.
    Graph(Box<Graph>),
    /// Choices of one rollout in the physics, and the node after the last.
    Rollout(Vec<Choice>, u32),
    /// No more updates.
    Freeze,
}

/// The config's settings for the agent.
pub(crate) fn settings(config: &Config) -> Settings {
    let h = &config.high;
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
    }
}

pub(crate) fn train(
    config: &Config,
    mut graph: Graph,
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
    let mut high = High::new(&graph, settings(config), &mut rng);
    let batch = (h.environments * h.horizon) as f64;
    let most = (batch * h.physics_share / (1.0 - h.physics_share).max(0.01)) as usize;
    let total = h.steps as u64;
    let (mut updates, mut extra) = (0_u64, 0);
    let mut done = false;
    loop {
        // Without work to do, the next word is waited for.
        let idle = done && extra == 0;
        let mut word = if idle {
            words.recv_timeout(Duration::from_millis(200)).ok()
        } else {
            words.try_recv().ok()
        };
        while let Some(told) = word {
            match told {
                Word::Graph(newer) if newer.len() == graph.len() => {
                    graph = *newer;
                    extra = if done { REFRESH } else { 0 };
                }
                Word::Graph(_) => {}
                Word::Rollout(choices, last) if high.pending() < most => {
                    high.add_rollout(&graph, &choices, last);
                }
                Word::Rollout(..) => {}
                Word::Freeze => return Ok(()),
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
        let left = 1.0 - high.steps as f32 / total as f32;
        high.set_learning_rate(h.learning_rate as f32 * left.max(0.1));
        let physical = high.pending();
        let report = high.update(&graph, &mut rng);
        updates += 1;
        let finished = !done && high.steps >= total;
        let step = high.steps;
        if updates.is_multiple_of(PUBLISH) || finished {
            post.metric("high/entropy_nats", step, report.entropy);
            post.metric("high/kl", step, report.kl);
            post.metric("high/clip_fraction", step, report.clip_fraction);
            post.metric("high/value_loss", step, report.value_loss);
            post.metric("high/physical_choices", step, physical as f32);
            if let Some(success) = high.take_success() {
                post.metric("high/walks_arrived", step, success);
            }
            post.progress("high", step.min(total), total);
        }
        if updates.is_multiple_of(PUBLISH) || finished || (done && extra == 0) {
            done |= finished;
            if finished || done {
                let (arrived, ratio) = high.quality(&graph, PAIRS, &mut rng);
                post.metric("high/greedy_arrived", step, arrived);
                post.metric("high/path_over_shortest", step, ratio);
            }
            post.send(News::High {
                weights: high.weights.clone(),
                last: done,
            });
        }
    }
}
