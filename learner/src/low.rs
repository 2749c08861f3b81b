//! Stage 3a on a thread: the low level.

use std::path::Path;
use std::time::Instant;

use agents::low::{self, Low, Policy, Sample, Settings, Subgoal};
use agents::vae::{Encoder, Shape};
use config::Config;
use dataset::{Dataset, Starts};
use graph::Graph;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::codes::{self, Codes};
use crate::offline::{News, Post};
use crate::save;

/// Updates between two reports.
const REPORT: usize = 500;
/// Updates between two publications.
const PUBLISH: usize = 500;
/// The value's goals: the policy's subgoal, a later state, any node; the rest is the state's own
/// place.
const VALUE_GOALS: [f32; 3] = [0.5, 0.2, 0.2];

/// Where the stage is.
#[derive(Serialize, Deserialize)]
struct State {
    update: usize,
    rng: Pcg64Mcg,
    low: low::State,
    sums: [f32; 3],
    seconds: f32,
    /// The graph that it began with.
    graph: Vec<u8>,
}

pub(crate) fn train(
    config: &Config,
    data: &Dataset,
    mut graph: Graph,
    weights: &[f32],
    post: &Post<'_>,
) -> anyhow::Result<()> {
    let start = Instant::now();
    let l = &config.low;
    let settings = Settings {
        hidden: l.hidden.clone(),
        learning_rate: l.learning_rate as f32,
        batch: l.batch,
        expectile: l.expectile as f32,
        discount: l.discount as f32,
        inverse_temperature: l.inverse_temperature as f32,
        weight_clip: l.weight_clip as f32,
        target_rate: l.target_rate as f32,
    };
    let dz = config.encoder.latent;
    if let Some(path) = &l.from {
        let policy = Policy::new(dz, &l.hidden);
        let weights = save::load(Path::new(path), policy.mlp().parameters())?;
        post.send(News::Low {
            weights,
            version: 1,
            last: true,
        });
        return Ok(());
    }
    let Some(mut encoder) = Encoder::new(Shape::new(dz, &config.encoder.hidden), weights) else {
        anyhow::bail!("the encoder's weights do not fit its shape");
    };
    let (mut keeper, mut state) = post.keeper::<State>("low", config);
    if let Some(kept) = &state {
        match Graph::from_bytes_of(&kept.graph, dz) {
            Ok(first) => graph = first,
            Err(_) => state = None,
        }
    }
    let graph_bytes = graph.to_bytes();
    let Codes { latents, nodes } = codes::of(post.folder(), data, weights, &mut encoder, &graph);
    let latent = |row: usize| &latents[row * dz..(row + 1) * dz];
    let centroid = |node: u32| Subgoal {
        place: graph.places[node as usize],
        latent: graph.latent(node),
    };

    let mut rng = Pcg64Mcg::seed_from_u64(config.run.seed + 13);
    let Some(starts) = Starts::new(&data.episodes, 1) else {
        anyhow::bail!("no episode of the data set has two rows");
    };
    let mut low = Low::new(dz, settings, &mut rng);
    let reach = config.graph.lag + l.slack;
    let mut samples = Vec::with_capacity(l.batch);
    let (mut value_loss, mut policy_loss, mut weight) = (0.0, 0.0, 0.0);
    let (mut first, mut earlier) = (1, 0.0);
    if let Some(state) = state
        && low.restore(state.low)
    {
        (first, rng, earlier) = (state.update + 1, state.rng, state.seconds);
        [value_loss, policy_loss, weight] = state.sums;
    }
    let state = |update, rng: &Pcg64Mcg, low: &Low, sums| State {
        update,
        rng: rng.clone(),
        low: low.state(),
        sums,
        seconds: earlier + start.elapsed().as_secs_f32(),
        graph: graph_bytes.clone(),
    };
    if first > 1 {
        let done = first - 1;
        post.send(News::Low {
            weights: low.weights.clone(),
            version: done as u64,
            last: done >= l.updates,
        });
    }
    for update in first..=l.updates {
        if post.stopped() || keeper.is_due() {
            let done = update - 1;
            let state = state(done, &rng, &low, [value_loss, policy_loss, weight]);
            keeper.keep(done as u64, 0, &state);
        }
        if post.stopped() {
            return Ok(());
        }
        let left = 1.0 - update as f32 / l.updates as f32;
        low.set_learning_rate(l.learning_rate as f32 * left.max(0.1));
        samples.clear();
        for _ in 0..l.batch {
            let (row, end) = starts.draw(&mut rng);
            let later = (row + rng.random_range(1..=reach)).min(end - 1);
            let snapped = rng.random::<f64>() < l.snap;
            let subgoal = if snapped {
                centroid(nodes[later])
            } else {
                Subgoal {
                    place: data.place(later),
                    latent: latent(later),
                }
            };
            let mut pick: f32 = rng.random();
            let mut value_goal = data.place(row);
            for (goal, share) in VALUE_GOALS.into_iter().enumerate() {
                if (0.0..share).contains(&pick) {
                    value_goal = match goal {
                        0 => subgoal.place,
                        1 => data.place((row + rng.random_range(1..=4 * reach)).min(end - 1)),
                        _ => graph.places[rng.random_range(0..graph.len())],
                    };
                }
                pick -= share;
            }
            samples.push(Sample {
                observation: data.observation(row),
                action: data.action(row),
                next: data.observation(row + 1),
                latent: latent(row),
                subgoal,
                value_goal,
            });
        }
        let losses = low.update(&samples);
        value_loss += losses.value_loss;
        policy_loss += losses.policy_loss;
        weight += losses.weight;
        if update % REPORT == 0 || update == l.updates {
            let (step, n) = (update as u64, ((update - 1) % REPORT + 1) as f32);
            post.metric("low/value_loss", step, value_loss / n);
            post.metric("low/policy_loss", step, policy_loss / n);
            post.metric("low/mean_weight", step, weight / n);
            post.progress("low", step, l.updates as u64);
            (value_loss, policy_loss, weight) = (0.0, 0.0, 0.0);
        }
        if update % PUBLISH == 0 || update == l.updates {
            let last = update == l.updates;
            if last {
                let state = state(update, &rng, &low, [value_loss, policy_loss, weight]);
                keeper.keep(update as u64, 0, &state);
                post.metric("time/low_s", update as u64, state.seconds);
            }
            post.send(News::Low {
                weights: low.weights.clone(),
                version: update as u64,
                last,
            });
        }
    }
    Ok(())
}
