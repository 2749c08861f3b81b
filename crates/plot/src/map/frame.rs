//! Positions of the maze as pixels of the image.

use super::style::{MAP_HEIGHT, MARGIN, WIDTH};

/// Maps metres to pixels. y points up in a maze and down in an image.
pub(super) struct Frame {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) scale: f64,
    /// Left and top of the map (px).
    pub(super) x: f64,
    pub(super) y: f64,
    /// Height of the map (px).
    pub(super) height: f64,
}

impl Frame {
    /// A frame around points; `None` if there are none, or they are not finite.
    pub(super) fn around(points: impl Iterator<Item = [f64; 2]>, y: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if !low.iter().chain(&high).all(|bound| bound.is_finite()) {
            return None;
        }
        // A single point gets a square metre.
        let [width, depth] = [0, 1].map(|axis| (high[axis] - low[axis]).max(1.0));
        let room = WIDTH - 2.0 * MARGIN;
        let scale = (room / width).min(MAP_HEIGHT / depth);
        Some(Self {
            left: low[0],
            top: high[1],
            scale,
            x: MARGIN + (room - scale * width) / 2.0,
            y,
            height: scale * depth,
        })
    }

    pub(super) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.x + (x - self.left) * self.scale,
            self.y + (self.top - y) * self.scale,
        ]
    }
}

/// A point whose coordinates are finite.
pub(super) fn finite(point: [f32; 2]) -> Option<[f64; 2]> {
    let whole = point.iter().all(|value| value.is_finite());
    whole.then(|| point.map(f64::from))
}

/// A line through points, broken where it jumps farther than `jump`. Points within a tenth of a pixel
/// of the last one are left out.
pub(super) fn line(frame: &Frame, points: impl Iterator<Item = [f64; 2]>, jump: f64) -> String {
    let mut line = String::new();
    let mut last: Option<([f64; 2], String)> = None;
    for point in points {
        let [x, y] = frame.at(point);
        let text = format!("{x:.1} {y:.1}");
        let letter = match &last {
            Some((_, before)) if *before == text => continue,
            Some((before, _)) if (point[0] - before[0]).hypot(point[1] - before[1]) <= jump => 'L',
            _ => 'M',
        };
        line.push(letter);
        line.push_str(&text);
        last = Some((point, text));
    }
    line
}
