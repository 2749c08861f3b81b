//! k-means with k-means++ seeding (Arthur and Vassilvitskii 2007) and Lloyd's iterations.
//!
//! Seeding and first iterations run on a subsample, the last ones on all points: the same inertia
//! as seeding on all of them, for a tenth of the time.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::assign::squared;
pub use crate::assign::{assign, nearest};

/// How the first centroids are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seeding {
    /// k-means++: far from those found.
    PlusPlus,
    /// Any points, for the ablation.
    Random,
}

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Number of clusters.
    pub k: usize,
    /// Seed of the generator.
    pub seed: u64,
    /// Lloyd iterations on the subsample and on all points, at most.
    pub iterations: usize,
    /// Iterations end when the inertia falls by less than this share.
    pub tolerance: f64,
    /// How the first centroids are found.
    pub seeding: Seeding,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KMeansError {
    /// Not so many different points.
    #[error("{k} clusters of {points} different points; lower graph.nodes or give more data")]
    TooFewPoints {
        /// Clusters asked for.
        k: usize,
        /// Points found, no fewer than the different ones.
        points: usize,
    },
    /// Not whole rows.
    #[error("{values} values are no rows of {dim}; the points' width is wrong")]
    Shape {
        /// Values given.
        values: usize,
        /// Width of a row.
        dim: usize,
    },
    /// A value that is no number.
    #[error("point {row} is not finite; the encoder diverged or the data are damaged")]
    NotFinite {
        /// The first such row.
        row: usize,
    },
}

/// A fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Clusters {
    /// `[k, dim]`.
    pub centroids: Vec<f32>,
    /// Cluster of each point.
    pub assignment: Vec<u32>,
    /// Squared distance of each point to its centroid.
    pub distances: Vec<f32>,
    /// Sum of squared distances to the centroids.
    pub inertia: f64,
    /// Lloyd iterations on all points.
    pub iterations: usize,
}

const SUBSAMPLE: usize = 1 << 16;

/// Clusters `points` (`[n, dim]`).
///
/// # Errors
/// Any of [`KMeansError`].
pub fn fit(points: &[f32], dim: usize, settings: &Settings) -> Result<Clusters, KMeansError> {
    if dim == 0 || !points.len().is_multiple_of(dim) {
        return Err(KMeansError::Shape {
            values: points.len(),
            dim,
        });
    }
    if let Some(at) = points.iter().position(|value| !value.is_finite()) {
        return Err(KMeansError::NotFinite { row: at / dim });
    }
    let n = points.len() / dim;
    let k = settings.k;
    let few = |points| KMeansError::TooFewPoints { k, points };
    if n < k || k == 0 {
        return Err(few(n));
    }
    let mut rng = Pcg64Mcg::seed_from_u64(settings.seed);
    let sample: Vec<f32> = if n > SUBSAMPLE {
        let mut order: Vec<usize> = (0..n).collect();
        let (chosen, _) = order.partial_shuffle(&mut rng, SUBSAMPLE);
        chosen
            .iter()
            .flat_map(|&i| &points[i * dim..(i + 1) * dim])
            .copied()
            .collect()
    } else {
        points.to_vec()
    };
    let mut centroids = match settings.seeding {
        Seeding::PlusPlus => plus_plus(&sample, dim, k, &mut rng).ok_or_else(|| few(n))?,
        Seeding::Random => {
            let mut order: Vec<usize> = (0..sample.len() / dim).collect();
            let (chosen, _) = order.partial_shuffle(&mut rng, k);
            chosen
                .iter()
                .flat_map(|&i| &sample[i * dim..(i + 1) * dim])
                .copied()
                .collect()
        }
    };
    if n > SUBSAMPLE {
        lloyd(&sample, dim, &mut centroids, settings);
    }
    let (assignment, distances, iterations) = lloyd(points, dim, &mut centroids, settings);
    Ok(Clusters {
        centroids,
        inertia: inertia(&distances),
        assignment,
        distances,
        iterations,
    })
}

fn plus_plus(points: &[f32], dim: usize, k: usize, rng: &mut Pcg64Mcg) -> Option<Vec<f32>> {
    let n = points.len() / dim;
    let first = rng.random_range(0..n);
    let mut centroids = points[first * dim..(first + 1) * dim].to_vec();
    let mut nearest = vec![f32::INFINITY; n];
    while centroids.len() < k * dim {
        let newest = centroids[centroids.len() - dim..].to_vec();
        let mut total = 0.0_f64;
        for (point, nearest) in points.chunks_exact(dim).zip(&mut nearest) {
            *nearest = nearest.min(squared(point, &newest));
            total += f64::from(*nearest);
        }
        if total <= 0.0 {
            return None; // Every point is a centroid already.
        }
        let mut left = rng.random::<f64>() * total;
        let mut pick = None;
        for (i, distance) in nearest.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            pick = Some(i);
            left -= f64::from(*distance);
            if left < 0.0 {
                break;
            }
        }
        let pick = pick?;
        centroids.extend_from_slice(&points[pick * dim..(pick + 1) * dim]);
    }
    Some(centroids)
}

