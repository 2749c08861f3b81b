//! Records the metrics of a run: `metrics.csv`, event files for TensorBoard, and the newest value of each.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use runs::metrics::{HEADER, Newest, Row};
use wire::{Metric, Role};

use super::tensorboard::EventFile;
use super::throughput;

/// Maximum number of metrics whose newest value is kept.
const MOST_NAMES: usize = 1000;
/// Files are flushed this often.
const FLUSH: Duration = Duration::from_secs(1);

/// Writes `metrics.csv` and event files for TensorBoard.
pub(crate) struct Metrics {
    csv: Option<BufWriter<File>>,
    events: Option<EventFile>,
    /// Whether several actors send the same metrics.
    several_actors: bool,
    start: Instant,
    /// Time of earlier launchers of the run (s).
    before: f64,
    /// Control steps that they counted.
    steps_before: u64,
    flushed: Instant,
    newest: Newest,
    errors: Vec<String>,
}

impl Metrics {
    /// Opens the files in a run's folder. `seconds` is the time that earlier launchers of the run took.
    pub(crate) fn open(folder: &Path, seconds: f64, several_actors: bool) -> anyhow::Result<Self> {
        let path = folder.join("metrics.csv");
        let (mut newest, mut steps_before) = (Newest::new(), 0);
        let mut text = std::fs::read_to_string(&path).unwrap_or_default();
        // A killed launcher may have left an incomplete line.
        text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        for line in text.lines().skip(1) {
            if let Some(row) = Row::parse(line) {
                newest.insert(row.name.to_owned(), row.value);
                if row.name == throughput::STEPS {
                    steps_before = row.step;
                }
            }
        }
        let csv = open_csv(&path, &text).with_context(|| format!("opening {}", path.display()))?;
        let mut metrics = Self {
            csv: Some(csv),
            events: None,
            several_actors,
            start: Instant::now(),
            before: seconds,
            steps_before,
            flushed: Instant::now(),
            newest,
            errors: vec![],
        };
        match EventFile::create(&folder.join("tensorboard")) {
            Ok(events) => metrics.events = Some(events),
            Err(error) => metrics.fail(&format!("no event file for TensorBoard: {error}")),
        }
        Ok(metrics)
    }

    /// Time that the run has taken (s).
    pub(crate) fn seconds(&self) -> f64 {
        self.before + self.start.elapsed().as_secs_f64()
    }

    /// Excludes a duration from the time of the run.
    pub(crate) fn skip(&mut self, passed: Duration) {
        self.start += passed;
    }

    /// Control steps that earlier launchers of the run counted.
    pub(crate) fn steps_before(&self) -> u64 {
        self.steps_before
    }

    /// The newest value of each metric.
    pub(crate) fn newest(&self) -> &Newest {
        &self.newest
    }

    /// Records a metric of another process.
    pub(crate) fn add(&mut self, metric: &Metric) {
        let name = metric.name().replace([',', '\n', '\r', '"'], "_");
        let role = Role::from_number(metric.role);
        let single = matches!(role, Some(Role::Learner | Role::GraphBuilder))
            || role == Some(Role::Actor) && !self.several_actors;
        let role = role.map_or("unknown", Role::name);
        let tag = match single {
            true => name.clone(),
            false => format!("{role}-{}/{name}", metric.id),
        };
        self.write((role, metric.id), name, tag, metric.step, metric.value);
    }

    /// Records a metric of the launcher.
    pub(crate) fn add_own(&mut self, name: &str, step: u64, value: f64) {
        self.write(
            ("launcher", 0),
            name.to_owned(),
            name.to_owned(),
            step,
            value,
        );
    }

