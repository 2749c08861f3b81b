//! Values as pixels of the image.

use std::fmt::Write;

use super::series::Series;
use super::shape::Sizes;
use crate::axis::{labels, ticks};

/// Width of a character of a tick label (px).
const LETTER: f64 = 7.5;

/// Maps values to pixels.
pub(super) struct Frame {
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
}

/// What the axes must show.
pub(super) struct Axes<'c> {
    pub(super) series: &'c [Series],
    pub(super) x_end: f64,
    pub(super) y_range: Option<[f64; 2]>,
    pub(super) y_label: &'c str,
}

impl Frame {
    /// Axes that all series fit in, with the top of the plot area at `top`.
    pub(super) fn new(axes: &Axes, sizes: &Sizes, top: f64) -> Self {
        let lines = |series: &Series| -> Vec<f64> {
            let points = series.thin.iter().flatten();
            let points = points.chain(&series.bold).chain(&series.dots);
            points.map(|[_, y]| *y).collect()
        };
        let mut values: Vec<f64> = axes.series.iter().flat_map(lines).collect();
        let bands = axes.series.iter().flat_map(|series| &series.band);
        let bands = bands.flat_map(|[_, low, high]| [*low, *high]);
        match axes.y_range {
            Some(range) => values.extend(range),
            None => values.extend(bands),
        }
        let low = values.iter().copied().reduce(f64::min).unwrap_or(0.0);
        let high = values.iter().copied().reduce(f64::max).unwrap_or(0.0);
        let y = ticks(low, high, sizes.intervals[1]);
        let longest = labels(&y).iter().map(|label| label.chars().count()).max();
        let label = if axes.y_label.is_empty() { 10.0 } else { 30.0 };
        Self {
            x: ticks(0.0, axes.x_end, sizes.intervals[0]),
            y,
            left: sizes.margin + label + LETTER * longest.unwrap_or(0) as f64,
            right: sizes.width - sizes.margin,
            top,
            bottom: top + sizes.height,
        }
    }

    pub(super) fn x(&self, value: f64) -> f64 {
        self.left + share(&self.x, value) * (self.right - self.left)
    }

    pub(super) fn y(&self, value: f64) -> f64 {
        self.bottom + share(&self.y, value) * (self.top - self.bottom)
    }

    /// A path through points. A single point becomes a dot of the line's width.
    pub(super) fn path(&self, points: impl Iterator<Item = [f64; 2]>) -> String {
        let mut text = String::new();
        for [x, y] in points {
            let letter = if text.is_empty() { 'M' } else { 'L' };
            let _ = write!(text, "{letter}{:.1} {:.1}", self.x(x), self.y(y));
        }
        if !text.is_empty() && !text.contains('L') {
            text.push_str("h0");
        }
        text
    }
}

/// Position of a value between the first and the last tick, from 0 to 1.
fn share(ticks: &[f64], value: f64) -> f64 {
    let (low, high) = (ticks[0], ticks[ticks.len() - 1]);
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}
