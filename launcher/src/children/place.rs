//! A place in the topology, and the process that fills it.

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

use super::last_words::last_words;
use crate::role::LAUNCHER;

/// The binary that this process runs, also when its file has been replaced or removed since.
const OWN_BINARY: &str = "/proc/self/exe";
/// Exit code of a process that ends for a fault in what the user gave.
const INPUT: i32 = 2;

/// One place in the topology and the process that fills it.
pub(crate) struct Place {
    pub(crate) role: Role,
    pub(crate) id: u32,
    log: PathBuf,
    /// Bytes of the log that earlier processes wrote.
    log_before: u64,
    supervision: Supervision,
    pub(super) child: Option<Child>,
    /// The newest process, also once it has ended.
    pub(crate) pid: u32,
    /// Times of restarts within the window.
    restarts: VecDeque<Instant>,
    pub(super) restart_at: Option<Instant>,
    /// Not to be started before it is released.
    pub(super) held: bool,
    pub(crate) restarted: usize,
    /// Joined the run at least once.
    was_ready: bool,
    ready: bool,
    heard: Instant,
    /// Steps of its work that were done when it last got on with it, and when that was.
    worked: (u64, Instant),
    /// Why the launcher killed it.
    killed_for: Option<String>,
}

/// How a process came to its end.
pub(crate) enum Ended {
    /// In order.
    Finished,
    /// For this reason; it will be started again.
    Restarting(String),
    /// For this reason, too often; the run goes on without it.
    GivenUp(String),
    /// For this reason, and the run cannot or may not go on without it.
    Failed(Failure),
}

/// Why a run ends before its time.
pub(crate) struct Failure {
    pub(crate) why: String,
    /// Whether it is a fault in what the user gave.
    pub(crate) input: bool,
}

impl Place {
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
            heard: now,
            worked: (0, now),
            killed_for: None,
        }
    }

    /// Counts all that was heard as heard just now.
    pub(super) fn forgive(&mut self) {
        (self.heard, self.worked.1) = (Instant::now(), Instant::now());
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
            // A group of its own: Ctrl-C in the terminal is the launcher's to pass on.
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
        (self.heard, self.worked) = (Instant::now(), (0, Instant::now()));
        Ok(())
    }

    /// Whether there is a process.
    pub(crate) fn is_alive(&self) -> bool {
        self.child.is_some()
    }

    /// Whether there will be another process in the place of one that is gone.
    pub(crate) fn is_to_return(&self) -> bool {
        self.restart_at.is_some() || self.held
    }

    /// Time since the process said something, or was started.
    pub(crate) fn silence(&self) -> Duration {
        self.heard.elapsed()
    }

    /// Notes that the process said something.
    pub(crate) fn hear(&mut self, status: &Status) {
        let now = Instant::now();
        self.heard = now;
        self.ready |= status.state > State::Starting as u32;
        self.was_ready |= self.ready;
        let busy = self.role == Role::Learner && status.state == State::Working as u32;
        if !busy || status.updates != self.worked.0 {
            self.worked = (status.updates, now);
        }
    }

    /// Kills a process that hangs: one that is silent, or has work and does not get on with it.
    pub(super) fn look_after(&mut self) {
        if self.child.is_none() || self.killed_for.is_some() {
            return;
        }
        let s = &self.supervision;
        let silence = if self.ready {
            s.hung_seconds
        } else {
            s.start_seconds
        };
        if self.heard.elapsed().as_secs_f64() > silence {
            self.kill(format!("it was silent for {silence} s"));
        } else if self.worked.1.elapsed().as_secs_f64() > s.stuck_seconds {
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

    pub(super) fn is_filled(&self) -> bool {
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
        // What it says before it ever joined is for the user to mend, not for a restart.
        if stopping || code == INPUT || code != 0 && !self.was_ready {
            let why = match code {
                0 => why,
                _ => self.with_last_words(&why),
            };
            let input = code == INPUT;
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
                    Some(1..) => self.with_last_words(&times),
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

    /// The same with the error that the process told last, and where all of its log is.
    fn with_last_words(&self, why: &str) -> String {
        let log = self.log.display();
        match last_words(&self.log, self.log_before) {
            Some(words) if words.contains('\n') => format!("{why}; its log is {log}:\n{words}"),
            Some(words) => format!("{why}: {words}; its log is {log}"),
            None => format!("{why}; its log is {log}"),
        }
    }
}
