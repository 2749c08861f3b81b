//! The metrics of a run: `metrics.csv`, the newest value of each, and TensorBoard's event files.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use wire::{Metric, Role};

use crate::recorded::parse_row;
use crate::stages::Newest;
use crate::tensorboard::EventFile;
use crate::throughput;

/// Names of metrics whose newest value is kept.
const MOST_NAMES: usize = 1000;
/// What is written is on the disk after this.
const FLUSH: Duration = Duration::from_secs(1);

/// First line of `metrics.csv`.
pub(crate) const METRICS_HEADER: &str = "seconds,role,id,name,step,value";

/// `metrics.csv`: seconds since the start, role, id, name, step, value; and the same beside it for
/// TensorBoard.
pub(crate) struct Metrics {
    csv: Option<BufWriter<File>>,
    events: Option<EventFile>,
    /// Whether more than one process sends what actors send.
    several_actors: bool,
    start: Instant,
    /// Time that earlier launchers of the run took (s).
    before: f64,
    /// Control steps that they counted.
    steps_before: u64,
    flushed: Instant,
    newest: Newest,
    complaints: Vec<String>,
}

impl Metrics {
    /// Begins the files in a run's folder, or goes on with those of a run that took so many
    /// seconds before.
    pub(crate) fn open(folder: &Path, seconds: f64, several_actors: bool) -> anyhow::Result<Self> {
        let path = folder.join("metrics.csv");
        let (mut newest, mut steps_before) = (Newest::new(), 0);
        let mut text = std::fs::read_to_string(&path).unwrap_or_default();
        // A killed launcher may have left half a line.
        text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        for line in text.lines().skip(1) {
            if let Some((_, name, value)) = parse_row(line) {
                newest.insert(name.to_owned(), value);
                if name == throughput::STEPS {
                    let step = line.split(',').nth(4);
                    steps_before = step.and_then(|step| step.parse().ok()).unwrap_or(0);
                }
            }
        }
        let csv = begin(&path, &text).with_context(|| format!("opening {}", path.display()))?;
        let mut metrics = Self {
            csv: Some(csv),
            events: None,
            several_actors,
            start: Instant::now(),
            before: seconds,
            steps_before,
            flushed: Instant::now(),
            newest,
            complaints: vec![],
        };
        match EventFile::create(&folder.join("tensorboard")) {
            Ok(events) => metrics.events = Some(events),
            Err(error) => metrics.complain(&format!("no event file for TensorBoard: {error}")),
        }
        Ok(metrics)
    }

    /// Time that the run has taken (s).
    pub(crate) fn seconds(&self) -> f64 {
        self.before + self.start.elapsed().as_secs_f64()
    }

    /// Counts so much of the time that passed as none of the run.
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

    /// Writes a metric down.
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

    /// Writes one of the launcher's own down.
    pub(crate) fn add_own(&mut self, name: &str, step: u64, value: f64) {
        self.write(
            ("launcher", 0),
            name.to_owned(),
            name.to_owned(),
            step,
            value,
        );
    }

    /// A full disk ends a file, not the run.
    fn write(&mut self, source: (&str, u32), name: String, tag: String, step: u64, value: f64) {
        if !value.is_finite() || name.is_empty() {
            return;
        }
        let seconds = self.seconds();
        let (role, id) = source;
        self.with_csv(|csv| writeln!(csv, "{seconds:.1},{role},{id},{name},{step},{value}"));
        self.with_events(|events| events.scalar(tag, step, value));
        // Whoever publishes on a channel must not fill the memory.
        if self.newest.len() < MOST_NAMES || self.newest.contains_key(&name) {
            self.newest.insert(name, value);
        }
        self.flush_if_due();
    }

    /// Brings to the disk what was written, now and then.
    pub(crate) fn flush_if_due(&mut self) {
        if self.flushed.elapsed() > FLUSH {
            self.flushed = Instant::now();
            self.with_csv(Write::flush);
            self.with_events(EventFile::flush);
        }
    }

    fn with_csv(&mut self, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) {
        if let Some(Err(error)) = self.csv.as_mut().map(write) {
            self.complain(&format!("metrics.csv ends here: {error}"));
            self.csv = None;
        }
    }

    fn with_events(&mut self, write: impl FnOnce(&mut EventFile) -> io::Result<()>) {
        if let Some(Err(error)) = self.events.as_mut().map(write) {
            self.complain(&format!("TensorBoard's event file ends here: {error}"));
            self.events = None;
        }
    }

    fn complain(&mut self, text: &str) {
        self.complaints.push(text.to_owned());
    }

    /// What went wrong since the last call.
    pub(crate) fn complaints(&mut self) -> Vec<String> {
        std::mem::take(&mut self.complaints)
    }
}

/// Opens `metrics.csv` to go on behind `text`, which is all of it that is whole.
fn begin(path: &Path, text: &str) -> io::Result<BufWriter<File>> {
    let file = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)?;
    file.set_len(text.len() as u64)?;
    let mut csv = BufWriter::new(file);
    csv.seek(SeekFrom::End(0))?;
    if text.is_empty() {
        writeln!(csv, "{METRICS_HEADER}")?;
    }
    Ok(csv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_run_goes_on_with_the_same_file_and_a_new_one_for_tensorboard() {
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
    fn a_disk_that_is_full_ends_each_file_with_one_complaint() {
        let folder = tempfile::tempdir().unwrap();
        let mut metrics = Metrics::open(folder.path(), 0.0, true).unwrap();
        let Ok(full) = OpenOptions::new().write(true).open("/dev/full") else {
            return; // Not on this system.
        };
        metrics.csv = Some(BufWriter::with_capacity(0, full));
        for step in 0..3 {
            metrics.add_own("a", step, 1.0);
        }
        let complaints = metrics.complaints();
        assert_eq!(complaints.len(), 1, "{complaints:?}");
        assert!(complaints[0].contains("metrics.csv ends here"));
        assert!(metrics.events.is_some(), "the other file goes on");
        assert_eq!(metrics.newest().get("a"), Some(&1.0));
    }
}
