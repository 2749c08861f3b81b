//! A frame of the view: what stands where, as far as there is room.

use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;
use wire::Phase;

use super::ink::{Ink, clock};
use super::view::View;
use super::{figures, floor, processes};

/// From this height on there are gaps between the parts.
const AIRY: u16 = 20;
/// From this width on maze and figures stand side by side.
const WIDE: u16 = 64;
/// Between maze and figures.
const GUTTER: u16 = 3;

/// Draws all of it.
pub(crate) fn draw(view: &View, frame: &mut Frame) {
    let mut area = frame.area();
    let buffer = frame.buffer_mut();
    let ink = Ink::new(view.colour);
    if area.width >= WIDE {
        (area.x, area.width) = (area.x + 1, area.width - 2);
    }
    let airy = area.height >= AIRY;
    let gap = u16::from(airy);
    header(view, ink, cut_top(&mut area, 1 + gap), buffer);
    if airy {
        footer(ink, cut_bottom(&mut area, 1), buffer);
    }
    cut_top(&mut area, gap);
    let rows = processes::rows(view, area.height / 3);
    processes::draw(view, ink, cut_top(&mut area, rows), buffer);
    cut_top(&mut area, gap);
    let most = match area.height {
        0..8 => 0,
        8..14 => 2,
        14..24 => 4,
        _ => 6,
    };
    let said = said(view, most);
    if !said.is_empty() {
        let mut lines = cut_bottom(&mut area, said.len() as u16 + 1);
        rule(ink, cut_top(&mut lines, 1), buffer);
        for line in said {
            write(line, ink.plain(), cut_top(&mut lines, 1), buffer);
        }
    }
    body(view, ink, area, buffer);
}

/// The maze and the figures.
fn body(view: &View, ink: Ink, mut area: Rect, buffer: &mut Buffer) {
    if area.width >= WIDE {
        let left = Rect {
            width: area.width / 2,
            ..area
        };
        let maze = floor::fit(&view.floor, left);
        floor::draw(view, ink, maze, buffer);
        cut_left(&mut area, maze.width + GUTTER);
        figures::draw(view, ink, area, buffer);
    } else {
        let rows = figures::rows(view).min(area.height / 2);
        figures::draw(view, ink, cut_top(&mut area, rows), buffer);
        let maze = floor::fit(&view.floor, area);
        floor::draw(view, ink, maze, buffer);
    }
}

fn header(view: &View, ink: Ink, mut area: Rect, buffer: &mut Buffer) {
    let first = cut_top(&mut area, 1);
    let time = clock(view.passed);
    let mut name = vec![
        Span::styled("formica ", ink.quiet()),
        Span::styled(view.run.clone(), ink.strong()),
    ];
    if area.height == 0 {
        name.push(Span::raw("  "));
        name.extend(phases(view, ink));
    }
    Line::from(name).render(first, buffer);
    right(Span::styled(time, ink.strong()), first, buffer);
    Line::from(phases(view, ink)).render(area, buffer);
    let config = format!("config {}", view.config);
    right(Span::styled(config, ink.quiet()), area, buffer);
}

fn phases(view: &View, ink: Ink) -> Vec<Span<'static>> {
    let mut spans = vec![];
    for phase in view.phases {
        if !spans.is_empty() {
            spans.push(Span::styled(" › ", ink.quiet()));
        }
        let style = match phase {
            now if *now == view.phase => ink.accent().patch(ink.strong()),
            _ => ink.quiet(),
        };
        spans.push(Span::styled(word(*phase), style));
    }
    spans
}

fn word(phase: Phase) -> &'static str {
    match phase {
        Phase::Train => "train",
        Phase::Settle => "settle",
        Phase::Evaluate => "evaluate",
        Phase::Finish => "finish",
    }
}

fn footer(ink: Ink, area: Rect, buffer: &mut Buffer) {
    let text = "Ctrl-C or q ends the run in order; launch --resume goes on with it";
    write(text, ink.quiet(), area, buffer);
}

fn rule(ink: Ink, area: Rect, buffer: &mut Buffer) {
    write(&"─".repeat(area.width.into()), ink.quiet(), area, buffer);
}

/// The newest lines that were said, at most so many.
fn said(view: &View, most: usize) -> Vec<&str> {
    let lines: Vec<&str> = view.lines.iter().flat_map(|text| text.lines()).collect();
    lines[lines.len().saturating_sub(most)..].to_vec()
}

/// Writes a text, cut where there is no more room.
pub(super) fn write(text: &str, style: Style, area: Rect, buffer: &mut Buffer) {
    let cut = cut_text(text, area.width.into());
    Line::styled(cut, style).render(area, buffer);
}

/// Writes at the right end.
pub(super) fn right(span: Span, area: Rect, buffer: &mut Buffer) {
    let width = span.width().min(area.width.into()) as u16;
    let area = Rect {
        x: area.right() - width,
        width,
        ..area
    };
    Line::from(span).render(area, buffer);
}

/// A text of at most so many columns; three dots say that it goes on.
pub(super) fn cut_text(text: &str, width: usize) -> String {
    if Span::raw(text).width() <= width {
        return text.to_owned();
    }
    let (mut cut, mut taken) = (String::new(), 0);
    for c in text.chars() {
        taken += Span::raw(c.encode_utf8(&mut [0; 4]) as &str).width();
        if taken >= width {
            break;
        }
        cut.push(c);
    }
    if width > 0 {
        cut.push('…');
    }
    cut
}

/// Takes rows from the top, as far as there are any.
pub(super) fn cut_top(area: &mut Rect, rows: u16) -> Rect {
    let height = rows.min(area.height);
    let top = Rect { height, ..*area };
    (area.y, area.height) = (area.y + height, area.height - height);
    top
}

fn cut_bottom(area: &mut Rect, rows: u16) -> Rect {
    let height = rows.min(area.height);
    area.height -= height;
    Rect {
        y: area.y + area.height,
        height,
        ..*area
    }
}

/// Takes columns from the left, as far as there are any.
pub(super) fn cut_left(area: &mut Rect, columns: u16) -> Rect {
    let width = columns.min(area.width);
    let left = Rect { width, ..*area };
    (area.x, area.width) = (area.x + width, area.width - width);
    left
}
