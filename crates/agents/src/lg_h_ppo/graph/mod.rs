//! Stage 2: the graph of a data set: encode, select, cluster, link. And what rollouts change of it.

mod settings;
mod tries;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use dataset::{Codes, Dataset};
use graph::kmeans;
use graph::{EdgeRule, Graph, GraphError, Growth, Pool, Segments, StateRule};
use serde::{Deserialize, Serialize};
use simulator::Body;

use super::vae::{self, Encoder, Shape};
use crate::graph_rule::{BuildError, GraphRule, GraphWork};
use crate::parts::Parts;
use crate::rollout::Rollout;
use crate::stream;
use tries::{Tries, UPRIGHT};

pub use settings::Settings;
pub use tries::Tally;

/// Share of the clustered states that are nearer to their node than a graph's spacing.
const WITHIN: f64 = 0.99;
/// Trajectories that a new node's states come from.
const NODE_TRAJECTORIES: usize = 2;

/// The rule of LG-H-PPO.
#[derive(Clone)]
pub struct Rule {
    body: &'static dyn Body,
    settings: Settings,
    encoder: vae::Settings,
    seed: u64,
    /// The encoder's place among the networks.
    network: usize,
}

impl Rule {
    /// Of a run's settings; `network` is the encoder's number.
    #[must_use]
    pub fn new(
        body: &'static dyn Body,
        settings: &Settings,
        encoder: &vae::Settings,
        seed: u64,
        network: usize,
    ) -> Self {
        Self {
            body,
            settings: settings.clone(),
            encoder: encoder.clone(),
            seed,
            network,
        }
    }

    fn encoder(&self, parts: &Parts) -> Result<Encoder, BuildError> {
        let shape = Shape::new(self.encoder.latent, &self.encoder.hidden);
        let weights = parts.weights(self.network).ok_or(BuildError::Encoder)?;
        Encoder::new(shape, &weights.values).ok_or(BuildError::Encoder)
    }

    /// Nodes and ways of a data set. With `[graph] online` they may grow.
    fn pool(
        &self,
        data: &Dataset,
        encoder: &mut Encoder,
        weights: &[f32],
        folder: &Path,
    ) -> Result<Pool, BuildError> {
        let (g, dz) = (&self.settings, self.encoder.latent);
        let places = data.places();
        let upright = |row: usize| self.body.upright(data.observation(row));
        let mut latents = Vec::with_capacity(data.len() * dz);
        encoder.encode(places.iter().copied(), &mut latents);

        let rule = StateRule::new(g.states_per_place);
        let rows = graph::select(&places, upright, &data.episodes, &rule);
        let mut points = Vec::with_capacity(rows.len() * dz);
        for &row in &rows {
            points.extend_from_slice(&latents[row * dz..(row + 1) * dz]);
        }
        let clusters = kmeans::fit(&points, dz, &self.clustering());
        let clusters = clusters.map_err(|reason| BuildError::Cluster {
            rows: data.len(),
            moving: rows.len(),
            reason,
        })?;
        let spacing = spacing(clusters.distances);
        let rule = EdgeRule {
            lag: g.lag,
            min_count: g.min_count,
            min_trajectories: g.min_trajectories,
            least_success: if g.online { g.least_success } else { 0.0 },
        };
        let mut pool = Pool::new(dz, clusters.centroids, rule);
        let segments = Segments {
            latents: &latents,
            places: &places,
            episodes: &data.episodes,
            names: &|number| number as u64,
            usable: &|row| upright(row) >= UPRIGHT,
        };
        let nearest = pool.begin(&segments);
        if g.wrong_edges > 0.0 {
            pool.add_wrong_edges(g.wrong_edges, &mut stream(self.seed, "wrong edges", 0));
        }
        if g.online {
            pool.let_grow(Growth {
                radius: spacing * g.growth_radius,
                min_states: g.growth_states,
                min_trajectories: NODE_TRAJECTORIES,
                max_nodes: g.max_nodes,
            });
        }
        // Before the graph is published, so that its readers find the file and need not wait for it.
        let (graph, ..) = pool.clone().renew();
        let nodes = nearest.within(&latents, &graph);
        if let Err(error) = Codes::save(folder, [weights, &graph.latents], &latents, &nodes) {
            log::warn!("{error}; the learner computes what would be in it");
        }
        Ok(pool)
    }

    fn clustering(&self) -> kmeans::Settings {
        kmeans::Settings {
            k: self.settings.nodes,
            seed: stream::seed(self.seed, "k-means", 0),
            iterations: 100,
            tolerance: 1e-4,
            seeding: self.settings.seeding,
        }
    }
}

