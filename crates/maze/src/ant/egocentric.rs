//! The ant's state as its own body sees it.
//!
//! The ant is a fourfold copy of one leg. Turned by 90 degrees it is the same ant, so the
//! observation is expressed in that one of the four equivalent body frames in which the target
//! lies within 45 degrees of straight ahead, with legs and actuators renumbered. A policy on
//! these features is equivariant to the turns and never sees absolute x and y.

use simulator::Frame;

use crate::ant::{ANKLE_SIGN, JOINT_OF_ACTUATOR};
use crate::turn::{quarter_turns, turned_back};
use crate::{ACTION, Action};

/// Width of the features: height (1), up vector (3), joint angles (8), linear velocity (3),
/// angular velocity (3), joint velocities (8), unit direction to the target (2). Velocities are
/// scaled so that all features are of unit size.
pub const EGOCENTRIC: usize = 28;

/// Torso height of a standing ant (m).
const STANDING_HEIGHT: f32 = 0.55;

/// Features of an observation and the frame they are expressed in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Egocentric {
    /// The features; see [`EGOCENTRIC`].
    pub features: [f32; EGOCENTRIC],
    /// Number of quarter turns of the body, anticlockwise.
    frame: Frame,
}

/// Turns the first two components by `turns` quarter turns clockwise.
fn turn_back([x, y, z]: [f32; 3], turns: u8) -> [f32; 3] {
    let [x, y] = turned_back([x, y], turns);
    [x, y, z]
}

/// World vector to body frame, by the conjugate of quaternion w, x, y, z.
fn to_body(q: &[f32], v: [f32; 3]) -> [f32; 3] {
    let (w, u) = (q[0], [-q[1], -q[2], -q[3]]);
    let cross = |a: [f32; 3], b: [f32; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let t = cross(u, v).map(|c| 2.0 * c);
    let s = cross(u, t);
    std::array::from_fn(|i| v[i] + w * t[i] + s[i])
}

impl Egocentric {
    /// Features of an observation (29 values) on the way in a world `direction` (any length).
    /// A direction of zero length counts as straight ahead.
    #[must_use]
    pub fn new(observation: &[f32], direction: [f32; 2]) -> Self {
        let quaternion = &observation[3..7];
        let (w, x, y, z) = (quaternion[0], quaternion[1], quaternion[2], quaternion[3]);
        // Heading: the torso's x axis seen from above.
        let (ahead_x, ahead_y) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z));
        let norm = ahead_x.hypot(ahead_y).max(1e-6);
        let (cos, sin) = (ahead_x / norm, ahead_y / norm);
        let length = direction[0].hypot(direction[1]);
        let (dx, dy) = if length > 1e-6 {
            let (dx, dy) = (direction[0] / length, direction[1] / length);
            (dx * cos + dy * sin, dy * cos - dx * sin)
        } else {
            (1.0, 0.0)
        };
        let turns = quarter_turns([dx, dy]);

        let mut features = [0.0; EGOCENTRIC];
        features[0] = observation[2];
        let up = turn_back(to_body(quaternion, [0.0, 0.0, 1.0]), turns);
        features[1..4].copy_from_slice(&up);
        let world = [observation[15], observation[16], observation[17]];
        features[12..15].copy_from_slice(&turn_back(to_body(quaternion, world), turns));
        let spin = [observation[18], observation[19], observation[20]];
        features[15..18].copy_from_slice(&turn_back(spin, turns));
        for slot in 0..4 {
            let leg = (slot + usize::from(turns)) % 4;
            features[4 + 2 * slot] = observation[7 + 2 * leg];
            features[5 + 2 * slot] = ANKLE_SIGN[leg] * observation[8 + 2 * leg];
            features[18 + 2 * slot] = observation[21 + 2 * leg];
            features[19 + 2 * slot] = ANKLE_SIGN[leg] * observation[22 + 2 * leg];
        }
        features[0] = (features[0] - STANDING_HEIGHT) / 0.2;
        for (range, scale) in [(12..15, 0.5), (15..18, 0.25), (18..26, 0.15)] {
            features[range].iter_mut().for_each(|value| *value *= scale);
        }
        let ahead = turn_back([dx, dy, 0.0], turns);
        features[26..28].copy_from_slice(&ahead[..2]);
        Self {
            features,
            frame: Frame(turns),
        }
    }

    /// The frame of the features.
    #[must_use]
    pub fn frame(&self) -> Frame {
        self.frame
    }

    /// The action to simulate, from one in this frame (hip and ankle of legs ahead-left,
    /// behind-left, behind-right, ahead-right; positive ankles bend the foot down).
    #[must_use]
    pub fn to_actuators(&self, egocentric: &[f32]) -> Action {
        let mut action = [0.0; ACTION];
        to_actuators(self.frame, egocentric, &mut action);
        action
    }

    /// The inverse of [`to_actuators`](Self::to_actuators).
    #[must_use]
    pub fn from_actuators(&self, action: &[f32]) -> [f32; ACTION] {
        let mut egocentric = [0.0; ACTION];
        from_actuators(self.frame, action, &mut egocentric);
        egocentric
    }
}

