//! What the user sees of a run while it goes on, and the file of its metrics.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, IsTerminal, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use wire::{Metric, Role, State, Status};

use crate::recorded::parse_row;
use crate::stages::Newest;

/// Names of metrics whose newest value is kept.
const MOST_NAMES: usize = 1000;

/// Newest status of each process, and when it came.
pub(crate) type Statuses = BTreeMap<(Role, u32), (Status, Instant)>;

/// The status line: rewritten in a terminal, a new line now and then elsewhere.
pub(crate) struct Progress {
    terminal: bool,
    shown: Option<Instant>,
    last: String,
    rate: (Instant, u64),
    steps_a_second: f64,
}

impl Progress {
    pub(crate) fn new() -> Self {
        Self {
            terminal: std::io::stdout().is_terminal(),
            shown: None,
            last: String::new(),
            rate: (Instant::now(), 0),
            steps_a_second: 0.0,
        }
    }

    /// Shows the line when it is time to.
    pub(crate) fn show(&mut self, phase: &str, statuses: &Statuses, newest: &Newest, extra: &str) {
        let pause = Duration::from_millis(if self.terminal { 500 } else { 5000 });
        if self.shown.is_some_and(|shown| shown.elapsed() < pause) {
            return;
        }
        self.shown = Some(Instant::now());
        let (mut steps, mut actors) = (0, 0);
        let mut parts = vec![];
        for ((role, _), (status, seen)) in statuses {
            if *role == Role::Actor {
                steps += status.steps;
                let working = status.state == State::Working as u32;
                actors += usize::from(working && seen.elapsed() < Duration::from_secs(5));
            } else if status.state < State::Finished as u32 {
                let [done, total] = status.progress;
                let share = if total > 0 {
                    format!(" {:.0}%", 100.0 * done as f64 / total as f64)
                } else {
                    String::new()
                };
                parts.push(format!("{}: {}{share}", role.name(), status.text()));
            }
        }
        let passed = self.rate.0.elapsed().as_secs_f64();
        if passed > 1.0 {
            self.steps_a_second = steps.saturating_sub(self.rate.1) as f64 / passed;
            self.rate = (Instant::now(), steps);
        }
        parts.push(format!(
            "{actors} actors at {:.0} steps/s",
            self.steps_a_second
        ));
        if let Some(lag) = newest.get("rollout/policy_lag") {
            parts.push(format!("policy lag {lag:.0}"));
        }
        if !extra.is_empty() {
            parts.push(extra.to_owned());
        }
        let line = format!("{phase} | {}", parts.join(" | "));
        if self.terminal {
            let width = self.last.chars().count();
            print!("\r{line:<width$}");
            let _ = std::io::stdout().flush();
        } else if line != self.last {
            println!("{line}");
        }
        self.last = line;
    }

    /// Prints a line that stays.
    pub(crate) fn say(&mut self, text: &str) {
        if self.terminal && !self.last.is_empty() {
            println!();
            self.last.clear();
        }
        println!("{text}");
    }
}

/// First line of `metrics.csv`.
pub(crate) const METRICS_HEADER: &str = "seconds,role,id,name,step,value";

/// `metrics.csv`: seconds since the start, role, id, name, step, value.
pub(crate) struct MetricsFile {
    file: Option<BufWriter<File>>,
    start: Instant,
    /// Time that earlier launchers of the run took (s).
    before: f64,
    flushed: Instant,
    newest: Newest,
}

impl MetricsFile {
    /// Begins the file, or goes on with that of a run that took so many seconds before.
    pub(crate) fn open(path: &Path, seconds: f64) -> anyhow::Result<Self> {
        let mut newest = Newest::new();
        let mut text = std::fs::read_to_string(path).unwrap_or_default();
        // A killed launcher may have left half a line.
        text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        for line in text.lines().skip(1) {
            if let Some((_, name, value)) = parse_row(line) {
                newest.insert(name.to_owned(), value);
            }
        }
        let file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)?;
        file.set_len(text.len() as u64)?;
        let mut file = BufWriter::new(file);
        file.seek(SeekFrom::End(0))?;
        if text.is_empty() {
            writeln!(file, "{METRICS_HEADER}")?;
        }
        Ok(Self {
            file: Some(file),
            start: Instant::now(),
            before: seconds,
            flushed: Instant::now(),
            newest,
        })
    }

    /// Time that the run has taken (s).
    pub(crate) fn seconds(&self) -> f64 {
        self.before + self.start.elapsed().as_secs_f64()
    }

    /// The newest value of each metric.
    pub(crate) fn newest(&self) -> &Newest {
        &self.newest
    }

    /// A full disk ends the file, not the run.
    pub(crate) fn add(&mut self, metric: &Metric) {
        let name = metric.name().replace([',', '\n', '"'], "_");
        if !metric.value.is_finite() || name.is_empty() {
            return;
        }
        // Whoever publishes on a channel must not fill the memory.
        if self.newest.len() < MOST_NAMES || self.newest.contains_key(&name) {
            self.newest.insert(name.clone(), metric.value);
        }
        let seconds = self.seconds();
        let Some(file) = &mut self.file else { return };
        let role = Role::from_number(metric.role).map_or("unknown", Role::name);
        let Metric {
            id, step, value, ..
        } = *metric;
        let mut written = writeln!(file, "{seconds:.1},{role},{id},{name},{step},{value}");
        if self.flushed.elapsed() > Duration::from_secs(1) {
            written = written.and_then(|()| file.flush());
            self.flushed = Instant::now();
        }
        if let Err(error) = written {
            eprintln!("formica: metrics.csv ends here: {error}");
            self.file = None;
        }
    }
}
