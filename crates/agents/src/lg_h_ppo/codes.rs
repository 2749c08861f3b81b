//! Latents and nearest nodes of all rows, from the graph-builder's file or computed here.

use std::path::Path;

use dataset::{Array, Dataset};
use graph::{Graph, Nearest};

use super::vae::Encoder;

/// Inputs of the low level, by row.
pub(super) struct Codes {
    /// `[n, latent]`.
    pub(super) latents: Array<f32>,
    /// Nearest node of the graph.
    pub(super) nodes: Array<u32>,
}

/// Returns the codes for an encoder with these weights and a graph. The graph-builder writes the file
/// before it publishes the graph, so there is nothing to wait for. The file is missing if the disk was
/// full, and after a restart it may be for another graph; then the codes are computed.
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
            log::info!("the run's folder has no latents of this encoder; computing them");
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

    /// Rows along a line, with a graph of three nodes. Latents are positions.
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
    fn mapped_codes_equal_computed_ones() {
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
        // For another graph only the latents are used.
        let other = [&weights[..], &graph.latents[2..]];
        dataset::Codes::save(folder.path(), other, &own.latents, &own.nodes).unwrap();
        let found = codes();
        assert!(found.latents.is_mapped() && !found.nodes.is_mapped());
        assert_eq!(found.nodes, own.nodes);
    }
}
