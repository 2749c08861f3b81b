//! Whether the columns are those of a body that moves freely: quaternion, height, joints; and whether values and
//! actions of any body are within bounds.

use super::sample;
use super::unfit::{Number, Share, Unfit};
use crate::Dataset;

/// Rows that are looked at.
const ROWS: usize = 50_000;
/// Share of rows that may be odd: a simulation that blew up is no wrong column.
const ODD: f64 = 0.05;
/// First column of the quaternion, and of the joint angles.
const QUATERNION: usize = 3;
const JOINTS: usize = 7;
/// Norms of a quaternion, as far as reset noise and half floats take them from 1.
const NORMS: std::ops::RangeInclusive<f32> = 0.8..=1.25;
/// Heights of a torso (m).
const HEIGHTS: std::ops::RangeInclusive<f32> = -0.05..=2.5;
/// A limb is pushed so far out of its range at most (rad).
const MARGIN: f32 = 1.5;
/// Heights, angles and speeds (m, rad, s) are never larger.
const LARGEST_VALUE: f32 = 1e4;
/// Values of an action, with what rounding adds.
const LARGEST_ACTION: f32 = 1.01;
/// The z of the up vector of an ant that stands.
const UPRIGHT: f32 = 0.7;

/// Everything that is wrong with the columns of the observations.
pub(super) fn observations(data: &Dataset, joints: &[[f32; 2]]) -> Result<(), Unfit> {
    let rows: Vec<usize> = sample::rows(data.len(), ROWS).collect();
    let share = |odd: &dyn Fn(&[f32]) -> bool| {
        let count = rows.iter().filter(|row| odd(data.observation(**row)));
        Share::of(count.count(), rows.len())
    };
    let norm = |o: &[f32], first: usize| {
        let squares = o[first..first + 4].iter().map(|v| v * v);
        squares.sum::<f32>().sqrt()
    };
    let no_rotation = |first: usize| share(&move |o| !NORMS.contains(&norm(o, first)));
    let odd = no_rotation(QUATERNION);
    if odd.0 > ODD {
        let found = (0..=25).find(|first| no_rotation(*first).0 <= ODD);
        let found = found.map_or(String::new(), |first| {
            format!("; columns {first} to {} hold one", first + 3)
        });
        return Err(Unfit::Quaternion { share: odd, found });
    }
    // 1 - 2 (x^2 + y^2), by where x and y stand.
    let upright =
        |x: usize| share(&move |o| 1.0 - 2.0 * (o[x] * o[x] + o[x + 1] * o[x + 1]) > UPRIGHT);
    let (first, last) = (upright(QUATERNION + 1), upright(QUATERNION));
    // With w last, ants of all headings look upright in a quarter of the rows.
    if last.0 > 0.6 && first.0 < 0.4 {
        return Err(Unfit::QuaternionOrder { first, last });
    }
    let odd = share(&|o| !HEIGHTS.contains(&o[2]));
    if odd.0 > ODD {
        let mut heights: Vec<f32> = rows.iter().map(|row| data.observation(*row)[2]).collect();
        heights.sort_by(f32::total_cmp);
        let median = heights.get(heights.len() / 2).copied().unwrap_or(0.0);
        return Err(Unfit::Height {
            share: odd,
            median: Number(median),
        });
    }
    let stray = |o: &[f32]| {
        let angles = o[JOINTS..].iter().zip(joints);
        let mut far =
            angles.map(|(angle, [least, most])| *angle < least - MARGIN || *angle > most + MARGIN);
        far.position(|far| far).map(|joint| JOINTS + joint)
    };
    let odd = share(&|o| stray(o).is_some());
    let first = rows
        .iter()
        .find_map(|row| Some((*row, stray(data.observation(*row))?)));
    match first.filter(|_| odd.0 > ODD) {
        Some((row, column)) => Err(Unfit::Joints {
            share: odd,
            row,
            column,
            value: Number(data.observation(row)[column]),
        }),
        None => Ok(()),
    }
}

/// A row with a value that no body has, in any column but the place's own.
pub(super) fn values(data: &Dataset) -> Result<(), Unfit> {
    let huge = |row: usize| {
        let rest = &data.observation(row)[2..];
        rest.iter().position(|value| value.abs() > LARGEST_VALUE)
    };
    let found = (0..data.len()).find_map(|row| Some((row, huge(row)? + 2)));
    match found {
        Some((row, column)) => Err(Unfit::Huge {
            row,
            column,
            value: Number(data.observation(row)[column]),
            count: (row..data.len()).filter(|row| huge(*row).is_some()).count(),
            rows: data.len(),
        }),
        None => Ok(()),
    }
}

/// Everything that is wrong with the actions. Episodes' last rows do not count: no state follows
/// them, and some formats fill them up.
pub(super) fn actions(data: &Dataset) -> Result<(), Unfit> {
    let rows = || {
        let followed = |episode: &std::ops::Range<usize>| episode.start..episode.end - 1;
        data.episodes.iter().flat_map(followed)
    };
    let largest = |row: usize| {
        let magnitudes = data.action(row).iter().map(|value| value.abs());
        magnitudes.fold(0.0_f32, f32::max)
    };
    let odd = |row: &usize| largest(*row) > LARGEST_ACTION;
    let share = Share::of(rows().filter(odd).count(), rows().count());
    if let Some(row) = rows().find(odd).filter(|_| share.0 > ODD / 5.0) {
        let value = data
            .action(row)
            .iter()
            .copied()
            .find(|v| v.abs() > LARGEST_ACTION);
        return Err(Unfit::ActionRange {
            share,
            row,
            value: Number(value.unwrap_or_default()),
            largest: Number(rows().map(largest).fold(0.0, f32::max)),
        });
    }
    let Some(first) = rows().next() else {
        return Ok(());
    };
    if rows().count() > 1 && rows().all(|row| data.action(row) == data.action(first)) {
        let value = Number(data.action(first)[0]);
        return Err(Unfit::SameAction { value });
    }
    Ok(())
}
