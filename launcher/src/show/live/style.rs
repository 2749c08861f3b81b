//! Colours and number formats of the view.

use std::time::Duration;

use plot::number::fixed;
use ratatui::style::{Color, Modifier, Style};
use wire::State;

use super::view::Health;

/// Colours of ants.
const ANTS: [Color; 6] = [
    Color::Cyan,
    Color::Yellow,
    Color::Magenta,
    Color::Green,
    Color::Blue,
    Color::Red,
];

/// Styles, with colours or without.
#[derive(Clone, Copy)]
pub(crate) struct Theme {
    colour: bool,
}

impl Theme {
    pub(crate) fn new(colour: bool) -> Self {
        Self { colour }
    }

    fn of(self, colour: Color) -> Style {
        match self.colour {
            true => Style::new().fg(colour),
            false => Style::new(),
        }
    }

    pub(crate) fn plain(self) -> Style {
        Style::new()
    }

    /// Less important text.
    pub(crate) fn quiet(self) -> Style {
        match self.colour {
            true => Style::new().fg(Color::DarkGray),
            false => Style::new().add_modifier(Modifier::DIM),
        }
    }

    /// Important text.
    pub(crate) fn strong(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    pub(crate) fn accent(self) -> Style {
        self.of(Color::Cyan)
    }

    pub(crate) fn good(self) -> Style {
        self.of(Color::Green)
    }

    pub(crate) fn odd(self) -> Style {
        self.of(Color::Yellow)
    }

    pub(crate) fn bad(self) -> Style {
        self.of(Color::Red).add_modifier(Modifier::BOLD)
    }

    pub(crate) fn wall(self) -> Color {
        if self.colour {
            Color::DarkGray
        } else {
            Color::Reset
        }
    }

    pub(crate) fn ant(self, id: u32) -> Color {
        if self.colour {
            ANTS[id as usize % ANTS.len()]
        } else {
            Color::Reset
        }
    }

    /// Label and style of a process state.
    pub(crate) fn health(self, health: Health) -> (&'static str, Style) {
        match health {
            Health::Alive(State::Starting) => ("starting", self.quiet()),
            Health::Alive(State::Waiting) => ("waiting", self.quiet()),
            Health::Alive(State::Working) => ("working", self.good()),
            Health::Alive(State::Trained) => ("trained", self.accent()),
            Health::Alive(State::Settled) => ("settled", self.accent()),
            Health::Alive(State::Finished) => ("finished", self.quiet()),
            Health::Restarting => ("restarting", self.odd()),
            Health::Gone => ("gone", self.bad()),
        }
    }

    /// Text and style of the time since the last status of a process.
    pub(crate) fn silence(self, silence: Option<Duration>) -> (String, Style) {
        match silence.map(|silence| silence.as_secs()) {
            None => ("-".to_owned(), self.quiet()),
            Some(0 | 1) => ("now".to_owned(), self.quiet()),
            Some(seconds) => {
                let style = if seconds < 5 { self.odd() } else { self.bad() };
                (format!("{seconds} s"), style)
            }
        }
    }
}

/// A number with `decimals` decimals and commas between thousands.
pub(crate) fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= 1e12 {
        return format!("{value:.2e}");
    }
    let Some(text) = fixed(value, decimals) else {
        return "-".to_owned();
    };
    let end = text.find('.').unwrap_or(text.len());
    let begin = usize::from(text.starts_with('-'));
    let mut out = String::with_capacity(text.len() + 4);
    for (i, c) in text.char_indices() {
        if i > begin && i < end && (end - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

/// Hours, minutes and seconds.
pub(crate) fn clock(passed: Duration) -> String {
    let seconds = passed.as_secs();
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours}:{minutes:02}:{:02}", seconds % 60)
}

/// Values as a row of bars, scaled from the least to the greatest, with the newest at the end.
pub(crate) fn sparkline(values: &[f64], width: usize) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let values = &values[values.len().saturating_sub(width)..];
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let least = finite().fold(f64::INFINITY, f64::min);
    let range = finite().fold(f64::NEG_INFINITY, f64::max) - least;
    let bar = |value: &f64| {
        let share = (value - least) / range;
        // All values are equal, or it is not finite: the lowest bar.
        let level = if share.is_finite() { share * 7.0 } else { 0.0 };
        BARS[(level.round() as usize).min(7)]
    };
    values.iter().map(bar).collect()
}

/// A share as a bar of `width` cells.
pub(crate) fn bar(share: f64, width: usize) -> String {
    const EIGHTHS: [char; 8] = [' ', '▏', '▎', '▍', '▌', '▋', '▊', '▉'];
    let share = if share.is_finite() {
        share.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let eighths = (share * width as f64 * 8.0).round() as usize;
    let mut text = "█".repeat(eighths / 8);
    if !eighths.is_multiple_of(8) {
        text.push(EIGHTHS[eighths % 8]);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_commas_and_bars_their_lengths() {
        assert_eq!(number(1_234_567.8, 0), "1,234,568");
        assert_eq!(number(-1234.5, 1), "-1,234.5");
        assert_eq!(number(-123.456, 2), "-123.46");
        assert_eq!(number(f64::NAN, 2), "-");
        assert_eq!(number(-0.001, 2), "0.00");
        assert_eq!(number(-2e300, 2), "-2.00e300");
        assert_eq!(clock(Duration::from_secs(3723)), "1:02:03");
        assert_eq!(sparkline(&[9.0, 0.0, 7.0, f64::NAN, 3.0], 4), "▁█▁▄");
        assert_eq!(sparkline(&[2.0, 2.0], 9), "▁▁");
        assert_eq!(sparkline(&[], 9), "");
        assert_eq!(sparkline(&[-f64::MAX, f64::MAX], 9), "▁▁");
        assert_eq!(bar(0.5, 3), "█▌");
        assert_eq!(
            (bar(7.0, 2), bar(f64::NAN, 2)),
            ("██".to_owned(), String::new())
        );
    }
}