    /// Writes a row. A full disk ends a file, not the run.
    fn write(&mut self, source: (&str, u32), name: String, tag: String, step: u64, value: f64) {
        if !value.is_finite() || name.is_empty() {
            return;
        }
        let seconds = self.seconds();
        let (role, id) = source;
        let row = Row {
            seconds,
            role,
            id,
            name: &name,
            step,
            value,
        };
        self.with_csv(|csv| writeln!(csv, "{row}"));
        self.with_events(|events| events.scalar(tag, step, value));
        // Bounded, since names come from a channel.
        if self.newest.len() < MOST_NAMES || self.newest.contains_key(&name) {
            self.newest.insert(name, value);
        }
        self.flush_if_due();
    }

    /// Flushes the files when that is due.
    pub(crate) fn flush_if_due(&mut self) {
        if self.flushed.elapsed() > FLUSH {
            self.flushed = Instant::now();
            self.with_csv(Write::flush);
            self.with_events(EventFile::flush);
        }
    }

    fn with_csv(&mut self, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) {
        if let Some(Err(error)) = self.csv.as_mut().map(write) {
            self.fail(&format!("metrics.csv ends here: {error}"));
            self.csv = None;
        }
    }

    fn with_events(&mut self, write: impl FnOnce(&mut EventFile) -> io::Result<()>) {
        if let Some(Err(error)) = self.events.as_mut().map(write) {
            self.fail(&format!("TensorBoard's event file ends here: {error}"));
            self.events = None;
        }
    }

    fn fail(&mut self, text: &str) {
        self.errors.push(text.to_owned());
    }

    /// Takes the errors since the last call.
    pub(crate) fn take_errors(&mut self) -> Vec<String> {
        std::mem::take(&mut self.errors)
    }
}

/// Opens `metrics.csv` to append to `text`, which is its complete part.
fn open_csv(path: &Path, text: &str) -> io::Result<BufWriter<File>> {
    let file = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)?;
    file.set_len(text.len() as u64)?;
    let mut csv = BufWriter::new(file);
    csv.seek(SeekFrom::End(0))?;
    if text.is_empty() {
        writeln!(csv, "{HEADER}")?;
    }
    Ok(csv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_run_appends_to_its_file_and_starts_a_new_event_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut metrics = Metrics::open(folder.path(), 0.0, true).unwrap();
        metrics.add_own(throughput::STEPS, 4200, 350.5);
        metrics.add(&Metric::new(Role::Actor, 1, "a,b", 3, 2.0));
        metrics.add(&Metric::new(Role::Actor, 1, "x", 3, f64::NAN));
        drop(metrics);
        let mut text = std::fs::read_to_string(&path).unwrap();
        let row = format!("launcher,0,{},4200,350.5\n", throughput::STEPS);
        assert!(text.contains(&row), "{text}");
        assert!(text.ends_with("actor,1,a_b,3,2\n"), "{text}");
        text += "9.0,actor,1,cut o";
        std::fs::write(&path, &text).unwrap();
        let mut metrics = Metrics::open(folder.path(), 60.0, true).unwrap();
        assert_eq!(metrics.steps_before(), 4200);
        assert_eq!(metrics.newest().get("a_b"), Some(&2.0));
        assert!(metrics.seconds() >= 60.0);
        metrics.add_own("c", 1, 1.0);
        drop(metrics);
        let lines = std::fs::read_to_string(&path).unwrap().lines().count();
        assert_eq!(lines, 4);
        let files = std::fs::read_dir(folder.path().join("tensorboard")).unwrap();
        assert_eq!(files.count(), 2);
    }

    #[test]
    fn a_full_disk_ends_a_file_with_one_error() {
        let folder = tempfile::tempdir().unwrap();
        let mut metrics = Metrics::open(folder.path(), 0.0, true).unwrap();
        let Ok(full) = OpenOptions::new().write(true).open("/dev/full") else {
            return; // Not on this system.
        };
        metrics.csv = Some(BufWriter::with_capacity(0, full));
        for step in 0..3 {
            metrics.add_own("a", step, 1.0);
        }
        let errors = metrics.take_errors();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].contains("metrics.csv ends here"));
        assert!(metrics.events.is_some(), "the other file goes on");
        assert_eq!(metrics.newest().get("a"), Some(&1.0));
    }
}
