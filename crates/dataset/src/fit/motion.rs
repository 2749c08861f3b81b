//! Whether rows follow each other: episodes' ends, velocities, an ant that walks.

use std::ops::Range;

use maze::CONTROL_SECONDS;
use simulator::Body;

use super::frame::Frame;
use super::unfit::{Number, Share, Unfit};
use super::{Expect, sample};
use crate::Dataset;

/// Farthest that a body moves in a step (m): three times what the fastest ants make, and twice what
/// Gymnasium-Robotics' point does at its limit of 5 m/s along each axis.
pub(super) const MOST_STEP: f32 = 1.5;
/// Share of steps that may be jumps: more, and rows are in no order.
const JUMPS: f64 = 0.2;
/// A teleport takes an ant away, and lets it out, this near the cell's centre (m).
const NEAR: f32 = 3.0;
/// Pairs of rows that velocities are compared on, and the least of them that tell.
const PAIRS: usize = 100_000;
const LEAST_PAIRS: usize = 50;
/// Mean square of a velocity that is a walk ((m/s)^2): 0.2 m/s.
const WALK: f64 = 0.04;
/// Velocity over change of place: as it should be, and that of steps of 0.05 s.
const RIGHT: Range<f64> = 0.6..1.5;
const TWICE: Range<f64> = 1.5..2.6;
/// Least share of the velocities' variance that the change of place explains.
const EXPLAINED: f64 = 0.2;
/// Rows ahead, and way within them (m), by which a body is under way, as the graph has it.
const AHEAD: usize = 10;
const WAY: f32 = 0.3;
/// And upright by more than this.
const UPRIGHT: f32 = 0.3;

fn step(data: &Dataset, row: usize) -> f32 {
    let ([x, y], [u, v]) = (data.place(row), data.place(row + 1));
    (x - u).hypot(y - v)
}

/// Rows before a jump of the body within an episode: there an episode ends that the file does not
/// mark. Teleports of the maze are none.
pub(super) fn jumps(
    data: &Dataset,
    expect: &Expect<'_>,
    frame: Frame,
) -> Result<Vec<usize>, Unfit> {
    let layout = expect.layout;
    let near = |row: usize, cells: &[maze::Cell]| {
        let [x, y] = frame.to_own(layout, data.place(row));
        cells.iter().any(|cell| {
            let [u, v] = layout.centre(*cell);
            (x - u).hypot(y - v) < NEAR
        })
    };
    let teleported = |row: usize| near(row, layout.inlets()) && near(row + 1, layout.outlets());
    let steps = data.episodes.iter().flat_map(|e| e.start..e.end - 1);
    let jumps: Vec<usize> = steps
        .filter(|row| step(data, *row) > MOST_STEP && !teleported(*row))
        .collect();
    let share = Share::of(jumps.len(), data.len() - data.episodes.len());
    match jumps.first() {
        Some(&row) if share.0 > JUMPS => Err(Unfit::Shuffled {
            body: expect.body.name(),
            share,
            most: Number(MOST_STEP),
            row,
            jump: Number(step(data, row)),
        }),
        _ => Ok(jumps),
    }
}

/// What velocities say of the places.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Velocities {
    /// The places of a mirrored frame alone are mirrored.
    pub(super) places_alone: bool,
    /// What is to be said.
    pub(super) note: Option<String>,
}

/// Compares the velocities with the places' change, both in the file's own frame.
/// `first` is the column of the velocity in x.
pub(super) fn velocities(data: &Dataset, first: usize, frame: Frame) -> Result<Velocities, Unfit> {
    let steps: Vec<usize> = sample::rows(data.len(), PAIRS)
        .filter(|row| data.steps_left(*row) > 0 && step(data, *row) <= MOST_STEP)
        .collect();
    // Sums of v v, d d and v d, by axis.
    let mut sums = [[0.0_f64; 3]; 2];
    for &row in &steps {
        let (here, there) = (data.observation(row), data.observation(row + 1));
        for axis in 0..2 {
            // What the torso makes on the way, about.
            let v = f64::from(here[first + axis] + there[first + axis]) / 2.0;
            let d = f64::from(there[axis] - here[axis]) / f64::from(CONTROL_SECONDS);
            for (sum, value) in sums[axis].iter_mut().zip([v * v, d * d, v * d]) {
                *sum += value;
            }
        }
    }
    let n = steps.len() as f64;
    let moves = |[_, dd, _]: [f64; 3]| dd / n.max(1.0) > WALK;
    let mut velocities = Velocities {
        places_alone: false,
        note: None,
    };
    if steps.len() < LEAST_PAIRS || !sums.into_iter().any(moves) {
        return Ok(velocities);
    }
    let against = |[vv, dd, vd]: [f64; 3]| vd < 0.0 && vd * vd > EXPLAINED * vv * dd;
    if moves(sums[1]) && against(sums[1]) && !(moves(sums[0]) && against(sums[0])) {
        if !frame.is_mirrored() {
            let how = "the velocity in y has the opposite sign; negate column 1 or column 16";
            return Err(Unfit::Velocity {
                how: how.to_owned(),
            });
        }
        velocities.places_alone = true;
        sums[1][2] = -sums[1][2];
    }
    let [vv, dd, vd]: [f64; 3] = std::array::from_fn(|i| sums[0][i] + sums[1][i]);
    let slope = vd / dd;
    let explained = vd * vd / (vv * dd).max(f64::MIN_POSITIVE);
    if RIGHT.contains(&slope) && explained >= EXPLAINED {
        return Ok(velocities);
    }
    if TWICE.contains(&slope) && explained >= EXPLAINED {
        velocities.note = Some(format!(
            "rows lie {} s apart by their velocities, not {CONTROL_SECONDS} s; places and graph are \
             right, but the low level learns the actions of another ant (Gymnasium's has steps of \
             0.05 s and five times the torque)",
            Number((f64::from(CONTROL_SECONDS) / slope) as f32),
        ));
        return Ok(velocities);
    }
    Err(Unfit::Velocity {
        how: told(slope, explained),
    })
}

/// What a disagreement may mean.
fn told(slope: f64, explained: f64) -> String {
    let times = Number(slope as f32);
    if explained < EXPLAINED {
        return format!(
            "they explain {} of it; expected the velocity in the world's frame, in m/s, in columns \
             15 to 17",
            Share(explained)
        );
    }
    let meaning = match slope {
        s if s < 0.0 => "are x and y, or the order of time, reversed?",
        s if (3.4..4.6).contains(&s) => "are the places in cells of 4 m?",
        s if s > 1.0 => {
            "are the places in a greater unit than metres, or rows less than 0.1 s apart?"
        }
        _ => "are the velocities in a greater unit than m/s, or rows more than 0.1 s apart?",
    };
    format!("they are {times} times it; {meaning}")
}

/// Rows in which the body is under way, as far as it matters whether they are `enough`.
pub(super) fn moving(data: &Dataset, body: &dyn Body, enough: usize) -> usize {
    let moves = |row: &usize| {
        let ([x, y], [u, v]) = (data.place(*row), data.place(row + AHEAD));
        (x - u).hypot(y - v) >= WAY && body.upright(data.observation(*row)) >= UPRIGHT
    };
    let rows = data
        .episodes
        .iter()
        .flat_map(|e| e.start..e.end.saturating_sub(AHEAD).max(e.start));
    rows.filter(moves).take(enough).count()
}