/// The latent distance from its node that all but a few states lie within, of squared distances.
fn spacing(mut distances: Vec<f32>) -> f32 {
    let n = distances.len();
    let at = ((n as f64 * WITHIN) as usize).min(n.saturating_sub(1));
    distances.sort_unstable_by(f32::total_cmp);
    distances.get(at).map_or(0.0, |squared| squared.sqrt())
}

impl GraphRule for Rule {
    fn after(&self) -> Vec<usize> {
        vec![self.network]
    }

    fn max_bytes(&self) -> usize {
        graph::max_bytes(self.settings.most_nodes(), self.encoder.latent)
    }

    fn read(&self, bytes: &[u8]) -> Result<Graph, GraphError> {
        Graph::from_bytes_of(bytes, self.encoder.latent)
    }

    fn refresh(&self) -> Duration {
        Duration::from_secs_f64(self.settings.refresh_seconds)
    }

    fn build(
        &self,
        data: &Dataset,
        parts: &Parts,
        folder: &Path,
    ) -> Result<Box<dyn GraphWork>, BuildError> {
        let mut encoder = self.encoder(parts)?;
        let weights = parts.weights(self.network).ok_or(BuildError::Encoder)?;
        let pool = self.pool(data, &mut encoder, &weights.values, folder)?;
        Ok(Box::new(Work {
            online: self.settings.online.then_some((encoder, self.body)),
            pool,
            tries: Tries::default(),
        }))
    }

    fn restore(
        &self,
        saved: &[u8],
        parts: &Parts,
    ) -> Result<(Box<dyn GraphWork>, Graph), BuildError> {
        let kept: Kept = postcard::from_bytes(saved).map_err(|_| GraphError::Format)?;
        if !kept.pool.is_sound() {
            return Err(GraphError::Format.into());
        }
        let graph = self.read(&kept.graph)?;
        let encoder = self.encoder(parts)?;
        let mut tries = Tries::default();
        tries.total = kept.total;
        tries.publish(Arc::new(graph.clone()));
        let work = Work {
            online: self.settings.online.then_some((encoder, self.body)),
            pool: kept.pool,
            tries,
        };
        Ok((Box::new(work), graph))
    }
}

/// What a successor goes on from.
#[derive(Serialize, Deserialize)]
struct Kept {
    pool: Pool,
    /// The version that was published with it.
    graph: Vec<u8>,
    total: Tally,
}

struct Work {
    /// What new places are encoded with, where the graph may grow.
    online: Option<(Encoder, &'static dyn Body)>,
    pool: Pool,
    tries: Tries,
}

impl GraphWork for Work {
    fn learn(&mut self, rollout: &Rollout<'_>) {
        self.tries.count(&mut self.pool, rollout);
        if let Some((encoder, body)) = &mut self.online {
            self.tries.explore(&mut self.pool, encoder, *body, rollout);
        }
    }

    fn has_changed(&self) -> bool {
        self.tries.recent.tried > 0
    }

    fn renew(
        &mut self,
        limit: usize,
        metrics: &mut Vec<(&'static str, f64)>,
    ) -> Result<Arc<Graph>, BuildError> {
        let (mut graph, share, added) = self.pool.renew();
        if let Err(unusable) = graph.judge(self.pool.len(), limit) {
            // Rollouts can drop too many edges: the version before them stays, under this number.
            let Some(before) = self.tries.newest() else {
                return Err(unusable.into());
            };
            log::warn!("{unusable}; the version before stays");
            let version = graph.version;
            graph = Graph {
                version,
                ..before.clone()
            };
        }
        let Tally {
            tried,
            reached,
            over_best,
        } = self.tries.recent;
        if tried > 0 {
            metrics.push(("graph/edges_tried", self.tries.total.tried as f64));
            metrics.push(("graph/edge_success", reached as f64 / tried as f64));
            metrics.push(("low/steps_over_best", over_best / reached.max(1) as f64));
        }
        metrics.push(("graph/connected_share", f64::from(share)));
        metrics.push(("graph/nodes_added", added as f64));
        let graph = Arc::new(graph);
        self.tries.publish(Arc::clone(&graph));
        Ok(graph)
    }

    fn save(&self) -> Vec<u8> {
        let kept = Kept {
            pool: self.pool.clone(),
            graph: self.tries.newest().map(Graph::to_bytes).unwrap_or_default(),
            total: self.tries.total,
        };
        postcard::to_stdvec(&kept).unwrap_or_default()
    }

    fn status(&self) -> String {
        let Some(graph) = self.tries.newest() else {
            return String::new();
        };
        let Tally { tried, reached, .. } = self.tries.total;
        let share = 100.0 * reached as f64 / tried.max(1) as f64;
        let tries = match tried {
            0 => String::new(),
            _ => format!(", {share:.0}% of {tried} tries reached"),
        };
        format!("{} nodes, {} edges{tries}", graph.len(), graph.edges.len())
    }
}
