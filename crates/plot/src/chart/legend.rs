//! The legend of a chart.

use std::fmt::Write;

use super::series::{Series, stroke};
use super::shape::Sizes;
use crate::markup::text;

const LEGEND_ROW: f64 = 22.0;

/// Draws the legend with its first row at `y`, and returns the height of the image.
pub(super) fn draw(svg: &mut String, series: &[Series], sizes: &Sizes, mut y: f64) -> f64 {
    let margin = sizes.margin;
    for (i, series) in series.iter().enumerate() {
        let line = stroke(i, [margin + 2.0, y - 4.5]);
        let _ = writeln!(svg, "{line}");
        let mut label = series.label.clone();
        if let Some((end, _)) = label.char_indices().nth(sizes.label) {
            label.truncate(end);
            label.push('…');
        }
        text(svg, [margin + 42.0, y], "", &label);
        if sizes.beneath && !series.note.is_empty() {
            y += 16.0;
            text(svg, [margin + 42.0, y], "class=\"faint\"", &series.note);
        } else {
            let right = [sizes.width - margin, y];
            text(svg, right, "text-anchor=\"end\"", &series.note);
        }
        y += LEGEND_ROW;
    }
    y
}
