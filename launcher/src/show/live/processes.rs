//! The table of processes.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Span;

use super::layout::{cut_left, cut_text, cut_top, right, write};
use super::style::{Theme, bar, number};
use super::view::{Process, View};

/// A column of the table.
#[derive(Clone, Copy, PartialEq)]
enum Column {
    Name,
    Pid,
    State,
    Doing,
    Done,
    Rate,
    Restarts,
    Silence,
}

/// In the order of [`Column`]: column, title, width (0 for the rest), and the minimum width of the table to
/// show it.
const COLUMNS: [(Column, &str, u16, u16); 8] = [
    (Column::Name, "process", 13, 0),
    (Column::Pid, "pid", 7, 100),
    (Column::State, "state", 10, 26),
    (Column::Doing, "doing", 0, 50),
    (Column::Done, "done", 11, 90),
    (Column::Rate, "per second", 13, 64),
    (Column::Restarts, "restarts", 8, 76),
    (Column::Silence, "heard", 5, 40),
];
/// Columns of characters between columns.
const GAP: u16 = 2;

/// Rows of the table with its header, at most `most`.
pub(super) fn rows(view: &View, most: u16) -> u16 {
    let all = view.processes.len() as u16 + 1;
    all.min(most.max(2))
}

/// Draws the table.
pub(super) fn draw(view: &View, theme: Theme, mut area: Rect, buffer: &mut Buffer) {
    let head = cut_top(&mut area, 1);
    for (column, place) in places(head) {
        let (.., title, _, _) = COLUMNS[column as usize];
        cell(column, title, theme.quiet(), place, buffer);
    }
    let room = usize::from(area.height);
    let all = view.processes.len();
    let shown = if all > room {
        room.saturating_sub(1)
    } else {
        all
    };
    for process in &view.processes[..shown] {
        let row = cut_top(&mut area, 1);
        for (column, place) in places(row) {
            let (text, style) = content(column, process, theme, place.width.into());
            cell(column, &text, style, place, buffer);
        }
    }
    if shown < all {
        let hidden = &view.processes[shown..];
        let rate: f64 = hidden
            .iter()
            .filter_map(|p| p.rate)
            .map(|(rate, _)| rate)
            .sum();
        let text = format!("and {} more, {} a second", hidden.len(), number(rate, 0));
        write(&text, theme.quiet(), cut_top(&mut area, 1), buffer);
    }
}

/// The columns that fit, and their areas in a row.
fn places(mut row: Rect) -> Vec<(Column, Rect)> {
    let fitting = COLUMNS.iter().filter(|(.., from)| row.width >= *from);
    let fitting: Vec<_> = fitting.collect();
    let taken: u16 = fitting.iter().map(|(_, _, width, _)| width + GAP).sum();
    let rest = row.width.saturating_sub(taken.saturating_sub(GAP));
    let mut places = vec![];
    for (column, _, width, _) in fitting {
        let width = if *width == 0 { rest } else { *width };
        places.push((*column, cut_left(&mut row, width)));
        cut_left(&mut row, GAP);
    }
    places
}

fn cell(column: Column, text: &str, style: Style, place: Rect, buffer: &mut Buffer) {
    let text = cut_text(text, place.width.into());
    match column {
        Column::Pid | Column::Rate | Column::Restarts | Column::Silence => {
            right(Span::styled(text, style), place, buffer);
        }
        _ => write(&text, style, place, buffer),
    }
}

fn content(column: Column, process: &Process, theme: Theme, width: usize) -> (String, Style) {
    let plain = |text: String| (text, theme.plain());
    match column {
        Column::Name => (process.name.clone(), theme.strong()),
        Column::Pid => (
            process.pid.map_or_else(String::new, |pid| pid.to_string()),
            theme.quiet(),
        ),
        Column::State => {
            let (word, style) = theme.health(process.health);
            (word.to_owned(), style)
        }
        Column::Doing => plain(process.doing.clone()),
        Column::Done => match process.done {
            Some(share) if width > 5 => {
                let bar = bar(share, width - 5);
                let text = format!("{bar:<0$} {1:>3.0}%", width - 5, 100.0 * share);
                (text, theme.accent())
            }
            _ => plain(String::new()),
        },
        Column::Rate => match process.rate {
            Some((rate, word)) => plain(format!("{} {word}", number(rate, 0))),
            None => plain(String::new()),
        },
        Column::Restarts => match process.restarts {
            0 => ("0".to_owned(), theme.quiet()),
            n => (n.to_string(), theme.odd()),
        },
        Column::Silence => theme.silence(process.silence),
    }
}
