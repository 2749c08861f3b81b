//! The legend of a map, and its scale bar.

use super::frame::Frame;
use super::style::{LEGEND_ROW, LETTER, MARGIN, SIGN, WIDTH, circle, cross, path, way};
use crate::markup::text;

/// Draws the legend below the map, and returns its lowest pixel.
pub(super) fn draw<'p>(
    svg: &mut String,
    frame: &Frame,
    parts: impl Iterator<Item = &'p str>,
) -> f64 {
    let (mut x, mut y) = (MARGIN, frame.y + frame.height + 24.0);
    for word in parts {
        let width = SIGN + LETTER * word.chars().count() as f64;
        if x > MARGIN && x + width > WIDTH - MARGIN {
            (x, y) = (MARGIN, y + LEGEND_ROW);
        }
        let middle = [x + 9.0, y - 4.5];
        let line = format!("M{x:.1} {:.1}h18", middle[1]);
        match word {
            "start" => circle(svg, "start", middle, 4.5),
            "goal" => {
                circle(svg, "zone", middle, 6.5);
                circle(svg, "goal", middle, 2.2);
            }
            "node" => circle(svg, "node", middle, 3.2),
            "edge" => path(svg, "edge", &line),
            "node chosen" => circle(svg, "chosen", middle, 4.2),
            "walked to the goal" => path(svg, way(true), &line),
            _ => {
                path(svg, way(false), &line);
                cross(svg, middle);
            }
        }
        text(svg, [x + SIGN, y], "", word);
        x += width + 12.0;
    }
    scale_bar(svg, frame, [x, y])
}

/// Draws a scale bar to the right of the legend or below it, and returns its lowest pixel.
fn scale_bar(svg: &mut String, frame: &Frame, [x, mut y]: [f64; 2]) -> f64 {
    // The longest round length within a quarter of the map.
    let most = WIDTH / 4.0 / frame.scale;
    let power = 10_f64.powf(most.log10().floor());
    let round = [5.0, 2.0, 1.0].map(|factor| factor * power);
    let length = round.into_iter().find(|length| *length <= most);
    let Some(length) = length.filter(|length| *length >= 0.01) else {
        return y + 4.0;
    };
    let label = format!("{length} m");
    let width = length * frame.scale;
    let all = width + 8.0 + LETTER * label.chars().count() as f64;
    let left = WIDTH - MARGIN - all;
    if left < x {
        y += LEGEND_ROW;
    }
    let ends = y - 4.5;
    let line = format!("M{left:.1} {:.1}v6m0 -3h{width:.1}m0 -3v6", ends - 3.0);
    path(svg, "scale", &line);
    let right = [WIDTH - MARGIN, y];
    text(svg, right, "class=\"faint\" text-anchor=\"end\"", &label);
    y + 4.0
}
