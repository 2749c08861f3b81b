//! Latents and nearest nodes of all rows: those that the graph-builder left, or computed here.

use std::path::Path;

use dataset::{Array, Dataset};
use graph::{Graph, Nearest};

use super::vae::Encoder;

/// What the low level learns from, by row.
pub(super) struct Codes {
    /// `[n, latent]`.
    pub(super) latents: Array<f32>,
    /// The graph's node that is nearest.
    pub(super) nodes: Array<u32>,
}

/// Those of an encoder with these weights and of a graph. The file is there before its graph is
/// published; on a full disk there is none, and after a restart it may be of another graph.
pub(super) fn of(
    run: &Path,
    data: &Dataset,
    weights: &[f32],
    encoder: &mut Encoder,
    graph: &Graph,
) -> Codes {
    let (rows, width) = (data.len(), encoder.latent());
    let found = dataset::Codes::open(run, rows, width, weights);
    let nodes = found.as_ref().and_then(|found| found.nodes(&graph.latents));
    let latents = match found {
        Some(found) => found.latents,
        None => {
            log::info!("no latents of this encoder are in the run's folder; computing them");
            let mut latents = Vec::with_capacity(rows * width);
            encoder.encode((0..rows).map(|row| data.place(row)), &mut latents);
            latents.into()
        }
    };
    let nodes = nodes.unwrap_or_else(|| Nearest::of(&latents, width, &graph.latents).nodes.into());
    Codes { latents, nodes }
}

#[cfg(test)]
mod tests {
    use graph::{EdgeRule, Pool, Segments};

    use super::super::vae::Shape;
    use super::*;

    /// Places along a line, a graph of three nodes on it, and the place itself as the latent.
    fn line() -> (Dataset, Vec<f32>, Encoder, Graph) {
        let mut data = Dataset::new(dataset::Shape::vectors(4, 2));
        for x in (0..60).chain((0..60).rev()) {
            data.observations.extend([x as f32 * 0.1, 0.0, 0.0, 0.0]);
            data.actions.extend([0.0; 2]);
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.end_episode();
        let weights = vec![0.0, 0.0, 1.0, 1.0];
        let encoder = Encoder::new(Shape::new(2, &[]), &weights).unwrap();
        let rule = EdgeRule {
            lag: 5,
            min_count: 1,
            min_trajectories: 1,
            least_success: 0.0,
        };
        let mut pool = Pool::new(2, vec![1.0, 0.0, 3.0, 0.0, 5.0, 0.0], rule);
        pool.begin(&Segments {
            latents: data.places().as_flattened(),
            places: &data.places(),
            episodes: &data.episodes,
            names: &|_| 0,
            usable: &|_| true,
        });
        (data, weights, encoder, pool.renew().0)
    }

    #[test]
    fn codes_that_are_found_are_those_that_are_computed() {
        let folder = tempfile::tempdir().unwrap();
        let (data, weights, mut encoder, graph) = line();
        let mut codes = || of(folder.path(), &data, &weights, &mut encoder, &graph);
        let own = codes();
        assert!(!own.latents.is_mapped() && !own.nodes.is_mapped());
        assert_eq!(own.latents, data.places().as_flattened());
        assert_eq!((own.nodes[0], own.nodes[30], own.nodes[59]), (0, 1, 2));
        let made_with = [&weights[..], &graph.latents];
        dataset::Codes::save(folder.path(), made_with, &own.latents, &own.nodes).unwrap();
        let found = codes();
        assert!(found.latents.is_mapped() && found.nodes.is_mapped());
        assert!(found.latents == own.latents && found.nodes == own.nodes);
        // Of another graph the latents stay.
        let other = [&weights[..], &graph.latents[2..]];
        dataset::Codes::save(folder.path(), other, &own.latents, &own.nodes).unwrap();
        let found = codes();
        assert!(found.latents.is_mapped() && !found.nodes.is_mapped());
        assert_eq!(found.nodes, own.nodes);
    }
}
