//! The ant's body, as D4RL's `ant.xml` gives it.

mod body;
mod egocentric;
mod mirror;
mod simulator;
mod world;

use std::f32::consts::{FRAC_1_SQRT_2, PI};

pub use body::AntBody;
pub use egocentric::{EGOCENTRIC, Egocentric};
pub use mirror::{mirrored, mirrored_action};
pub use simulator::AntSimulator;
pub use world::{AntMaze, Physics, Start, State};

/// Torque of a full action (N m).
pub const MAX_TORQUE: f32 = 30.0;

/// Directions of legs 1 to 4 in the torso's plane; times 0.2 m they are the hip offsets.
pub const LEG_DIRECTIONS: [[f32; 2]; 4] = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];

/// Ankle axes of legs 1 to 4 (unit vectors in the torso's plane).
pub(crate) const ANKLE_AXES: [[f32; 2]; 4] = [
    [-FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [-FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
];

/// Sign that makes an ankle angle of legs 1 to 4 positive when the foot bends down. With it the
/// four legs are copies of each other, turned by 90 degrees.
pub const ANKLE_SIGN: [f32; 4] = [1.0, -1.0, -1.0, 1.0];

const DEGREE: f32 = PI / 180.0;

/// Ranges of the eight joints (rad), hip and ankle of legs 1 to 4.
pub const JOINT_RANGES: [[f32; 2]; 8] = [
    [-30.0 * DEGREE, 30.0 * DEGREE],
    [30.0 * DEGREE, 70.0 * DEGREE],
    [-30.0 * DEGREE, 30.0 * DEGREE],
    [-70.0 * DEGREE, -30.0 * DEGREE],
    [-30.0 * DEGREE, 30.0 * DEGREE],
    [-70.0 * DEGREE, -30.0 * DEGREE],
    [-30.0 * DEGREE, 30.0 * DEGREE],
    [30.0 * DEGREE, 70.0 * DEGREE],
];

/// Joint that each actuator turns: actuators go hip 4, ankle 4, hip 1, ankle 1, hip 2, ...
pub const JOINT_OF_ACTUATOR: [usize; 8] = [6, 7, 0, 1, 2, 3, 4, 5];

/// Torso height of the reset pose (m).
pub(crate) const RESET_HEIGHT: f32 = 0.75;
pub(crate) const TORSO_RADIUS: f32 = 0.25;
pub(crate) const LEG_RADIUS: f32 = 0.08;
/// Offset from torso to hip and from hip to ankle, along each axis (m).
pub(crate) const LINK: f32 = 0.2;
pub(crate) const DENSITY: f32 = 5.0;
/// Added inertia of each hinge (kg m^2); about 400 times the foot's own.
pub(crate) const ARMATURE: f32 = 1.0;
/// Damping of each hinge (N m s/rad).
pub(crate) const DAMPING: f32 = 1.0;

/// The body on the parent side of a joint; bodies are torso, then hip and foot link of each leg.
pub(crate) const fn parent_body(joint: usize) -> usize {
    if joint.is_multiple_of(2) { 0 } else { joint }
}

/// The body on the child side of a joint.
pub(crate) const fn child_body(joint: usize) -> usize {
    joint + 1
}
