//! What is known of the ant without a world.

use simulator::{Body, Columns, Frame, Part, Shape, Space, Spaces};

use super::egocentric::{self, EGOCENTRIC, Egocentric};
use super::{JOINT_RANGES, LEG_RADIUS, LINK, TORSO_RADIUS, mirrored, mirrored_action};
use crate::{ACTION, Action, CONTROL_SECONDS, OBSERVATION, Observation, upright};

/// The ant.
#[derive(Debug, Clone, Copy)]
pub struct AntBody;

/// A bone from a part's origin along a leg's direction.
const fn bone(leg: usize, length: f32) -> Shape {
    let [x, y] = super::LEG_DIRECTIONS[leg];
    Shape::Capsule {
        from: [0.0; 3],
        to: [length * x, length * y, 0.0],
        radius: LEG_RADIUS,
    }
}

const TORSO: [Shape; 5] = [
    Shape::Sphere {
        radius: TORSO_RADIUS,
    },
    bone(0, LINK),
    bone(1, LINK),
    bone(2, LINK),
    bone(3, LINK),
];
const HIPS: [[Shape; 1]; 4] = [
    [bone(0, LINK)],
    [bone(1, LINK)],
    [bone(2, LINK)],
    [bone(3, LINK)],
];
const FEET: [[Shape; 1]; 4] = [
    [bone(0, 2.0 * LINK)],
    [bone(1, 2.0 * LINK)],
    [bone(2, 2.0 * LINK)],
    [bone(3, 2.0 * LINK)],
];

static PARTS: [Part; 9] = [
    Part {
        name: "torso",
        shapes: &TORSO,
    },
    Part {
        name: "hip_1",
        shapes: &HIPS[0],
    },
    Part {
        name: "foot_1",
        shapes: &FEET[0],
    },
    Part {
        name: "hip_2",
        shapes: &HIPS[1],
    },
    Part {
        name: "foot_2",
        shapes: &FEET[1],
    },
    Part {
        name: "hip_3",
        shapes: &HIPS[2],
    },
    Part {
        name: "foot_3",
        shapes: &FEET[2],
    },
    Part {
        name: "hip_4",
        shapes: &HIPS[3],
    },
    Part {
        name: "foot_4",
        shapes: &FEET[3],
    },
];

impl Body for AntBody {
    fn name(&self) -> &'static str {
        "ant"
    }

    fn spaces(&self) -> Spaces {
        Spaces {
            observation: Space::vector(OBSERVATION),
            action: Space::vector(ACTION),
            goal: 2,
            control_seconds: CONTROL_SECONDS,
        }
    }

    fn columns(&self) -> Columns {
        Columns::Free {
            joints: &JOINT_RANGES,
        }
    }

    fn mirror(&self, observation: &mut [f32], action: &mut [f32]) {
        if let Ok(row) = <&mut Observation>::try_from(observation) {
            *row = mirrored(row);
        }
        if let Ok(row) = <&mut Action>::try_from(action) {
            *row = mirrored_action(row);
        }
    }

    fn place(&self, observation: &[f32]) -> [f32; 2] {
        [observation[0], observation[1]]
    }

    fn upright(&self, observation: &[f32]) -> f32 {
        upright(observation)
    }

    fn features(&self) -> usize {
        EGOCENTRIC
    }

    fn view(&self, observation: &[f32], direction: [f32; 2], features: &mut Vec<f32>) -> Frame {
        let view = Egocentric::new(observation, direction);
        features.extend_from_slice(&view.features);
        view.frame()
    }

    fn to_actuators(&self, frame: Frame, action: &[f32], actuators: &mut [f32]) {
        egocentric::to_actuators(frame, action, actuators);
    }

    fn from_actuators(&self, frame: Frame, actuators: &[f32], action: &mut [f32]) {
        egocentric::from_actuators(frame, actuators, action);
    }

    fn parts(&self) -> &'static [Part] {
        &PARTS
    }

    /// A circle about the torso in two planes, and the legs: out from the torso, then down to the
    /// floor.
    fn outline(&self) -> Vec<[f32; 3]> {
        let reach = |i: u8| 0.1 * f32::from(i);
        let leg = |[x, y]: [f32; 2]| {
            (1..9).map(move |i| [x * reach(i), y * reach(i), -0.12 * f32::from(i.max(4) - 4)])
        };
        let torso = (0_u8..12).flat_map(|i| {
            let (sin, cos) = (f32::from(i) * std::f32::consts::FRAC_PI_6).sin_cos();
            let (sin, cos) = (TORSO_RADIUS * sin, TORSO_RADIUS * cos);
            [[cos, sin, 0.0], [cos, 0.0, sin]]
        });
        torso
            .chain(super::LEG_DIRECTIONS.into_iter().flat_map(leg))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Observation;

    #[test]
    fn the_body_sees_what_egocentric_does_and_its_actions_come_back() {
        let mut observation: Observation = std::array::from_fn(|i| i as f32 / 29.0);
        observation[3..7].copy_from_slice(&[0.8, 0.0, 0.0, 0.6]);
        let own: [f32; ACTION] = std::array::from_fn(|i| i as f32 / 8.0);
        for direction in [[1.0, 0.1], [-0.2, 3.0], [-5.0, 0.0], [0.0, -0.1]] {
            let (mut features, mut actuators, mut back) = (vec![7.0], [0.0; ACTION], [0.0; ACTION]);
            let frame = AntBody.view(&observation, direction, &mut features);
            let view = Egocentric::new(&observation, direction);
            assert_eq!(features[1..], view.features);
            assert_eq!(features.len(), 1 + AntBody.features());
            AntBody.to_actuators(frame, &own, &mut actuators);
            assert_eq!(actuators, view.to_actuators(&own));
            AntBody.from_actuators(frame, &actuators, &mut back);
            assert_eq!(back, own);
        }
    }
}
