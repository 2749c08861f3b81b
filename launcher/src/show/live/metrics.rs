//! The score so far, and the most important metrics.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;

use super::layout::{cut_left, cut_top, right, write};
use super::style::{Theme, number, sparkline};
use super::view::{Score, View};

const LABEL: u16 = 21;
const VALUE: u16 = 10;
/// Maximum width of a sparkline.
const BARS: u16 = 40;

/// Rows that are needed for all.
pub(super) fn rows(view: &View) -> u16 {
    2 + view.metrics.len() as u16
}

/// Draws the score and the metrics.
pub(super) fn draw(view: &View, theme: Theme, mut area: Rect, buffer: &mut Buffer) {
    score(view.score, theme, cut_top(&mut area, 1), buffer);
    if usize::from(area.height) > view.metrics.len() {
        cut_top(&mut area, 1);
    }
    for metric in &view.metrics {
        let mut row = cut_top(&mut area, 1);
        if row.height == 0 {
            return;
        }
        let label = cut_left(&mut row, LABEL);
        write(metric.label, theme.quiet(), label, buffer);
        let value = number(metric.value, metric.decimals);
        right(Span::raw(value), cut_left(&mut row, VALUE), buffer);
        cut_left(&mut row, 2);
        row.width = row.width.min(BARS);
        let bars = sparkline(&metric.history, row.width.into());
        write(&bars, theme.accent(), row, buffer);
    }
}

fn score(score: Option<Score>, theme: Theme, mut row: Rect, buffer: &mut Buffer) {
    if row.height == 0 {
        return;
    }
    write(
        "score so far",
        theme.quiet(),
        cut_left(&mut row, LABEL),
        buffer,
    );
    let place = cut_left(&mut row, VALUE);
    let Some(score) = score.filter(|score| score.done > 0) else {
        right(Span::styled("-", theme.quiet()), place, buffer);
        return;
    };
    let share = 100.0 * score.successes as f64 / score.done as f64;
    let style = theme.good().patch(theme.strong());
    right(Span::styled(number(share, 1), style), place, buffer);
    let text = format!(
        "  {} of {}, {} to come",
        score.successes,
        score.done,
        score.episodes.saturating_sub(score.done)
    );
    Line::from(Span::raw(text)).render(row, buffer);
}
