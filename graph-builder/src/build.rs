//! The graph of a data set: encode, select, cluster, link.

use agents::vae::{Encoder, Shape};
use anyhow::Context;
use config::Config;
use dataset::Dataset;
use graph::kmeans::{self, Seeding};
use graph::{EdgeRule, Graph, Segments, StateRule};

/// Below this upright value a row counts for no edge.
const UPRIGHT: f32 = 0.3;

pub(crate) fn graph(config: &Config, data: &Dataset, weights: &[f32]) -> anyhow::Result<Graph> {
    let g = &config.graph;
    let dz = config.encoder.latent;
    let shape = Shape::new(dz, &config.encoder.hidden);
    let mut encoder =
        Encoder::new(shape, weights).context("the encoder's weights do not fit its shape")?;
    let places = data.places();
    let mut latents = Vec::with_capacity(data.len() * dz);
    encoder.encode(places.iter().copied(), &mut latents);

    let rule = StateRule::new(g.states_per_place);
    let rows = graph::select(&places, |row| data.upright(row), &data.episodes, &rule);
    let mut points = Vec::with_capacity(rows.len() * dz);
    for &row in &rows {
        points.extend_from_slice(&latents[row * dz..(row + 1) * dz]);
    }
    let settings = kmeans::Settings {
        k: g.nodes,
        seed: config.run.seed + 7,
        iterations: 100,
        tolerance: 1e-4,
        seeding: Seeding::PlusPlus,
    };
    let clusters = kmeans::fit(&points, dz, &settings).with_context(|| {
        format!(
            "of {} rows, {} show the ant under way",
            data.len(),
            rows.len()
        )
    })?;
    let rule = EdgeRule {
        lag: g.lag,
        min_count: g.min_count,
        min_trajectories: g.min_trajectories,
    };
    let segments = Segments {
        latents: &latents,
        places: &places,
        episodes: &data.episodes,
        usable: &|row| data.upright(row) >= UPRIGHT,
    };
    Ok(graph::build(&segments, dz, &clusters.centroids, &rule))
}
