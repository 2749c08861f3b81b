//! Whether the places are those of the maze: frame of reference, maze, units, far values.

use std::collections::BTreeSet;

use maze::{CELL_SIZE, Layout};

use super::frame::Frame;
use super::sample;
use super::unfit::{Number, Share, Unfit};
use crate::Dataset;

/// Share of rows in walls up to which data fit: the torso of a sound set is never in one.
const FITS: f64 = 0.02;
/// Share up to which they are taken, with a word about it.
const TAKEN: f64 = 0.05;
/// Places farther than this beyond the map are no places (m).
const BEYOND: f32 = CELL_SIZE;
/// Rows that frames are compared on.
const ROWS: usize = 20_000;

/// Units that positions come in by mistake, and what metres are of them.
const UNITS: [(&str, f32); 3] = [
    ("cells of 4 m", CELL_SIZE),
    ("centimetres", 0.01),
    ("millimetres", 0.001),
];

/// The frame of the places, and what is to be said of it.
pub(super) fn judge(
    data: &Dataset,
    maze: &str,
    layout: &Layout,
) -> Result<(Frame, Vec<String>), Unfit> {
    let places: Vec<[f32; 2]> = sample::rows(data.len(), ROWS)
        .map(|row| data.place(row))
        .collect();
    let in_walls =
        |layout: &Layout, frame: Frame| share(&places, |p| frame.to_own(layout, p), layout);
    let own = in_walls(layout, Frame::D4rl);
    let mut notes = vec![];
    let mut frame = Frame::D4rl;
    if own > FITS {
        let other = Frame::ALL[1..]
            .iter()
            .copied()
            .find(|frame| in_walls(layout, *frame) <= FITS);
        match other {
            Some(other) => {
                frame = other;
                notes.push(format!(
                    "recognised {other}: {} of the rows would lie inside walls of '{maze}' in the \
                     project's own, {} do in this one; converted",
                    Share(own),
                    Share(in_walls(layout, other)),
                ));
            }
            None if own <= TAKEN => {
                notes.push(format!(
                    "{} of the rows lie inside walls of '{maze}'",
                    Share(own)
                ));
            }
            None => {
                let instead = instead(&places, maze, layout);
                let far = far(data, maze, layout, Frame::D4rl, instead.as_deref());
                return Err(far
                    .filter(|_| instead.is_none())
                    .unwrap_or_else(|| Unfit::Walls {
                        share: Share(own),
                        maze: maze.to_owned(),
                        instead: instead.unwrap_or_else(|| nothing_fits(data, layout)),
                    }));
            }
        }
    }
    match far(data, maze, layout, frame, None) {
        Some(far) => Err(far),
        None => Ok((frame, notes)),
    }
}

/// Share of places that lie in walls or beyond the map.
fn share(places: &[[f32; 2]], own: impl Fn([f32; 2]) -> [f32; 2], layout: &Layout) -> f64 {
    let stray = places
        .iter()
        .filter(|p| layout.is_wall_at(own(**p)))
        .count();
    Share::of(stray, places.len()).0
}

/// What the places fit, as the second half of a sentence, with what to do.
fn instead(places: &[[f32; 2]], maze: &str, layout: &Layout) -> Option<String> {
    let fits = |share: f64| (share <= FITS).then_some(Share(share));
    for name in Layout::NAMES.iter().filter(|name| **name != maze) {
        let Ok(other) = Layout::named(name) else {
            continue;
        };
        for frame in Frame::ALL {
            let found = fits(share(places, |p| frame.to_own(&other, p), &other));
            if let Some(share) = found {
                let within = match frame {
                    Frame::D4rl => String::new(),
                    frame => format!(" in {frame}"),
                };
                return Some(format!(
                    "they fit '{name}'{within} ({share}); set maze.layout = \"{name}\", or name \
                     data of '{maze}'"
                ));
            }
        }
    }
    for (unit, metres) in UNITS {
        for frame in Frame::ALL {
            let own = |p: [f32; 2]| frame.to_own(layout, p.map(|axis| axis * metres));
            // Anything fits once it is small enough.
            let cells: BTreeSet<_> = places.iter().map(|p| layout.cell_at(own(*p))).collect();
            if let Some(share) = fits(share(places, own, layout)).filter(|_| cells.len() > 2) {
                return Some(format!(
                    "they fit as {unit} ({share}); multiply x, y, z, the velocities and the goals \
                     by {metres} to have metres"
                ));
            }
        }
    }
    let exchanged = share(places, |[x, y]| [y, x], layout);
    fits(exchanged).map(|share| {
        format!("they fit with x and y exchanged ({share}); put the column first that grows with the map's columns")
    })
}

/// The same where nothing fits.
fn nothing_fits(data: &Dataset, layout: &Layout) -> String {
    let mut reach = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
    for row in 0..data.len() {
        for (axis, value) in data.place(row).into_iter().enumerate() {
            reach[0][axis] = reach[0][axis].min(value);
            reach[1][axis] = reach[1][axis].max(value);
        }
    }
    format!(
        "they reach over {} and the map over {}, and they fit no maze that is built in; set \
         maze.layout to theirs, or \"custom\" with its rows",
        words(reach),
        words(bounds(layout)),
    )
}

/// The first row far beyond the map, as an error.
fn far(
    data: &Dataset,
    maze: &str,
    layout: &Layout,
    frame: Frame,
    hint: Option<&str>,
) -> Option<Unfit> {
    let [least, most] = bounds(layout);
    let is_far = |row: &usize| {
        let place = frame.to_own(layout, data.place(*row));
        (0..2).any(|axis| place[axis] < least[axis] - BEYOND || place[axis] > most[axis] + BEYOND)
    };
    let row = (0..data.len()).find(is_far)?;
    let [x, y] = data.place(row).map(Number);
    Some(Unfit::Far {
        row,
        x,
        y,
        maze: maze.to_owned(),
        bounds: words(bounds(layout)),
        count: (row..data.len()).filter(is_far).count(),
        rows: data.len(),
        hint: hint.map_or(String::new(), |hint| format!("; {hint}")),
    })
}

/// Least and greatest place of the map (m): its walls' outer edges.
fn bounds(layout: &Layout) -> [[f32; 2]; 2] {
    let (rows, columns) = layout.shape();
    let half = CELL_SIZE / 2.0;
    [
        layout.centre((0, 0)).map(|axis| axis - half),
        layout
            .centre((rows - 1, columns - 1))
            .map(|axis| axis + half),
    ]
}

fn words([least, most]: [[f32; 2]; 2]) -> String {
    let [left, bottom, right, top] = [least[0], least[1], most[0], most[1]].map(Number);
    format!("x {left} to {right}, y {bottom} to {top} m")
}
