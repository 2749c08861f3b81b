//! The processes of a run: started in order, watched, restarted, ended.

mod last_words;
mod place;

use std::path::{Path, PathBuf};
use std::time::Instant;

use config::Config;
use rustix::process::Signal;
use wire::{Role, Status};

pub(crate) use place::{Ended, Failure, Place};

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
        let supervision = match role {
            Role::Actor => &config.actor,
            Role::Learner => &config.learner,
            Role::GraphBuilder => &config.graph_builder,
        };
        let mut place = Place::new(role, id, &self.folder, supervision);
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
        self.places.iter_mut().for_each(Place::forgive);
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
