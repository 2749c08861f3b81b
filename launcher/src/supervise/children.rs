//! The processes of a run: starts, watches and restarts them.

mod last_error;
mod slot;

use std::path::{Path, PathBuf};
use std::time::Instant;

use config::Config;
use rustix::process::Signal;
use wire::{Role, Status};

pub(crate) use slot::{Ended, Failure, Slot};

/// All processes of a run.
pub(crate) struct Children {
    pub(crate) slots: Vec<Slot>,
    folder: PathBuf,
    domain: String,
}

impl Children {
    pub(crate) fn new(folder: &Path, domain: &str) -> Self {
        Self {
            slots: vec![],
            folder: folder.to_path_buf(),
            domain: domain.to_owned(),
        }
    }

    /// Starts a process.
    pub(crate) fn start(&mut self, role: Role, id: u32, config: &Config) -> anyhow::Result<()> {
        let supervision = match role {
            Role::Actor => &config.actor,
            Role::Learner => &config.learner,
            Role::GraphBuilder => &config.graph_builder,
        };
        let mut slot = Slot::new(role, id, &self.folder, supervision);
        slot.spawn(&self.folder, &self.domain)?;
        self.slots.push(slot);
        Ok(())
    }

    /// The slot whose newest process sent a status.
    pub(crate) fn slot_of(&mut self, role: Role, status: &Status) -> Option<&mut Slot> {
        self.slots
            .iter_mut()
            .find(|p| p.role == role && p.id == status.id && p.pid == status.pid)
    }

    /// Polls the processes: finds ended ones, kills hung ones, and restarts those whose pause is over.
    pub(crate) fn poll(&mut self, stopping: bool) -> anyhow::Result<Vec<(usize, Ended)>> {
        let mut ended = vec![];
        for i in 0..self.slots.len() {
            let others = self.slots.iter().enumerate();
            let others = others.filter(|(j, p)| *j != i && p.role == self.slots[i].role);
            let alone = !others.map(|(_, p)| p).any(Slot::is_occupied);
            let slot = &mut self.slots[i];
            let status = match &mut slot.child {
                Some(child) => child.try_wait()?,
                None => None,
            };
            if let Some(status) = status {
                slot.child = None;
                ended.push((i, slot.end(status, stopping, alone)));
            }
            if stopping {
                continue;
            }
            slot.check_timeouts();
            if !slot.held && slot.restart_at.is_some_and(|at| at <= Instant::now()) {
                slot.restart_at = None;
                slot.restarted += 1;
                slot.spawn(&self.folder, &self.domain)?;
            }
        }
        Ok(ended)
    }

    /// Restarts all timeouts, after the launcher itself was suspended.
    pub(crate) fn reset_timeouts(&mut self) {
        self.slots.iter_mut().for_each(Slot::reset_timeouts);
    }

    /// Kills the processes of these roles, and does not restart them before [`release`](Self::release).
    pub(crate) fn hold(&mut self, roles: &[Role]) {
        for slot in self.of(roles) {
            slot.held = true;
            if slot.child.is_some() {
                slot.kill("to go on together with the others".to_owned());
                slot.restart_at = None;
            }
        }
    }

    /// Whether all processes of these roles have ended.
    pub(crate) fn are_gone(&mut self, roles: &[Role]) -> bool {
        self.of(roles).all(|slot| slot.child.is_none())
    }

    /// Restarts the processes of these roles.
    pub(crate) fn release(&mut self, roles: &[Role]) {
        for slot in self.of(roles) {
            slot.held = false;
            slot.restart_at.get_or_insert_with(Instant::now);
        }
    }

    fn of<'c>(&'c mut self, roles: &'c [Role]) -> impl Iterator<Item = &'c mut Slot> {
        self.slots
            .iter_mut()
            .filter(|slot| roles.contains(&slot.role))
    }

    /// Whether a process is alive or will be restarted.
    pub(crate) fn any_left(&self, stopping: bool) -> bool {
        self.slots
            .iter()
            .any(|slot| slot.child.is_some() || !stopping && slot.restart_at.is_some())
    }

    pub(crate) fn signal(&self, signal: Signal) {
        self.slots.iter().for_each(|slot| slot.signal(signal));
    }
}

impl Drop for Children {
    /// Leaves no process behind in any case.
    fn drop(&mut self) {
        self.signal(Signal::KILL);
        for child in self.slots.iter_mut().filter_map(|slot| slot.child.as_mut()) {
            let _ = child.wait();
        }
    }
}
