//! The processes of a run as rows of the view.

use std::time::{Duration, Instant};

use wire::{Role, State, Status};

use super::view::{Health, Process};
use crate::show::scene::{Scene, SlotState};

/// An attached actor without a status for this long has left.
pub(super) const LEFT: Duration = Duration::from_secs(15);

/// The run's own processes, then attached ones.
pub(super) fn processes(scene: &Scene, now: Instant) -> Vec<Process> {
    let mut processes: Vec<Process> = scene
        .slots
        .iter()
        .map(|slot| {
            let status = scene.statuses.get(&(slot.role, slot.id));
            let status = status.map(|(status, _)| status);
            let present = status.filter(|status| status.pid == slot.pid);
            let silence = slot.is_alive.then_some(slot.silence);
            process(
                scene,
                (slot.role, slot.id),
                present,
                health(slot, present),
                silence,
                now,
            )
            .with(slot)
        })
        .collect();
    for ((role, id), (status, seen)) in scene.statuses {
        let own = |slot: &SlotState| (slot.role, slot.id) == (*role, *id);
        let silence = now.saturating_duration_since(*seen);
        if scene.slots.iter().any(own) || silence > LEFT {
            continue;
        }
        let health = Health::Alive(State::from_number(status.state).unwrap_or(State::Finished));
        let mut process = process(
            scene,
            (*role, *id),
            Some(status),
            health,
            Some(silence),
            now,
        );
        process.name += " +";
        processes.push(process);
    }
    processes
}

fn health(slot: &SlotState, present: Option<&Status>) -> Health {
    let state = present.and_then(|status| State::from_number(status.state));
    match state {
        state if slot.is_alive => Health::Alive(state.unwrap_or(State::Starting)),
        _ if slot.will_restart => Health::Restarting,
        Some(State::Finished) => Health::Alive(State::Finished),
        _ => Health::Gone,
    }
}

fn process(
    scene: &Scene,
    (role, id): (Role, u32),
    status: Option<&Status>,
    health: Health,
    silence: Option<Duration>,
    now: Instant,
) -> Process {
    let name = match role {
        Role::Actor => format!("{} {id}", role.name()),
        _ => role.name().to_owned(),
    };
    let share = |status: &Status| {
        let [done, all] = status.progress;
        (all > 0).then(|| done as f64 / all as f64)
    };
    let working = matches!(health, Health::Alive(State::Working | State::Trained));
    Process {
        name,
        pid: status.map(|status| status.pid),
        health,
        doing: status.map_or_else(String::new, |status| printable(&status.text())),
        done: status.and_then(share),
        rate: match role {
            Role::Actor if working => Some((scene.throughput.of_actor(id, now), "steps")),
            Role::Learner => scene.throughput.of_learner(now),
            _ => None,
        },
        restarts: 0,
        silence,
    }
}

impl Process {
    /// Adds what the launcher knows.
    fn with(self, slot: &SlotState) -> Self {
        Self {
            pid: slot.is_alive.then_some(slot.pid),
            restarts: slot.restarts,
            ..self
        }
    }
}

/// A text without characters that could move the cursor.
pub(super) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() && c != '\n' { ' ' } else { c })
        .collect()
}
