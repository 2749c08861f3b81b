//! Data sets for tests.

use crate::{Dataset, Element, Shape};

/// Episodes along the given places by an ant that stands, all else zero.
pub(crate) fn along(episodes: &[&[[f32; 2]]]) -> Dataset {
    let mut data = Dataset::new(Shape::ant());
    for places in episodes {
        for [x, y] in *places {
            let mut observation = [0.0; maze::OBSERVATION];
            (observation[0], observation[1], observation[3]) = (*x, *y, 1.0);
            data.observations.extend(observation);
            data.actions.extend([0.0; maze::ACTION]);
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.end_episode();
    }
    data
}

/// Episodes of these lengths of an ant whose values all differ, by no more than a step's way.
pub(crate) fn varied(lengths: &[usize]) -> Dataset {
    of(&Shape::ant(), lengths)
}

/// The same in any shape.
pub(crate) fn of(shape: &Shape, lengths: &[usize]) -> Dataset {
    // Scattered, so that they deflate no better than real ones.
    let bits = |at: usize| {
        let bits = (at as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9)
    };
    let value = |at: usize| (bits(at) >> 40) as f32 / 1e7 - 0.8;
    let pair = |row: usize, n: usize| [value(row), value(row + n)];
    let n: usize = lengths.iter().sum();
    let mut data = Dataset::new(shape.clone());
    match shape.element() {
        Element::F32 => data.observations = (0..n * shape.observation()).map(value).collect(),
        Element::U8 => {
            let values = 0..n * shape.observation();
            data.images = values.map(|at| (bits(at) >> 56) as u8).collect();
            data.image_places = (0..n).map(|row| pair(row, 2 * n)).collect();
        }
    }
    data.actions = (0..n * shape.action()).map(value).collect();
    data.rewards = (0..n).map(value).collect();
    data.terminals = (0..n).map(|row| row % 3 == 1).collect();
    data.goals = (0..n).map(|row| pair(row, n)).collect();
    let mut start = 0;
    for length in lengths {
        data.episodes.push(start..start + length);
        start += length;
    }
    data
}

/// Panics unless the arrays are of one length and the episodes are all rows.
pub(crate) fn sound(data: &Dataset) {
    let (n, shape) = (data.len(), data.shape());
    let images = shape.element() == Element::U8;
    let [vectors, pictures] = if images { [0, n] } else { [n, 0] };
    assert_eq!(data.observations.len(), vectors * shape.observation());
    assert_eq!(data.images.len(), pictures * shape.observation());
    assert_eq!(data.image_places.len(), pictures);
    assert_eq!(data.actions.len(), n * shape.action());
    assert_eq!(data.terminals.len(), n);
    assert!(data.goals.is_empty() || data.goals.len() == n);
    let mut end = 0;
    for episode in &data.episodes {
        assert!(episode.start == end && episode.end > end, "{episode:?}");
        end = episode.end;
    }
    assert!(n > 0 && end == n);
}
