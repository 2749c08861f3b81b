//! Bodies in D4RL's and OGBench's mazes: the ant in rapier, and a point mass.
//!
//! `maze` is pure: `step(state, action)` and nothing else. It does no I/O, has no clock, no
//! network, no process and no global state; randomness comes in through a generator.
//!
//! The ant follows D4RL's `ant.xml` and the mazes D4RL's `maze_env.py`
//! (Farama-Foundation/d4rl, `d4rl/locomotion`), the point OGBench's `point.py`
//! (seohongpark/ogbench, `ogbench/locomaze`).

mod ant;
mod arena;
mod bytes;
mod layout;
mod point;
mod route;
mod task;
mod teleport;
mod turn;

pub use ant::{
    ANKLE_SIGN, AntBody, AntMaze, AntSimulator, EGOCENTRIC, Egocentric, JOINT_OF_ACTUATOR,
    JOINT_RANGES, LEG_DIRECTIONS, MAX_TORQUE, Physics, Start, State, mirrored, mirrored_action,
};
pub use layout::{CELL_SIZE, Cell, Layout, LayoutError, WALL_HEIGHT};
pub use point::{PointBody, PointSimulator};
pub use route::Route;
pub use task::{SUCCESS_RADIUS, Style, Task, evaluation_task, random_task};

/// Width of the ant's observation: 15 positions, then 14 velocities, in D4RL's order.
pub const OBSERVATION: usize = 29;
/// Number of the ant's torque actuators.
pub const ACTION: usize = 8;
/// Simulated time of a control step (s).
pub const CONTROL_SECONDS: f32 = 0.1;

/// x, y, z (m); quaternion w, x, y, z; eight joint angles (rad, hip and ankle of legs 1 to 4);
/// linear velocity (m/s, world); angular velocity (rad/s, body); eight joint velocities (rad/s).
pub type Observation = [f32; OBSERVATION];
/// Torques as shares of [`MAX_TORQUE`] in [-1, 1], in actuator order: hip and ankle of
/// legs 4, 1, 2, 3.
pub type Action = [f32; ACTION];

/// The z component of the torso's up vector, from an observation's quaternion: 1 when upright,
/// -1 when the ant lies on its back.
#[must_use]
pub fn upright(observation: &[f32]) -> f32 {
    let (x, y) = (observation[4], observation[5]);
    1.0 - 2.0 * (x * x + y * y)
}

/// Below this [`upright`] value an ant lies on its back.
pub const FALLEN: f32 = 0.0;
/// Below this [`upright`] value an episode of the walker's training ends early: an ant that has tipped
/// over so far seldom stands up again.
pub const TIPPED_OVER: f32 = 0.2;