/// As [`Egocentric::to_actuators`], by the frame alone.
pub(crate) fn to_actuators(frame: Frame, egocentric: &[f32], action: &mut [f32]) {
    for (actuator, value) in action.iter_mut().enumerate().take(ACTION) {
        let (slot, sign) = slot(frame, actuator);
        *value = sign * egocentric[slot];
    }
}

/// As [`Egocentric::from_actuators`], by the frame alone.
pub(crate) fn from_actuators(frame: Frame, action: &[f32], egocentric: &mut [f32]) {
    for (actuator, value) in action.iter().enumerate().take(ACTION) {
        let (slot, sign) = slot(frame, actuator);
        egocentric[slot] = sign * value;
    }
}

/// Where a frame has the value of an actuator, and its sign there.
fn slot(frame: Frame, actuator: usize) -> (usize, f32) {
    let joint = JOINT_OF_ACTUATOR[actuator];
    let leg = joint / 2;
    let slot = 2 * ((leg + 4 - usize::from(frame.0 % 4)) % 4) + joint % 2;
    (slot, if joint % 2 == 1 { ANKLE_SIGN[leg] } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AntMaze, Layout, Physics};

    #[test]
    fn actions_survive_the_round_trip_in_every_frame() {
        let mut observation = [0.0; 29];
        observation[3] = 1.0;
        let action: Action = std::array::from_fn(|i| i as f32 / 10.0 - 0.3);
        for direction in [[1.0, 0.2], [0.1, 1.0], [-1.0, 0.3], [0.2, -1.0]] {
            let frame = Egocentric::new(&observation, direction);
            assert_eq!(frame.to_actuators(&frame.from_actuators(&action)), action);
            assert!(frame.features[26] >= 0.7, "the target is ahead");
        }
    }

    /// The symmetry is the simulator's own: the same egocentric actions towards directions a
    /// quarter turn apart end in the same egocentric view, while the ant is in the air (on the
    /// floor the order in which the solver meets the contacts tells the legs apart).
    #[test]
    fn a_quarter_turn_of_the_target_turns_the_motion() {
        let layout = Layout::from_rows(&["rg"]).unwrap();
        let fly = |direction: [f32; 2]| {
            let mut ant = AntMaze::new(&layout, Physics::OPEN_FLOOR);
            let mut start = ant.observation();
            start[2] = 3.0;
            ant.set(&start);
            for step in 0..6 {
                let frame = Egocentric::new(&ant.observation(), direction);
                let own: Action =
                    std::array::from_fn(|i| ((step * 3 + i * 5) % 7) as f32 / 3.5 - 1.0);
                ant.step(&frame.to_actuators(&own));
            }
            let o = ant.observation();
            assert!(o[2] > 0.9, "it flies: {} m up", o[2]);
            let fastest = o[21..].iter().fold(0.0_f32, |most, v| most.max(v.abs()));
            assert!(fastest > 1.0, "its legs move: {fastest} rad/s");
            Egocentric::new(&o, direction).features
        };
        let east = fly([1.0, 0.0]);
        for direction in [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]] {
            for (i, (a, b)) in east.iter().zip(&fly(direction)).enumerate() {
                assert!((a - b).abs() < 2e-3, "feature {i}: {a} {b}");
            }
        }
    }

    #[test]
    fn turning_the_world_changes_no_feature() {
        let mut o: Vec<f32> = (0..29)
            .map(|i| ((i * 37 % 11) as f32 - 5.0) / 7.0)
            .collect();
        let half = 0.35_f32;
        o[3..7].copy_from_slice(&[half.cos(), 0.6 * half.sin(), 0.0, 0.8 * half.sin()]);
        let mut turned = o.clone();
        // The quaternion of a quarter turn about z, times the ant's own.
        let (c, (w, x, y, z)) = (0.5_f32.sqrt(), (o[3], o[4], o[5], o[6]));
        turned[3..7].copy_from_slice(&[c * (w - z), c * (x - y), c * (y + x), c * (z + w)]);
        turned[15..17].copy_from_slice(&[-o[16], o[15]]);
        let (a, b) = (
            Egocentric::new(&o, [0.3, 0.9]),
            Egocentric::new(&turned, [-0.9, 0.3]),
        );
        for (i, (a, b)) in a.features.iter().zip(&b.features).enumerate() {
            assert!((a - b).abs() < 1e-5, "feature {i}: {a} {b}");
        }
    }
}
