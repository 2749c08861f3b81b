//! The maze from above, with the ants.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Line, Points};

use super::style::Theme;
use super::view::{MazeOutline, View};

/// Minimum rows and columns.
const LEAST: u16 = 3;
/// Height of a character, in widths.
const HIGH: f64 = 2.0;

/// The largest part of an area with the proportions of the maze.
pub(super) fn fit(outline: &MazeOutline, area: Rect) -> Rect {
    let [left, low, right, high] = outline.bounds;
    let (wide, high) = (right - left, (high - low) / HIGH);
    let scale = (f64::from(area.width) / wide).min(f64::from(area.height) / high);
    let cells = |length: f64| (length * scale).round() as u16;
    let (width, height) = (cells(wide).min(area.width), cells(high).min(area.height));
    if width < LEAST || height < LEAST {
        return Rect { width: 0, ..area };
    }
    Rect {
        width,
        height,
        ..area
    }
}

/// Draws the maze, start, goals and ants.
pub(super) fn draw(view: &View, theme: Theme, area: Rect, buffer: &mut Buffer) {
    if area.is_empty() {
        return;
    }
    let outline = &*view.outline;
    let [left, low, right, high] = outline.bounds;
    let trails = view.ants.iter().map(|ant| {
        let holds = |place: &&[f32; 2]| outline.holds(**place);
        let places = ant.trail.iter().filter(holds);
        let points: Vec<(f64, f64)> = places
            .map(|[x, y]| (f64::from(*x), f64::from(*y)))
            .collect();
        (theme.ant(ant.id), points)
    });
    let trails: Vec<_> = trails.collect();
    Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([left, right])
        .y_bounds([low, high])
        .paint(|context| {
            for [x1, y1, x2, y2] in &outline.walls {
                context.draw(&Line::new(*x1, *y1, *x2, *y2, theme.wall()));
            }
            for (color, coords) in &trails {
                context.draw(&Points {
                    coords,
                    color: *color,
                });
            }
        })
        .render(area, buffer);
    let mut put = |place: [f64; 2], text: &str, style: Style| {
        let (x, y) = cell(outline, place, area);
        let room = usize::from(area.right() - x);
        buffer.set_stringn(x, y, text, room, style);
    };
    put(outline.start, "S", theme.quiet());
    for goal in &outline.goals {
        put(*goal, "G", theme.good().add_modifier(Modifier::BOLD));
    }
    for ant in &view.ants {
        if let Some(place) = ant.trail.last().filter(|place| outline.holds(**place)) {
            let style = Style::new()
                .fg(theme.ant(ant.id))
                .add_modifier(Modifier::BOLD);
            put(place.map(f64::from), &format!("●{}", ant.id), style);
        }
    }
}

/// Column and row of a position. y points up, as in all maps.
pub(super) fn cell(outline: &MazeOutline, place: [f64; 2], area: Rect) -> (u16, u16) {
    let [left, low, right, high] = outline.bounds;
    let along = |at: f64, from: f64, to: f64, cells: u16| {
        let cell = (at - from) / (to - from) * f64::from(cells);
        (cell as u16).min(cells.saturating_sub(1))
    };
    (
        area.x + along(place[0], left, right, area.width),
        area.y + along(-place[1], -high, -low, area.height),
    )
}
