//! Every simulator, by its name.
//!
//! A simulator is a type that implements [`Simulator`], with its [`Body`], and an entry in `ALL`.

use maze::{AntBody, AntSimulator, Layout, PointBody, PointSimulator};
use simulator::{Body, Simulator, Space};

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

/// Bodies whose simulators observe and take arrays like these.
pub fn with_spaces(observation: Space, action: Space) -> impl Iterator<Item = &'static dyn Body> {
    let bodies = ALL.iter().map(|entry| entry.body);
    bodies.filter(move |body| {
        let spaces = body.spaces();
        spaces.observation == observation && spaces.action == action
    })
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
        let spaces = body("point").unwrap().spaces();
        let mut found = with_spaces(spaces.observation, spaces.action);
        assert_eq!(found.next().map(Body::name), Some("point"));
        assert!(
            with_spaces(Space::vector(4), Space::vector(8))
                .next()
                .is_none()
        );
        assert!(body("humanoid").is_none() && create("humanoid", &layout, 0.5).is_none());
    }

    #[test]
    fn mirroring_twice_is_the_identity() {
        for body in names().filter_map(body) {
            let spaces = body.spaces();
            let row = |count: usize| (1_u8..).take(count).map(f32::from).collect::<Vec<_>>();
            let (o, a) = (row(spaces.observation.len()), row(spaces.action.len()));
            let (mut observation, mut action) = (o.clone(), a.clone());
            body.mirror(&mut observation, &mut action);
            assert_eq!(observation[..2], [1.0, -2.0]);
            assert_ne!(action, a);
            body.mirror(&mut observation, &mut action);
            assert_eq!((observation, action), (o, a));
        }
    }

    #[test]
    fn names_are_unique() {
        let mut sorted: Vec<_> = names().collect();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names().count());
    }
}
