//! Nearest centroids of many points: the inner loop of k-means, and how data find their nodes.
//!
//! A vector lane is a point: the running minimum and its index stay in registers, and neither a
//! matrix of distances nor a reduction across lanes is needed.

use pulp::{Arch, Simd, WithSimd};

/// Centroids taken at once, so that a point's values are loaded once for all of them.
const TOGETHER: usize = 4;
/// Vectors of points taken at once: two hide the latency of the multiply-adds.
const VECTORS: usize = 2;

/// Nearest centroid of each point and the squared distance to it.
///
/// `points` is `[n, dim]`, `centroids` `[k, dim]`, `assignment` and `distance` `[n]`; the shortest
/// of them says how many points are done. With no centroid every point goes to 0, infinitely far.
/// Among equally near ones the first wins.
pub fn assign(
    points: &[f32],
    dim: usize,
    centroids: &[f32],
    assignment: &mut [u32],
    distance: &mut [f32],
) {
    if dim == 0 || centroids.len() < dim {
        assignment.fill(0);
        distance.fill(f32::INFINITY);
        return;
    }
    let halves: Vec<f32> = centroids
        .chunks_exact(dim)
        .map(|centroid| 0.5 * centroid.iter().map(|v| v * v).sum::<f32>())
        .collect();
    Arch::new().dispatch(Kernel {
        points,
        dim,
        centroids,
        halves: &halves,
        assignment,
    });
    // The kernel's |c|^2/2 - x.c cancels near a centroid: the distance itself is taken anew.
    let found = points.chunks_exact(dim).zip(&*assignment).zip(distance);
    for ((point, &cluster), distance) in found {
        let start = cluster as usize * dim;
        *distance = squared(point, &centroids[start..start + dim]);
    }
}

/// The nearest of `centroids` (`[k, dim]`) and the squared distance to it; (0, infinity) where
/// there is none.
#[must_use]
pub fn nearest(centroids: &[f32], dim: usize, point: &[f32]) -> (u32, f32) {
    let mut best = (0, f32::INFINITY);
    for (i, centroid) in centroids.chunks_exact(dim.max(1)).enumerate() {
        let distance = squared(centroid, point);
        if distance < best.1 {
            best = (i as u32, distance);
        }
    }
    best
}

pub(crate) fn squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

struct Kernel<'a> {
    points: &'a [f32],
    dim: usize,
    centroids: &'a [f32],
    /// |c|^2 / 2 of each centroid.
    halves: &'a [f32],
    assignment: &'a mut [u32],
}

impl WithSimd for Kernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            points,
            dim,
            centroids,
            halves,
            assignment,
        } = self;
        let width = VECTORS * S::F32_LANES;
        // One block of points, negated, value by value: `[dim, width]`.
        let mut tile = vec![0.0_f32; dim * width];
        let mut winners = vec![0_u32; width];
        for (block, assignment) in points.chunks(width * dim).zip(assignment.chunks_mut(width)) {
            for (lane, point) in block.chunks_exact(dim).enumerate() {
                for (i, value) in point.iter().enumerate() {
                    tile[i * width + lane] = -value;
                }
            }
            let (x, _) = S::as_simd_f32s(&tile);
            let best = simd.splat_f32s(f32::INFINITY);
            let mut search = Search {
                simd,
                best: [best; VECTORS],
                index: [simd.splat_u32s(0); VECTORS],
            };
            let whole = halves.len() / TOGETHER * TOGETHER;
            for first in (0..whole).step_by(TOGETHER) {
                search.take::<TOGETHER>(x, dim, centroids, halves, first);
            }
            for first in whole..halves.len() {
                search.take::<1>(x, dim, centroids, halves, first);
            }
            let (slots, _) = S::as_mut_simd_u32s(&mut winners);
            for (slot, index) in slots.iter_mut().zip(search.index) {
                *slot = index;
            }
            for (to, from) in assignment.iter_mut().zip(&winners) {
                *to = *from;
            }
        }
    }
}

struct Search<S: Simd> {
    simd: S,
    best: [S::f32s; VECTORS],
    index: [S::u32s; VECTORS],
}

impl<S: Simd> Search<S> {
    /// Compares `C` centroids from `first` on.
    #[inline(always)]
    fn take<const C: usize>(
        &mut self,
        x: &[S::f32s],
        dim: usize,
        centroids: &[f32],
        halves: &[f32],
        first: usize,
    ) {
        let simd = self.simd;
        let rows = &centroids[first * dim..(first + C) * dim];
        // Plain loops: a closure here would not be compiled for the vector unit.
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; C];
        for c in 0..C {
            sums[c] = [simd.splat_f32s(halves[first + c]); VECTORS];
        }
        for (i, values) in x.as_chunks::<VECTORS>().0.iter().enumerate() {
            for c in 0..C {
                let centroid = simd.splat_f32s(rows[c * dim + i]);
                for v in 0..VECTORS {
                    sums[c][v] = simd.mul_add_e_f32s(values[v], centroid, sums[c][v]);
                }
            }
        }
        for c in 0..C {
            let number = simd.splat_u32s((first + c) as u32);
            for v in 0..VECTORS {
                let sum = sums[c][v];
                let nearer = simd.less_than_f32s(sum, self.best[v]);
                // pulp's select_f32s is a call where this one is an instruction.
                self.best[v] = simd.min_f32s(sum, self.best[v]);
                self.index[v] = simd.select_u32s(nearer, number, self.index[v]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Widths, cluster and point counts that leave remainders in every loop.
    #[test]
    fn blocks_find_what_a_plain_search_finds() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        for (n, k, dim) in [
            (1, 1, 1),
            (33, 7, 3),
            (700, 9, 2),
            (257, 201, 8),
            (64, 4, 16),
        ] {
            let mut draw = |n| {
                (0..n * dim)
                    .map(|_| rng.random_range(-3.0..3.0))
                    .collect::<Vec<f32>>()
            };
            let (points, centroids) = (draw(n), draw(k));
            let (mut assignment, mut distance) = (vec![9; n], vec![9.0; n]);
            assign(&points, dim, &centroids, &mut assignment, &mut distance);
            for (i, point) in points.chunks(dim).enumerate() {
                let (_, exact) = nearest(&centroids, dim, point);
                let at = assignment[i] as usize * dim;
                assert_eq!(distance[i], squared(point, &centroids[at..at + dim]));
                assert!(
                    distance[i] - exact < 1e-4,
                    "{n} {k} {dim}: {exact} {}",
                    distance[i]
                );
            }
        }
    }

    #[test]
    fn the_first_of_equals_wins_and_no_centroid_is_no_panic() {
        let (mut assignment, mut distance) = ([7; 3], [7.0; 3]);
        assign(
            &[1.0, 2.0, 3.0],
            1,
            &[2.0; 6],
            &mut assignment,
            &mut distance,
        );
        assert_eq!((assignment, distance), ([0; 3], [1.0, 0.0, 1.0]));
        assign(&[1.0, 2.0, 3.0], 1, &[], &mut assignment, &mut distance);
        assert_eq!((assignment, distance), ([0; 3], [f32::INFINITY; 3]));
        assert_eq!(nearest(&[], 2, &[1.0, 1.0]), (0, f32::INFINITY));
    }
}
