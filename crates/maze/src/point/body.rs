//! The point mass: its spaces, its own view, its shape.

use simulator::{Body, Columns, Frame, Part, Shape, Space, Spaces};

use crate::CONTROL_SECONDS;
use crate::turn::{quarter_turns, turned, turned_back};

/// Radius of the disc (m).
pub(super) const RADIUS: f32 = 0.7;
/// What a full action adds to the place in its axis (m).
pub(super) const STRIDE: f32 = 0.2;
/// Top speed in an axis (m/s).
const TOP_SPEED: f32 = STRIDE / CONTROL_SECONDS;

/// The point mass.
#[derive(Debug, Clone, Copy)]
pub struct PointBody;

static PARTS: [Part; 1] = [Part {
    name: "point",
    shapes: &[Shape::Sphere { radius: RADIUS }],
}];

impl Body for PointBody {
    fn name(&self) -> &'static str {
        "point"
    }

    fn spaces(&self) -> Spaces {
        Spaces {
            observation: Space::vector(4),
            action: Space::vector(2),
            goal: 2,
            control_seconds: CONTROL_SECONDS,
        }
    }

    fn columns(&self) -> Columns {
        Columns::Plain
    }

    fn mirror(&self, observation: &mut [f32], action: &mut [f32]) {
        for y in observation.iter_mut().chain(action).skip(1).step_by(2) {
            *y = -*y;
        }
    }

    /// By `direction`, or as far as it gets in a step.
    fn towards(&self, direction: [f32; 2], action: &mut Vec<f32>) -> bool {
        let longest = direction[0].abs().max(direction[1].abs()).max(STRIDE);
        action.clear();
        action.extend(direction.map(|axis| axis / longest));
        true
    }

    fn place(&self, observation: &[f32]) -> [f32; 2] {
        [observation[0], observation[1]]
    }

    fn upright(&self, _: &[f32]) -> f32 {
        1.0
    }

    /// Velocity as a share of the top speed, and unit direction to the target.
    fn features(&self) -> usize {
        4
    }

    /// The frame is the one of four quarter turns in which the target lies within 45 degrees of
    /// straight ahead. A direction of no length, or none that is finite, counts as straight ahead.
    fn view(&self, observation: &[f32], direction: [f32; 2], features: &mut Vec<f32>) -> Frame {
        let length = direction[0].hypot(direction[1]);
        let direction = match length.is_finite() && length > 1e-6 {
            true => direction.map(|axis| axis / length),
            false => [1.0, 0.0],
        };
        let turns = quarter_turns(direction);
        let velocity = [observation[2], observation[3]].map(|axis| axis / TOP_SPEED);
        features.extend(turned_back(velocity, turns));
        features.extend(turned_back(direction, turns));
        Frame(turns)
    }

    fn to_actuators(&self, frame: Frame, action: &[f32], actuators: &mut [f32]) {
        actuators[..2].copy_from_slice(&turned([action[0], action[1]], frame.0));
    }

    fn from_actuators(&self, frame: Frame, actuators: &[f32], action: &mut [f32]) {
        action[..2].copy_from_slice(&turned_back([actuators[0], actuators[1]], frame.0));
    }

    fn parts(&self) -> &'static [Part] {
        &PARTS
    }

    /// A circle in each of two planes.
    fn outline(&self) -> Vec<[f32; 3]> {
        (0_u8..24)
            .flat_map(|i| {
                let (sin, cos) = (f32::from(i) * std::f32::consts::TAU / 24.0).sin_cos();
                let (sin, cos) = (RADIUS * sin, RADIUS * cos);
                [[cos, sin, 0.0], [cos, 0.0, sin]]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(observation: [f32; 4], direction: [f32; 2]) -> (Frame, Vec<f32>) {
        let mut features = vec![];
        let frame = PointBody.view(&observation, direction, &mut features);
        assert_eq!(features.len(), PointBody.features());
        (frame, features)
    }

    #[test]
    fn the_target_is_ahead_and_actions_survive_the_round_trip() {
        for direction in [[3.0, 0.2], [0.1, 1.0], [-1.0, 0.3], [0.2, -9.0], [0.0, 0.0]] {
            let (frame, features) = view([1.0, 2.0, 0.4, -0.2], direction);
            assert!(features[2] >= 0.7, "{features:?}");
            let (mut actuators, mut back) = ([0.0; 2], [0.0; 2]);
            PointBody.to_actuators(frame, &[0.25, -0.5], &mut actuators);
            PointBody.from_actuators(frame, &actuators, &mut back);
            assert_eq!(back, [0.25, -0.5]);
        }
    }

    #[test]
    fn neither_place_nor_a_quarter_turn_of_the_world_changes_a_feature() {
        let (_, features) = view([1.0, 2.0, 0.4, -0.2], [0.3, 0.9]);
        assert_eq!(view([7.0, -5.0, 0.4, -0.2], [0.3, 0.9]).1, features);
        assert_eq!(view([1.0, 2.0, 0.2, 0.4], [-0.9, 0.3]).1, features);
    }

    #[test]
    fn a_full_action_ahead_moves_towards_the_target() {
        for direction in [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]] {
            let (frame, _) = view([0.0; 4], direction);
            let mut actuators = [0.0; 2];
            PointBody.to_actuators(frame, &[1.0, 0.0], &mut actuators);
            assert_eq!(actuators, direction);
        }
    }

    #[test]
    fn it_moves_straight_to_a_place_and_stops_there() {
        let mut action = vec![];
        for (way, wanted) in [
            ([4.0, -2.0], [1.0, -0.5]),
            ([0.1, 0.0], [0.5, 0.0]),
            ([0.0, 0.0], [0.0, 0.0]),
        ] {
            assert!(PointBody.towards(way, &mut action));
            assert_eq!(action, wanted);
        }
    }

    #[test]
    fn a_direction_that_is_not_finite_is_straight_ahead() {
        for direction in [[f32::NAN, 1.0], [f32::INFINITY, 1.0], [f32::MAX, f32::MAX]] {
            let (frame, features) = view([0.0; 4], direction);
            assert_eq!((frame, &features[2..]), (Frame(0), &[1.0, 0.0][..]));
        }
    }
}
