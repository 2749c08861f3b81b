//! A slot in the topology, and its process.

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use config::Supervision;
use rustix::process::{Pid, Signal, kill_process};
use wire::{Role, State, Status};

use super::last_error::last_error;
use crate::exit;
use crate::show::scene::SlotState;
use crate::supervise::role::LAUNCHER;

/// The binary of this process, even if its file has been replaced or removed.
const OWN_BINARY: &str = "/proc/self/exe";

/// A slot in the topology, and its process.
pub(crate) struct Slot {
    pub(crate) role: Role,
    pub(crate) id: u32,
    log: PathBuf,
    /// Bytes of the log that earlier processes wrote.
    log_before: u64,
    supervision: Supervision,
    pub(super) child: Option<Child>,
    /// The newest process, also after its end.
    pub(crate) pid: u32,
    /// Times of restarts within the window.
    restarts: VecDeque<Instant>,
    pub(super) restart_at: Option<Instant>,
    /// Whether it must not be started before it is released.
    pub(super) held: bool,
    pub(crate) restarted: usize,
    /// Whether any process of this slot has joined the run.
    was_ready: bool,
    ready: bool,
    /// When the last status arrived.
    last_status: Instant,
    /// Updates at its last progress, and when that was.
    progress: (u64, Instant),
    /// Why the launcher killed it.
    killed_for: Option<String>,
}

/// How a process ended.
pub(crate) enum Ended {
    /// As it should.
    Finished,
    /// For this reason; it will be restarted.
    Restarting(String),
    /// For this reason, too often; the run continues without it.
    GivenUp(String),
    /// For this reason, and the run cannot continue.
    Failed(Failure),
}

/// Why a run failed.
pub(crate) struct Failure {
    pub(crate) why: String,
    /// Whether the cause is in what the user gave.
    pub(crate) input: bool,
}

impl Slot {
    pub(super) fn new(role: Role, id: u32, folder: &Path, supervision: &Supervision) -> Self {
        let now = Instant::now();
        Self {
            role,
            id,
            log: folder
                .join("logs")
                .join(format!("{}-{id}.log", role.name())),
            log_before: 0,
            supervision: supervision.clone(),
            child: None,
            pid: 0,
            restarts: VecDeque::new(),
            restart_at: None,
            held: false,
            restarted: 0,
            was_ready: false,
            ready: false,
            last_status: now,
            progress: (0, now),
            killed_for: None,
        }
    }

    /// Restarts all timeouts.
    pub(super) fn reset_timeouts(&mut self) {
        (self.last_status, self.progress.1) = (Instant::now(), Instant::now());
    }

