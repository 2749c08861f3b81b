//! Every simulator, by its name.
//!
//! A simulator is a type that implements [`Simulator`], with its [`Body`], and an entry in `ALL`.

use maze::{AntBody, AntSimulator, Layout, PointBody, PointSimulator};
use simulator::{Body, Simulator};

/// A simulator that a run can use.
struct Entry {
    body: &'static dyn Body,
    create: fn(&Layout, f32) -> Box<dyn Simulator>,
}

static ALL: &[Entry] = &[
    Entry {
        body: &AntBody,
        create: |layout, radius| Box::new(AntSimulator::new(layout, radius)),
    },
    Entry {
        body: &PointBody,
        create: |layout, radius| Box::new(PointSimulator::new(layout, radius)),
    },
];

fn entry(name: &str) -> Option<&'static Entry> {
    ALL.iter().find(|entry| entry.body.name() == name)
}

/// Names of all simulators.
pub fn names() -> impl Iterator<Item = &'static str> {
    ALL.iter().map(|entry| entry.body.name())
}

/// The body of a simulator; `None` for an unknown name.
#[must_use]
pub fn body(name: &str) -> Option<&'static dyn Body> {
    entry(name).map(|entry| entry.body)
}

/// An instance of a simulator in a maze, where an episode succeeds within `success_radius` (m) of
/// its goal; `None` for an unknown name.
#[must_use]
pub fn create(name: &str, layout: &Layout, success_radius: f32) -> Option<Box<dyn Simulator>> {
    entry(name).map(|entry| (entry.create)(layout, success_radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_simulator_is_created_by_its_name() {
        let layout = Layout::named("umaze").unwrap();
        for name in names() {
            let simulator = create(name, &layout, maze::SUCCESS_RADIUS).unwrap();
            assert_eq!(simulator.body().name(), name);
            assert_eq!(body(name).unwrap().spaces(), simulator.body().spaces());
        }
        assert!(body("humanoid").is_none() && create("humanoid", &layout, 0.5).is_none());
    }

    #[test]
    fn names_are_unique() {
        let mut sorted: Vec<_> = names().collect();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names().count());
    }
}
