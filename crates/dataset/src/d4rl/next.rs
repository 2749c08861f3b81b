//! `next_observations`: the state after each row's action, which tells where episodes end.

use crate::OnFault;
use crate::fault::Faults;
use crate::hdf5::{Key, Reader};

/// Values this near each other are one (a share of the value, and an absolute one below 1).
const SAME: f32 = 1e-3;

/// Marks the rows whose next state is not the row after. An array that cannot be read, or that is
/// the next row in fewer than half of the rows, tells nothing.
pub(super) fn mark(
    reader: &Reader<'_>,
    key: Option<&Key>,
    observations: &[f32],
    last: &mut [bool],
) {
    let Some(key) = key else { return };
    let Ok([next]) = reader.values::<f32, 1>([key], &Faults::new(OnFault::Refuse)) else {
        return;
    };
    let rows = observations.chunks_exact(key.width).skip(1);
    let ends: Vec<bool> = next
        .chunks_exact(key.width)
        .zip(rows)
        .map(|(next, row)| next.iter().zip(row).any(|(a, b)| !is_same(*a, *b)))
        .collect();
    let count = ends.iter().filter(|end| **end).count();
    if 2 * count > ends.len() {
        return;
    }
    for (last, end) in last.iter_mut().zip(ends) {
        *last |= end;
    }
}

fn is_same(a: f32, b: f32) -> bool {
    (a - b).abs() <= SAME * a.abs().max(1.0)
}
