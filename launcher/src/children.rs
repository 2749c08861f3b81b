//! The processes of a run: started in order, watched, restarted, ended.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use rustix::process::{Pid, Signal, kill_process};
use std::os::unix::process::CommandExt;
use wire::Role;

/// Pause before the first restart; it doubles with every further one in the window.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// One place in the topology and the process that fills it.
pub(crate) struct Place {
    pub(crate) role: Role,
    pub(crate) id: u32,
    log: PathBuf,
    child: Option<Child>,
    /// Times of restarts within the window.
    restarts: VecDeque<Instant>,
    restart_at: Option<Instant>,
    pub(crate) restarted: usize,
    /// Ended in order.
    pub(crate) finished: bool,
}

/// How a process came to its end.
pub(crate) enum Ended {
    /// In order.
    Finished,
    /// It will be started again.
    Restarting(ExitStatus),
    /// It failed, and the run cannot or may not go on without it.
    Failed(ExitStatus),
}

/// All processes of a run.
pub(crate) struct Children {
    pub(crate) places: Vec<Place>,
    folder: PathBuf,
    domain: String,
    limit: usize,
    window: Duration,
}

impl Children {
    pub(crate) fn new(folder: &Path, domain: &str, limit: usize, window: Duration) -> Self {
        let (folder, domain) = (folder.to_path_buf(), domain.to_owned());
        Self {
            places: vec![],
            folder,
            domain,
            limit,
            window,
        }
    }

    /// Starts a process.
    pub(crate) fn start(&mut self, role: Role, id: u32) -> anyhow::Result<()> {
        let log = self
            .folder
            .join("logs")
            .join(format!("{}-{id}.log", role.name()));
        let mut place = Place {
            role,
            id,
            log,
            child: None,
            restarts: VecDeque::new(),
            restart_at: None,
            restarted: 0,
            finished: false,
        };
        place.spawn(&self.folder, &self.domain)?;
        self.places.push(place);
        Ok(())
    }

    /// Sees which processes ended, and starts those again whose pause is over.
    pub(crate) fn tend(&mut self, stopping: bool) -> anyhow::Result<Vec<(usize, Ended)>> {
        let mut ended = vec![];
        for (i, place) in self.places.iter_mut().enumerate() {
            let status = match &mut place.child {
                Some(child) => child.try_wait()?,
                None => None,
            };
            if let Some(status) = status {
                place.child = None;
                ended.push((i, place.end(status, stopping, self.limit, self.window)));
            }
            let due = place.restart_at.is_some_and(|at| at <= Instant::now());
            if due && !stopping {
                place.restart_at = None;
                place.restarted += 1;
                place.spawn(&self.folder, &self.domain)?;
            }
        }
        Ok(ended)
    }

    /// Whether a process is alive or will be again.
    pub(crate) fn any_left(&self, stopping: bool) -> bool {
        self.places
            .iter()
            .any(|place| place.child.is_some() || !stopping && place.restart_at.is_some())
    }

    pub(crate) fn signal(&self, signal: Signal) {
        for child in self.places.iter().filter_map(|place| place.child.as_ref()) {
            if let Some(pid) = Pid::from_raw(child.id() as i32) {
                let _ = kill_process(pid, signal);
            }
        }
    }
}

impl Drop for Children {
    /// No way out of the launcher leaves a child behind.
    fn drop(&mut self) {
        self.signal(Signal::KILL);
        for child in self
            .places
            .iter_mut()
            .filter_map(|place| place.child.as_mut())
        {
            let _ = child.wait();
        }
    }
}

impl Place {
    fn spawn(&mut self, folder: &Path, domain: &str) -> anyhow::Result<()> {
        let log = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&self.log)
            .with_context(|| format!("opening {}", self.log.display()))?;
        let mut command = Command::new(std::env::current_exe()?);
        command
            .arg(self.role.name())
            .args(["--domain", domain, "--folder"])
            .arg(folder)
            .env(super::role::LAUNCHER, std::process::id().to_string())
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            // A group of its own: Ctrl-C in the terminal is the launcher's to pass on.
            .process_group(0);
        if self.role == Role::Actor {
            command.args(["--id", &self.id.to_string()]);
        }
        self.child = Some(command.spawn().context("starting a process")?);
        Ok(())
    }

    fn end(&mut self, status: ExitStatus, stopping: bool, limit: usize, window: Duration) -> Ended {
        if status.success() {
            self.finished = true;
            return Ended::Finished;
        }
        if stopping || self.role != Role::Actor {
            return Ended::Failed(status);
        }
        let now = Instant::now();
        self.restarts.retain(|at| now - *at < window);
        if self.restarts.len() >= limit {
            return Ended::Failed(status);
        }
        let pause = FIRST_PAUSE * 2_u32.saturating_pow(self.restarts.len().min(16) as u32);
        self.restarts.push_back(now);
        self.restart_at = Some(now + pause.min(LONGEST_PAUSE));
        Ended::Restarting(status)
    }

    pub(crate) fn name(&self) -> String {
        format!("{}-{}", self.role.name(), self.id)
    }

    /// The last lines of the process's log.
    pub(crate) fn last_lines(&self, lines: usize) -> String {
        let mut text = String::new();
        if let Ok(mut file) = File::open(&self.log) {
            let end = file.metadata().map_or(0, |file| file.len());
            let _ = file.seek(SeekFrom::Start(end.saturating_sub(8192)));
            let mut bytes = vec![];
            let _ = file.read_to_end(&mut bytes);
            text = String::from_utf8_lossy(&bytes).into_owned();
        }
        let all: Vec<&str> = text.lines().collect();
        all[all.len().saturating_sub(lines)..].join("\n")
    }
}