/// Lloyd's iterations; a cluster that lost all its points takes the point farthest from its own.
fn lloyd(
    points: &[f32],
    dim: usize,
    centroids: &mut [f32],
    settings: &Settings,
) -> (Vec<u32>, Vec<f32>, usize) {
    let n = points.len() / dim;
    let k = centroids.len() / dim;
    let mut assignment = vec![0; n];
    let mut distance = vec![0.0_f32; n];
    let mut before = f64::INFINITY;
    for iteration in 0.. {
        assign(points, dim, centroids, &mut assignment, &mut distance);
        let inertia = inertia(&distance);
        if iteration >= settings.iterations || before - inertia <= settings.tolerance * inertia {
            return (assignment, distance, iteration);
        }
        before = inertia;
        let mut sums = vec![0.0_f64; k * dim];
        let mut counts = vec![0_u64; k];
        for (point, &cluster) in points.chunks_exact(dim).zip(&assignment) {
            let at = cluster as usize;
            counts[at] += 1;
            for (sum, value) in sums[at * dim..].iter_mut().zip(point) {
                *sum += f64::from(*value);
            }
        }
        for cluster in 0..k {
            let row = cluster * dim..(cluster + 1) * dim;
            if counts[cluster] > 0 {
                let share = 1.0 / counts[cluster] as f64;
                for (c, sum) in centroids[row.clone()].iter_mut().zip(&sums[row]) {
                    *c = (sum * share) as f32;
                }
            } else if let Some(far) = (0..n).max_by(|a, b| distance[*a].total_cmp(&distance[*b])) {
                centroids[row].copy_from_slice(&points[far * dim..(far + 1) * dim]);
                distance[far] = 0.0;
            }
        }
    }
    (assignment, distance, settings.iterations)
}

fn inertia(distances: &[f32]) -> f64 {
    distances.iter().map(|distance| f64::from(*distance)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(k: usize, seeding: Seeding) -> Settings {
        Settings {
            k,
            seed: 0,
            iterations: 50,
            tolerance: 1e-5,
            seeding,
        }
    }

    fn blobs(n: usize) -> Vec<f32> {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        (0..n)
            .flat_map(|i| {
                let (x, y) = ((i % 5) as f32 * 10.0, (i % 3) as f32 * 10.0);
                [
                    x + rng.random_range(-1.0..1.0),
                    y + rng.random_range(-1.0..1.0_f32),
                ]
            })
            .collect()
    }

    #[test]
    fn separated_blobs_are_found() {
        let clusters = fit(&blobs(3000), 2, &settings(15, Seeding::PlusPlus)).unwrap();
        assert!(clusters.inertia < 3000.0 * 0.8, "{}", clusters.inertia);
        let mut corners: Vec<(i32, i32)> = clusters
            .centroids
            .chunks(2)
            .map(|c| ((c[0] / 10.0).round() as i32, (c[1] / 10.0).round() as i32))
            .collect();
        corners.sort_unstable();
        corners.dedup();
        assert_eq!(corners.len(), 15);
    }

    #[test]
    fn plus_plus_beats_random_seeds() {
        let mean = |seeding| {
            let of = |seed| {
                let settings = Settings {
                    seed,
                    iterations: 0,
                    ..settings(15, seeding)
                };
                fit(&blobs(900), 2, &settings).unwrap().inertia
            };
            (0..8).map(of).sum::<f64>()
        };
        assert!(mean(Seeding::PlusPlus) < mean(Seeding::Random));
    }

    #[test]
    fn more_clusters_than_points_is_an_error() {
        let points = [1.0_f32, 1.0, 1.0, 2.0];
        assert!(fit(&points, 1, &settings(5, Seeding::PlusPlus)).is_err());
        assert!(fit(&points, 1, &settings(3, Seeding::PlusPlus)).is_err());
        assert!(fit(&points, 1, &settings(2, Seeding::PlusPlus)).is_ok());
        let fit = |points: &[f32], dim| fit(points, dim, &settings(2, Seeding::PlusPlus));
        assert_eq!(
            fit(&points, 3),
            Err(KMeansError::Shape { values: 4, dim: 3 })
        );
        assert!(matches!(fit(&points, 0), Err(KMeansError::Shape { .. })));
        let bad = [1.0, 2.0, f32::NAN];
        assert_eq!(fit(&bad, 1), Err(KMeansError::NotFinite { row: 2 }));
    }
}
