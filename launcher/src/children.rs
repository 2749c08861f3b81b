//! The processes of a run: started in order, watched, restarted, ended.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use config::{Config, Supervision};
use rustix::process::{Pid, Signal, kill_process};
use wire::{Role, State, Status};

use crate::check;

/// One place in the topology and the process that fills it.
pub(crate) struct Place {
    pub(crate) role: Role,
    pub(crate) id: u32,
    log: PathBuf,
    supervision: Supervision,
    child: Option<Child>,
    /// The newest process, also once it has ended.
    pub(crate) pid: u32,
    /// Times of restarts within the window.
    restarts: VecDeque<Instant>,
    restart_at: Option<Instant>,
    /// Not to be started before it is released.
    held: bool,
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
    Failed(String),
}

/// All processes of a run.
pub(crate) struct Children {
    pub(crate) places: Vec<Place>,
    folder: PathBuf,
    domain: String,
}

impl Children {
    pub(crate) fn new(folder: &Path, domain: &str) -> Self {
        Self {
            places: vec![],
            folder: folder.to_path_buf(),
            domain: domain.to_owned(),
        }
    }

    /// Starts a process.
    pub(crate) fn start(&mut self, role: Role, id: u32, config: &Config) -> anyhow::Result<()> {
        let name = format!("{}-{id}.log", role.name());
        let supervision = match role {
            Role::Actor => &config.actor,
            Role::Learner => &config.learner,
            Role::GraphBuilder => &config.graph_builder,
        };
        let now = Instant::now();
        let mut place = Place {
            role,
            id,
            log: self.folder.join("logs").join(name),
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
        };
        place.spawn(&self.folder, &self.domain)?;
        self.places.push(place);
        Ok(())
    }

    /// The place whose newest process a status is of.
    pub(crate) fn place_of(&mut self, role: Role, status: &Status) -> Option<&mut Place> {
        self.places
            .iter_mut()
            .find(|p| p.role == role && p.id == status.id && p.pid == status.pid)
    }

    /// Sees which processes ended, kills those that hang, and starts those again whose pause is
    /// over.
    pub(crate) fn tend(&mut self, stopping: bool) -> anyhow::Result<Vec<(usize, Ended)>> {
        let mut ended = vec![];
        for i in 0..self.places.len() {
            let others = self.places.iter().enumerate();
            let others = others.filter(|(j, p)| *j != i && p.role == self.places[i].role);
            let alone = !others.map(|(_, p)| p).any(Place::is_filled);
            let place = &mut self.places[i];
            let status = match &mut place.child {
                Some(child) => child.try_wait()?,
                None => None,
            };
            if let Some(status) = status {
                place.child = None;
                ended.push((i, place.end(status, stopping, alone)));
            }
            if stopping {
                continue;
            }
            place.look_after();
            if !place.held && place.restart_at.is_some_and(|at| at <= Instant::now()) {
                place.restart_at = None;
                place.restarted += 1;
                place.spawn(&self.folder, &self.domain)?;
            }
        }
        Ok(ended)
    }

    /// All that was heard of processes counts as heard just now: the launcher itself stood still.
    pub(crate) fn forgive(&mut self) {
        for place in &mut self.places {
            (place.heard, place.worked.1) = (Instant::now(), Instant::now());
        }
    }

    /// Kills the processes of these roles and keeps them from being started again until they are
    /// [released](Self::release).
    pub(crate) fn hold(&mut self, roles: &[Role]) {
        for place in self.of(roles) {
            place.held = true;
            if place.child.is_some() {
                place.kill("to go on together with the others".to_owned());
                place.restart_at = None;
            }
        }
    }

    /// Whether all processes of these roles are gone.
    pub(crate) fn are_gone(&mut self, roles: &[Role]) -> bool {
        self.of(roles).all(|place| place.child.is_none())
    }

    pub(crate) fn release(&mut self, roles: &[Role]) {
        for place in self.of(roles) {
            place.held = false;
            place.restart_at.get_or_insert_with(Instant::now);
        }
    }

    fn of<'c>(&'c mut self, roles: &'c [Role]) -> impl Iterator<Item = &'c mut Place> {
        self.places
            .iter_mut()
            .filter(|place| roles.contains(&place.role))
    }

    /// Whether a process is alive or will be again.
    pub(crate) fn any_left(&self, stopping: bool) -> bool {
        self.places
            .iter()
            .any(|place| place.child.is_some() || !stopping && place.restart_at.is_some())
    }

    pub(crate) fn signal(&self, signal: Signal) {
        self.places.iter().for_each(|place| place.signal(signal));
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
        let child = command.spawn().context("starting a process")?;
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
    fn look_after(&mut self) {
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

    fn kill(&mut self, why: String) {
        self.killed_for = Some(why);
        self.signal(Signal::KILL);
    }

    fn signal(&self, signal: Signal) {
        if let Some(child) = &self.child
            && let Some(pid) = Pid::from_raw(child.id() as i32)
        {
            let _ = kill_process(pid, signal);
        }
    }

    fn is_filled(&self) -> bool {
        self.child.is_some() || self.restart_at.is_some()
    }

    fn end(&mut self, status: ExitStatus, stopping: bool, alone: bool) -> Ended {
        if status.success() && stopping {
            return Ended::Finished;
        }
        let why = match self.killed_for.take() {
            Some(why) => format!("was killed: {why}"),
            None if status.success() => "left before the run was over".to_owned(),
            None => format!("ended with {status}"),
        };
        // What it says before it ever joined is for the user to mend, not for a restart; and so is
        // a fault in what it was given, whenever it is found.
        let hopeless = status
            .code()
            .is_some_and(|code| code == check::GIVEN || code != 0 && !self.was_ready);
        if stopping || hopeless {
            return Ended::Failed(why);
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
                Ended::Failed(times)
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
