//! Parts of an area, and texts that are cut to fit.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;

/// Writes a text, cut to the width of the area.
pub(super) fn write(text: &str, style: Style, area: Rect, buffer: &mut Buffer) {
    let cut = cut_text(text, area.width.into());
    Line::styled(cut, style).render(area, buffer);
}

/// Writes at the right end of the area.
pub(super) fn right(span: Span, area: Rect, buffer: &mut Buffer) {
    let width = span.width().min(area.width.into()) as u16;
    let area = Rect {
        x: area.right() - width,
        width,
        ..area
    };
    Line::from(span).render(area, buffer);
}

/// A text of at most `width` columns. If it is cut, it ends with an ellipsis.
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

/// Takes up to `rows` rows from the top.
pub(super) fn cut_top(area: &mut Rect, rows: u16) -> Rect {
    let height = rows.min(area.height);
    let top = Rect { height, ..*area };
    (area.y, area.height) = (area.y + height, area.height - height);
    top
}

/// Takes up to `rows` rows from the bottom.
pub(super) fn cut_bottom(area: &mut Rect, rows: u16) -> Rect {
    let height = rows.min(area.height);
    area.height -= height;
    Rect {
        y: area.y + area.height,
        height,
        ..*area
    }
}

/// Takes up to `columns` columns from the left.
pub(super) fn cut_left(area: &mut Rect, columns: u16) -> Rect {
    let width = columns.min(area.width);
    let left = Rect { width, ..*area };
    (area.x, area.width) = (area.x + width, area.width - width);
    left
}