    pub(super) fn spawn(&mut self, folder: &Path, domain: &str) -> anyhow::Result<()> {
        let log = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&self.log)
            .with_context(|| format!("opening {}", self.log.display()))?;
        self.log_before = log.metadata().map_or(0, |log| log.len());
        let mut command = Command::new(OWN_BINARY);
        command
            .arg0("formica")
            .arg(self.role.name())
            .args(["--domain", domain, "--folder"])
            .arg(folder)
            .env(LAUNCHER, std::process::id().to_string())
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            // In its own process group, so that Ctrl-C reaches only the launcher.
            .process_group(0);
        if self.role == Role::Actor {
            command.args(["--id", &self.id.to_string()]);
        }
        let child = command
            .spawn()
            .with_context(|| format!("starting {}", self.name()))?;
        self.pid = child.id();
        self.child = Some(child);
        self.ready = false;
        self.killed_for = None;
        (self.last_status, self.progress) = (Instant::now(), (0, Instant::now()));
        Ok(())
    }

    /// Whether another process will be started in this slot.
    fn will_restart(&self) -> bool {
        self.restart_at.is_some() || self.held
    }

    /// The state of the slot, to be shown.
    pub(crate) fn state(&self) -> SlotState {
        SlotState {
            role: self.role,
            id: self.id,
            pid: self.pid,
            is_alive: self.child.is_some(),
            will_restart: self.will_restart(),
            silence: self.last_status.elapsed(),
            restarts: self.restarted,
        }
    }

    /// Adds a status of the process.
    pub(crate) fn on_status(&mut self, status: &Status) {
        let now = Instant::now();
        self.last_status = now;
        self.ready |= status.state > State::Starting as u32;
        self.was_ready |= self.ready;
        let busy = self.role == Role::Learner && status.state == State::Working as u32;
        if !busy || status.updates != self.progress.0 {
            self.progress = (status.updates, now);
        }
    }

    /// Kills a process that sends no status, or that has work and makes no progress.
    pub(super) fn check_timeouts(&mut self) {
        if self.child.is_none() || self.killed_for.is_some() {
            return;
        }
        let s = &self.supervision;
        let silence = if self.ready {
            s.hung_seconds
        } else {
            s.start_seconds
        };
        if self.last_status.elapsed().as_secs_f64() > silence {
            self.kill(format!("it was silent for {silence} s"));
        } else if self.progress.1.elapsed().as_secs_f64() > s.stuck_seconds {
            self.kill(format!("it got nothing done for {} s", s.stuck_seconds));
        }
    }

    pub(super) fn kill(&mut self, why: String) {
        self.killed_for = Some(why);
        self.signal(Signal::KILL);
    }

    pub(super) fn signal(&self, signal: Signal) {
        if let Some(child) = &self.child
            && let Some(pid) = Pid::from_raw(child.id() as i32)
        {
            let _ = kill_process(pid, signal);
        }
    }

    pub(super) fn is_occupied(&self) -> bool {
        self.child.is_some() || self.restart_at.is_some()
    }

    pub(super) fn end(&mut self, status: ExitStatus, stopping: bool, alone: bool) -> Ended {
        if status.success() && stopping {
            return Ended::Finished;
        }
        let why = match self.killed_for.take() {
            Some(why) => format!("was killed: {why}"),
            None if status.success() => "left before the run was over".to_owned(),
            None => format!("ended with {status}"),
        };
        let code = status.code().unwrap_or(0);
        // An error before it ever joined would not be fixed by a restart.
        if stopping || code == i32::from(exit::INPUT) || code != 0 && !self.was_ready {
            let why = match code {
                0 => why,
                _ => self.with_last_error(&why),
            };
            let input = code == i32::from(exit::INPUT);
            return Ended::Failed(Failure { why, input });
        }
        if self.held {
            return Ended::Restarting(why);
        }
        let now = Instant::now();
        let s = &self.supervision;
        let window = Duration::from_secs_f64(s.window_seconds);
        self.restarts.retain(|at| now - *at < window);
        let before = self.restarts.len();
        if before >= s.restarts {
            let times = format!(
                "{why}, after {before} restarts within {:.0} s",
                s.window_seconds
            );
            return if self.role == Role::Actor && !alone {
                Ended::GivenUp(times)
            } else {
                let why = match status.code() {
                    Some(1..) => self.with_last_error(&times),
                    _ => format!("{times}; its log is {}", self.log.display()),
                };
                Ended::Failed(Failure { why, input: false })
            };
        }
        let pause = s.pause_seconds * f64::from(2_u32.saturating_pow(before.min(16) as u32));
        let pause = Duration::from_secs_f64(pause.min(s.longest_pause_seconds));
        self.restarts.push_back(now);
        self.restart_at = Some(now + pause);
        Ended::Restarting(why)
    }

    pub(crate) fn name(&self) -> String {
        format!("{}-{}", self.role.name(), self.id)
    }

    /// Adds the last error of the process, and the path of its log.
    fn with_last_error(&self, why: &str) -> String {
        let log = self.log.display();
        match last_error(&self.log, self.log_before) {
            Some(error) if error.contains('\n') => format!("{why}; its log is {log}:\n{error}"),
            Some(error) => format!("{why}: {error}; its log is {log}"),
            None => format!("{why}; its log is {log}"),
        }
    }
}
