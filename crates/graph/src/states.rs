//! Which states are clustered: those in which the ant is under way, thinned where it often was.

use std::collections::HashMap;
use std::ops::Range;

/// The rule of selection.
#[derive(Debug, Clone, PartialEq)]
pub struct StateRule {
    /// Control steps looked ahead.
    pub ahead: usize,
    /// Least way within them (m).
    pub least_way: f32,
    /// Least upright value: below it the ant lies or tumbles.
    pub least_upright: f32,
    /// States kept of each cell of 0.5 m.
    pub per_place: usize,
}

impl StateRule {
    /// 0.3 m in the next ten steps, upright.
    #[must_use]
    pub fn new(per_place: usize) -> Self {
        Self {
            ahead: 10,
            least_way: 0.3,
            least_upright: 0.3,
            per_place,
        }
    }
}

const CELL: f32 = 0.5;

/// Rows to cluster, in order. `upright` is the torso's up vector's z of each row.
#[must_use]
pub fn select(
    places: &[[f32; 2]],
    upright: impl Fn(usize) -> f32,
    episodes: &[Range<usize>],
    rule: &StateRule,
) -> Vec<usize> {
    let mut rows = vec![];
    for episode in episodes {
        for t in episode.start..episode.end.saturating_sub(rule.ahead) {
            let (here, there) = (places[t], places[t + rule.ahead]);
            let way = (there[0] - here[0]).hypot(there[1] - here[1]);
            if way >= rule.least_way && upright(t) >= rule.least_upright {
                rows.push(t);
            }
        }
    }
    // Every `stride`-th visit to a cell is kept, so that all episodes have their share.
    let cell = |t: usize| places[t].map(|axis| (axis / CELL).floor() as i32);
    let mut visits: HashMap<[i32; 2], usize> = HashMap::new();
    for &t in &rows {
        *visits.entry(cell(t)).or_default() += 1;
    }
    let mut seen: HashMap<[i32; 2], usize> = HashMap::new();
    rows.retain(|&t| {
        let cell = cell(t);
        let stride = visits
            .get(&cell)
            .map_or(1, |count| count.div_ceil(rule.per_place.max(1)));
        let count = seen.entry(cell).or_default();
        *count += 1;
        (*count - 1).is_multiple_of(stride)
    });
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_and_backs_are_left_out_and_crowds_are_thinned() {
        // Walks 0.1 m a step for 100 steps, then stands for 100.
        let places: Vec<[f32; 2]> = (0..200)
            .map(|t| [t.min(100) as f32 * 0.1 + 0.05, 0.2])
            .collect();
        let rule = StateRule::new(2);
        let rows = select(
            &places,
            |t| if t < 20 { -1.0 } else { 1.0 },
            &[0..200],
            &rule,
        );
        assert!(rows.iter().all(|t| (20..98).contains(t)), "{rows:?}");
        let in_cell = |x: f32| {
            rows.iter()
                .filter(|t| (places[**t][0] / 0.5).floor() == (x / 0.5).floor())
                .count()
        };
        assert!((1..=2).contains(&in_cell(5.2)));
        assert!(select(&places, |_| 1.0, &[0..5], &rule).is_empty());
    }
}
