//! Whether a graph is one that a run can go on with, before anyone is given it.

use crate::{Graph, GraphError};

/// Why nobody can use a graph. Building it again from the same data does not mend it.
#[derive(Debug, thiserror::Error)]
pub enum Unusable {
    /// Nowhere to go.
    #[error(
        "the graph's largest connected part has {nodes} of {all} nodes and {edges} edges, too few \
         to walk on; give data of more and longer episodes, or lower graph.nodes, graph.min_count \
         or graph.min_trajectories"
    )]
    Small {
        /// Nodes of the largest part.
        nodes: usize,
        /// Nodes in all.
        all: usize,
        /// Its edges.
        edges: usize,
    },
    /// Values that its readers refuse.
    #[error("{0}: the data hold values that no ant comes to; mend or drop those rows")]
    Refused(GraphError),
    /// More than its channel takes.
    #[error("the graph has {bytes} bytes and its channel takes {limit}; lower graph.nodes")]
    Long {
        /// Bytes of the graph.
        bytes: usize,
        /// Bytes of the channel.
        limit: usize,
    },
}

impl Graph {
    /// Whether its readers will take it and a policy can walk on it. `all` is the number of nodes
    /// that it was made from, `limit` what its channel takes (bytes).
    ///
    /// # Errors
    /// [`Unusable`].
    pub fn judge(&self, all: usize, limit: usize) -> Result<(), Unusable> {
        if self.len() < 2 || self.edges.is_empty() {
            return Err(Unusable::Small {
                nodes: self.len(),
                all,
                edges: self.edges.len(),
            });
        }
        let bytes = self.to_bytes();
        if bytes.len() > limit {
            let bytes = bytes.len();
            return Err(Unusable::Long { bytes, limit });
        }
        match Self::from_bytes_of(&bytes, self.latent_dim) {
            Ok(_) => Ok(()),
            Err(error) => Err(Unusable::Refused(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kmeans::{self, Seeding, Settings};
    use crate::{EdgeRule, Pool, Segments, max_bytes};

    /// Places along walks of odd kinds.
    fn walks() -> impl Strategy<Value = Vec<Vec<[f32; 2]>>> {
        let scale = prop_oneof![
            Just(0.0_f32),
            Just(0.2),
            Just(1e4),
            Just(1e9),
            Just(1e30),
            Just(f32::MAX / 8.0)
        ];
        let walk = (0..80_usize, scale, -3.0..3.0_f32, any::<bool>(), 0..2_usize);
        let walk = walk.prop_map(|(rows, step, bend, back, island)| {
            let at = |t: usize| {
                let t = if back { t % 20 } else { t } as f32;
                [
                    step * t + 100.0 * island as f32,
                    step * bend * (t * 0.3).sin(),
                ]
            };
            (0..rows).map(at).collect()
        });
        prop::collection::vec(walk, 0..8)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        /// Whatever the data, there is an error or a graph that readers take and that leads
        /// somewhere.
        #[test]
        fn odd_data_make_a_graph_that_is_taken_or_an_error(
            walks in walks(), k in 1..12_usize, lag in 1..20_usize, online in any::<bool>()
        ) {
            let places: Vec<[f32; 2]> = walks.concat();
            let latents: Vec<f32> = places.iter().flatten().copied().collect();
            let mut start = 0;
            let episodes: Vec<_> = walks.iter().filter(|walk| !walk.is_empty()).map(|walk| {
                start += walk.len();
                start - walk.len()..start
            }).collect();
            let settings = Settings {
                k, seed: 1, iterations: 10, tolerance: 1e-4, seeding: Seeding::PlusPlus,
            };
            let Ok(clusters) = kmeans::fit(&latents, 2, &settings) else { return Ok(()) };
            let rule = EdgeRule { lag, min_count: 1, min_trajectories: 1, least_success: 0.0 };
            let mut pool = Pool::new(2, clusters.centroids, rule);
            if online {
                pool.let_grow(crate::Growth {
                    radius: 0.5, min_states: 2, min_trajectories: 1, max_nodes: 20,
                });
            }
            let segments = Segments {
                latents: &latents,
                places: &places,
                episodes: &episodes,
                names: &|number| number as u64,
                usable: &|_| true,
            };
            pool.begin(&segments);
            let (graph, ..) = pool.renew();
            let limit = max_bytes(20, 2);
            if graph.judge(pool.len(), limit).is_ok() {
                let bytes = graph.to_bytes();
                prop_assert!(bytes.len() <= limit);
                prop_assert_eq!(Graph::from_bytes_of(&bytes, 2).map_err(|e| e.to_string()), Ok(graph.clone()));
                for node in 0..graph.len() as u32 {
                    prop_assert!(!graph.neighbours(node).is_empty());
                }
            }
        }
    }

    #[test]
    fn what_readers_refuse_is_refused_with_the_cause() {
        let told = |change: &dyn Fn(&mut Graph), limit: usize| {
            let mut graph = crate::paths::tests::ring(4);
            change(&mut graph);
            graph.judge(9, limit).map_err(|error| error.to_string())
        };
        assert_eq!(told(&|_: &mut Graph| {}, 10_000), Ok(()));
        for (change, wanted) in [
            (
                (&|g: &mut Graph| g.places[1][0] = 1e9) as &dyn Fn(&mut Graph),
                "the graph's places",
            ),
            (
                &|g: &mut Graph| g.latents[2] = f32::NAN,
                "the graph's nodes",
            ),
            (
                &|g: &mut Graph| *g = g.largest_component_of_none(),
                "has 0 of 9 nodes and 0 edges",
            ),
        ] {
            let error = told(change, 10_000).unwrap_err();
            assert!(error.contains(wanted), "{error}");
        }
        let error = told(&|_: &mut Graph| {}, 10).unwrap_err();
        assert!(error.contains("its channel takes 10"), "{error}");
    }

    impl Graph {
        fn largest_component_of_none(&self) -> Self {
            Self::assemble(self.latent_dim, vec![], vec![], vec![], vec![])
        }
    }
}
