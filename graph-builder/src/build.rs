//! The graph of a data set: encode, select, cluster, link.

use std::path::Path;

use agents::vae::{Encoder, Shape};
use anyhow::Context;
use config::{Config, Seeding};
use dataset::{Codes, Dataset};
use graph::kmeans::{self, Settings};
use graph::{EdgeRule, Growth, Pool, Segments, StateRule};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Below this upright value a row counts for no edge.
pub(crate) const UPRIGHT: f32 = 0.3;
/// Share of the clustered states that are nearer to their node than a graph's spacing.
const WITHIN: f64 = 0.99;
/// Trajectories that a new node's states come from.
const NODE_TRAJECTORIES: usize = 2;

/// The encoder that weights are of.
pub(crate) fn encoder(config: &Config, weights: &[f32]) -> anyhow::Result<Encoder> {
    let shape = Shape::new(config.encoder.latent, &config.encoder.hidden);
    Encoder::new(shape, weights).context("the encoder's weights do not fit its shape")
}

/// Nodes and ways of a data set. With `[graph] online` they may grow. Latents and nearest nodes of all
/// rows are written to the run's folder for the learner.
pub(crate) fn pool(
    config: &Config,
    data: &Dataset,
    encoder: &mut Encoder,
    weights: &[f32],
    run: &Path,
) -> anyhow::Result<Pool> {
    let g = &config.graph;
    let dz = config.encoder.latent;
    let places = data.places();
    let mut latents = Vec::with_capacity(data.len() * dz);
    encoder.encode(places.iter().copied(), &mut latents);

    let rule = StateRule::new(g.states_per_place);
    let rows = graph::select(&places, |row| data.upright(row), &data.episodes, &rule);
    let mut points = Vec::with_capacity(rows.len() * dz);
    for &row in &rows {
        points.extend_from_slice(&latents[row * dz..(row + 1) * dz]);
    }
    let settings = Settings {
        k: g.nodes,
        seed: config.run.seed + 7,
        iterations: 100,
        tolerance: 1e-4,
        seeding: match g.seeding {
            Seeding::PlusPlus => kmeans::Seeding::PlusPlus,
            Seeding::Random => kmeans::Seeding::Random,
        },
    };
    let clusters = kmeans::fit(&points, dz, &settings).with_context(|| {
        format!(
            "of {} rows, {} show the ant under way",
            data.len(),
            rows.len()
        )
    })?;
    let spacing = spacing(clusters.distances);
    let rule = EdgeRule {
        lag: g.lag,
        min_count: g.min_count,
        min_trajectories: g.min_trajectories,
        least_success: if g.online {
            g.least_success as f32
        } else {
            0.0
        },
    };
    let mut pool = Pool::new(dz, clusters.centroids, rule);
    let segments = Segments {
        latents: &latents,
        places: &places,
        episodes: &data.episodes,
        names: &|number| number as u64,
        usable: &|row| data.upright(row) >= UPRIGHT,
    };
    let nearest = pool.begin(&segments);
    if g.wrong_edges > 0.0 {
        let mut rng = Pcg64Mcg::seed_from_u64(config.run.seed + 29);
        pool.add_wrong_edges(g.wrong_edges, &mut rng);
    }
    if g.online {
        pool.let_grow(Growth {
            radius: spacing * g.growth_radius as f32,
            min_states: g.growth_states,
            min_trajectories: NODE_TRAJECTORIES,
            max_nodes: g.max_nodes,
        });
    }
    // Written before the graph is published, so that readers never wait for it.
    let (graph, ..) = pool.clone().renew();
    let nodes = nearest.within(&latents, &graph);
    if let Err(error) = Codes::save(run, [weights, &graph.latents], &latents, &nodes) {
        log::warn!("{error}; the learner computes the codes itself");
    }
    Ok(pool)
}

/// The latent distance from its node that all but a few states lie within, of squared distances.
fn spacing(mut distances: Vec<f32>) -> f32 {
    let n = distances.len();
    let at = ((n as f64 * WITHIN) as usize).min(n.saturating_sub(1));
    distances.sort_unstable_by(f32::total_cmp);
    distances.get(at).map_or(0.0, |squared| squared.sqrt())
}
