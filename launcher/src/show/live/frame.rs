//! A frame of the view: the layout of its parts, as far as there is room.

use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;
use wire::Phase;

use super::layout::{cut_bottom, cut_left, cut_top, right, write};
use super::style::{Theme, clock};
use super::view::View;
use super::{maze, metrics, processes};

/// Minimum height for gaps between the parts.
const AIRY: u16 = 20;
/// Minimum width for maze and metrics side by side.
const WIDE: u16 = 64;
/// Columns between maze and metrics.
const GUTTER: u16 = 3;

/// Draws a frame.
pub(crate) fn draw(view: &View, frame: &mut Frame) {
    let mut area = frame.area();
    let buffer = frame.buffer_mut();
    let theme = Theme::new(view.colour);
    if area.width >= WIDE {
        (area.x, area.width) = (area.x + 1, area.width - 2);
    }
    let airy = area.height >= AIRY;
    let gap = u16::from(airy);
    header(view, theme, cut_top(&mut area, 1 + gap), buffer);
    if airy {
        footer(theme, cut_bottom(&mut area, 1), buffer);
    }
    cut_top(&mut area, gap);
    let rows = processes::rows(view, area.height / 3);
    processes::draw(view, theme, cut_top(&mut area, rows), buffer);
    cut_top(&mut area, gap);
    let most = match area.height {
        0..8 => 0,
        8..14 => 2,
        14..24 => 4,
        _ => 6,
    };
    let log = log_lines(view, most);
    if !log.is_empty() {
        let mut lines = cut_bottom(&mut area, log.len() as u16 + 1);
        rule(theme, cut_top(&mut lines, 1), buffer);
        for line in log {
            write(line, theme.plain(), cut_top(&mut lines, 1), buffer);
        }
    }
    body(view, theme, area, buffer);
}

/// Draws the maze and the metrics.
fn body(view: &View, theme: Theme, mut area: Rect, buffer: &mut Buffer) {
    if area.width >= WIDE {
        let left = Rect {
            width: area.width / 2,
            ..area
        };
        let map = maze::fit(&view.outline, left);
        maze::draw(view, theme, map, buffer);
        cut_left(&mut area, map.width + GUTTER);
        metrics::draw(view, theme, area, buffer);
    } else {
        let rows = metrics::rows(view).min(area.height / 2);
        metrics::draw(view, theme, cut_top(&mut area, rows), buffer);
        let map = maze::fit(&view.outline, area);
        maze::draw(view, theme, map, buffer);
    }
}

fn header(view: &View, theme: Theme, mut area: Rect, buffer: &mut Buffer) {
    let first = cut_top(&mut area, 1);
    let time = clock(view.passed);
    let mut name = vec![
        Span::styled("formica ", theme.quiet()),
        Span::styled(view.run.clone(), theme.strong()),
    ];
    if area.height == 0 {
        name.push(Span::raw("  "));
        name.extend(phases(view, theme));
    }
    Line::from(name).render(first, buffer);
    right(Span::styled(time, theme.strong()), first, buffer);
    Line::from(phases(view, theme)).render(area, buffer);
    let config = format!("config {}", view.config);
    right(Span::styled(config, theme.quiet()), area, buffer);
}

fn phases(view: &View, theme: Theme) -> Vec<Span<'static>> {
    let mut spans = vec![];
    for phase in view.phases {
        if !spans.is_empty() {
            spans.push(Span::styled(" › ", theme.quiet()));
        }
        let style = match phase {
            now if *now == view.phase => theme.accent().patch(theme.strong()),
            _ => theme.quiet(),
        };
        spans.push(Span::styled(name(*phase), style));
    }
    spans
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Train => "train",
        Phase::Settle => "settle",
        Phase::Evaluate => "evaluate",
        Phase::Finish => "finish",
    }
}

fn footer(theme: Theme, area: Rect, buffer: &mut Buffer) {
    let text = "Ctrl-C or q ends the run in order; launch --resume goes on with it";
    write(text, theme.quiet(), area, buffer);
}

fn rule(theme: Theme, area: Rect, buffer: &mut Buffer) {
    write(&"─".repeat(area.width.into()), theme.quiet(), area, buffer);
}

/// The newest log lines, at most `most`.
fn log_lines(view: &View, most: usize) -> Vec<&str> {
    let lines: Vec<&str> = view.lines.iter().flat_map(|text| text.lines()).collect();
    lines[lines.len().saturating_sub(most)..].to_vec()
}
