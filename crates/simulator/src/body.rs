//! How a body's observations are read.

use crate::Spaces;

/// Which of a body's equivalent frames features and actions are expressed in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Frame(pub u8);

/// A shape in the frame of its [`Part`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A sphere about the frame's origin.
    Sphere {
        /// Radius (m).
        radius: f32,
    },
    /// A rod with round ends.
    Capsule {
        /// One end (m).
        from: [f32; 3],
        /// The other end (m).
        to: [f32; 3],
        /// Radius (m).
        radius: f32,
    },
}

/// A part of a body that moves as one, to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Its name, unique within the body; traces use it as the name of a frame.
    pub name: &'static str,
    /// Its shapes.
    pub shapes: &'static [Shape],
}

/// Columns of an observation that is a vector: positions, then their velocities. x and y (m) stand
/// first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Columns {
    /// As many velocities as positions.
    Plain,
    /// A body that moves freely: x, y, z (m), the unit quaternion w, x, y, z, joint angles (rad); then
    /// the velocity in the world (m/s), the angular velocity, and the joints' (rad/s).
    Free {
        /// Least and greatest angle of each joint (rad).
        joints: &'static [[f32; 2]],
    },
}

impl Columns {
    /// Number of positions in an observation of `width` values.
    #[must_use]
    pub fn positions(self, width: usize) -> usize {
        match self {
            Self::Plain => width / 2,
            Self::Free { joints } => 7 + joints.len(),
        }
    }
}

/// What is known of a simulator without an instance. Observations are its
/// [`Spaces::observation`], actions its [`Spaces::action`].
pub trait Body: std::fmt::Debug + Send + Sync {
    /// Its name, as in `simulator = "ant"`.
    fn name(&self) -> &'static str;

    /// Shapes, element types and bounds.
    fn spaces(&self) -> Spaces;

    /// Columns of an observation, by which a data set is checked and written.
    fn columns(&self) -> Columns;

    /// Mirrors a row across the x axis: what the body does then is what it would do in the mirrored
    /// maze.
    fn mirror(&self, observation: &mut [f32], action: &mut [f32]);

    /// Replaces `action` by one that moves the body straight in a world `direction` (m, of any
    /// length) and returns true; returns false for a body that has to learn how.
    fn towards(&self, direction: [f32; 2], action: &mut Vec<f32>) -> bool {
        let _ = (direction, action);
        false
    }

    /// Where the body is (m), seen from above.
    fn place(&self, observation: &[f32]) -> [f32; 2];

    /// 1 for a body that stands, -1 for one on its back; 1 for one that cannot fall.
    fn upright(&self, observation: &[f32]) -> f32;

    /// Number of features of the body's own view.
    fn features(&self) -> usize;

    /// Appends the body's own view of an observation on the way in a world `direction` (m, of any
    /// length), free of absolute places. Returns the frame that features and actions are in.
    fn view(&self, observation: &[f32], direction: [f32; 2], features: &mut Vec<f32>) -> Frame;

    /// An action of the body's own frame, as the simulator takes it.
    fn to_actuators(&self, frame: Frame, action: &[f32], actuators: &mut [f32]);

    /// The inverse of [`to_actuators`](Self::to_actuators).
    #[expect(clippy::wrong_self_convention, reason = "named as the inverse")]
    fn from_actuators(&self, frame: Frame, actuators: &[f32], action: &mut [f32]);

    /// Its parts, to draw; [`Simulator::poses`](crate::Simulator::poses) gives a pose for each.
    fn parts(&self) -> &'static [Part];

    /// Points of the body at rest in the frame of its first part (m), for viewers that draw points
    /// but no shapes. May be empty.
    fn outline(&self) -> Vec<[f32; 3]>;
}
