//! The score so far, and the metrics that tell how it goes.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;

use super::frame::{cut_left, cut_top, right, write};
use super::ink::{Ink, number, sparkline};
use super::view::{Score, View};

const LABEL: u16 = 21;
const VALUE: u16 = 10;
/// Longer rows of bars tell no more.
const BARS: u16 = 40;

/// Rows that all of it takes.
pub(super) fn rows(view: &View) -> u16 {
    2 + view.figures.len() as u16
}

pub(super) fn draw(view: &View, ink: Ink, mut area: Rect, buffer: &mut Buffer) {
    score(view.score, ink, cut_top(&mut area, 1), buffer);
    if usize::from(area.height) > view.figures.len() {
        cut_top(&mut area, 1);
    }
    for figure in &view.figures {
        let mut row = cut_top(&mut area, 1);
        if row.height == 0 {
            return;
        }
        let label = cut_left(&mut row, LABEL);
        write(figure.label, ink.quiet(), label, buffer);
        let value = number(figure.value, figure.decimals);
        right(Span::raw(value), cut_left(&mut row, VALUE), buffer);
        cut_left(&mut row, 2);
        row.width = row.width.min(BARS);
        let bars = sparkline(&figure.history, row.width.into());
        write(&bars, ink.accent(), row, buffer);
    }
}

fn score(score: Option<Score>, ink: Ink, mut row: Rect, buffer: &mut Buffer) {
    if row.height == 0 {
        return;
    }
    write(
        "score so far",
        ink.quiet(),
        cut_left(&mut row, LABEL),
        buffer,
    );
    let place = cut_left(&mut row, VALUE);
    let Some(score) = score.filter(|score| score.done > 0) else {
        right(Span::styled("-", ink.quiet()), place, buffer);
        return;
    };
    let share = 100.0 * score.successes as f64 / score.done as f64;
    let style = ink.good().patch(ink.strong());
    right(Span::styled(number(share, 1), style), place, buffer);
    let told = format!(
        "  {} of {}, {} to come",
        score.successes,
        score.done,
        score.episodes.saturating_sub(score.done)
    );
    Line::from(Span::raw(told)).render(row, buffer);
}
