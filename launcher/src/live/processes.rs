//! The table of processes.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Span;

use super::frame::{cut_left, cut_text, cut_top, right, write};
use super::ink::{Ink, bar, number};
use super::view::{Process, View};

/// What a column tells.
#[derive(Clone, Copy, PartialEq)]
enum Column {
    Name,
    Pid,
    State,
    Doing,
    Done,
    Rate,
    Restarts,
    Heard,
}

/// In the order of their numbers: column, head, width (0 for what is left), and the width of the
/// table from which on there is room for it.
const COLUMNS: [(Column, &str, u16, u16); 8] = [
    (Column::Name, "process", 13, 0),
    (Column::Pid, "pid", 7, 100),
    (Column::State, "state", 10, 26),
    (Column::Doing, "doing", 0, 50),
    (Column::Done, "done", 11, 90),
    (Column::Rate, "per second", 13, 64),
    (Column::Restarts, "restarts", 8, 76),
    (Column::Heard, "heard", 5, 40),
];
/// Between columns.
const GAP: u16 = 2;

/// Rows that the table takes, its head included, of at most so many.
pub(super) fn rows(view: &View, most: u16) -> u16 {
    let all = view.processes.len() as u16 + 1;
    all.min(most.max(2))
}

pub(super) fn draw(view: &View, ink: Ink, mut area: Rect, buffer: &mut Buffer) {
    let head = cut_top(&mut area, 1);
    for (column, place) in places(head) {
        let (.., title, _, _) = COLUMNS[column as usize];
        cell(column, title, ink.quiet(), place, buffer);
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
            let (text, style) = content(column, process, ink, place.width.into());
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
        write(&text, ink.quiet(), cut_top(&mut area, 1), buffer);
    }
}

/// The columns that there is room for, and where they are in a row.
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
        Column::Pid | Column::Rate | Column::Restarts | Column::Heard => {
            right(Span::styled(text, style), place, buffer);
        }
        _ => write(&text, style, place, buffer),
    }
}

fn content(column: Column, process: &Process, ink: Ink, width: usize) -> (String, Style) {
    let plain = |text: String| (text, ink.plain());
    match column {
        Column::Name => (process.name.clone(), ink.strong()),
        Column::Pid => (
            process.pid.map_or_else(String::new, |pid| pid.to_string()),
            ink.quiet(),
        ),
        Column::State => {
            let (word, style) = ink.health(process.health);
            (word.to_owned(), style)
        }
        Column::Doing => plain(process.doing.clone()),
        Column::Done => match process.done {
            Some(share) if width > 5 => {
                let bar = bar(share, width - 5);
                let text = format!("{bar:<0$} {1:>3.0}%", width - 5, 100.0 * share);
                (text, ink.accent())
            }
            _ => plain(String::new()),
        },
        Column::Rate => match process.rate {
            Some((rate, word)) => plain(format!("{} {word}", number(rate, 0))),
            None => plain(String::new()),
        },
        Column::Restarts => match process.restarts {
            0 => ("0".to_owned(), ink.quiet()),
            n => (n.to_string(), ink.odd()),
        },
        Column::Heard => ink.heard(process.heard),
    }
}
