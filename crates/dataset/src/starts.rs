//! Rows with a fixed number of rows after them in their episode.

use std::ops::Range;

use rand::{Rng, RngExt};

/// Draws rows that have at least `lag` rows after them in their episode, all alike.
#[derive(Debug, Clone)]
pub struct Starts {
    /// First row of each episode, its end, and how many starts the episodes before it have.
    episodes: Vec<(usize, usize, usize)>,
    total: usize,
}

impl Starts {
    /// None when no episode is longer than `lag` rows.
    #[must_use]
    pub fn new(episodes: &[Range<usize>], lag: usize) -> Option<Self> {
        let mut starts = vec![];
        let mut total = 0;
        for episode in episodes.iter().filter(|episode| episode.len() > lag) {
            starts.push((episode.start, episode.end, total));
            total += episode.len() - lag;
        }
        (total > 0).then_some(Self {
            episodes: starts,
            total,
        })
    }

    /// A row and the end of its episode.
    pub fn draw(&self, rng: &mut impl Rng) -> (usize, usize) {
        let pick = rng.random_range(0..self.total);
        let at = self
            .episodes
            .partition_point(|(_, _, before)| *before <= pick)
            - 1;
        let (start, end, before) = self.episodes[at];
        (start + pick - before, end)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn starts_never_reach_beyond_an_episode_and_miss_none() {
        let starts = Starts::new(&[0..3, 3..10, 10..15], 4).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut seen = [0; 15];
        for _ in 0..4000 {
            let (row, end) = starts.draw(&mut rng);
            assert!(row + 4 < end);
            seen[row] += 1;
        }
        let rows: Vec<usize> = (0..15).filter(|row| seen[*row] > 0).collect();
        assert_eq!(rows, [3, 4, 5, 10]);
        assert!(
            rows.iter().all(|row| (850..1150).contains(&seen[*row])),
            "{seen:?}"
        );
        assert!(Starts::new(&[0..3], 3).is_none());
    }
}
