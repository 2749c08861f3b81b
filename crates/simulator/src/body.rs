//! How a body's observations are read.

use crate::Spaces;

/// Which of a body's equivalent frames features and actions are expressed in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Frame(pub u8);

/// A part of a body, to draw. Its long axis is x, its origin the middle of its pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A sphere.
    Sphere {
        /// Radius (m).
        radius: f32,
    },
    /// A rod from `from` to `to` in the part's own frame.
    Capsule {
        /// One end (m).
        from: [f32; 3],
        /// The other end (m).
        to: [f32; 3],
        /// Radius (m).
        radius: f32,
    },
}

/// What is known of a simulator without an instance. Observations are its
/// [`Spaces::observation`], actions its [`Spaces::action`].
pub trait Body: Send + Sync {
    /// Its name, as in `simulator = "ant"`.
    fn name(&self) -> &'static str;

    /// Shapes, element types and bounds.
    fn spaces(&self) -> Spaces;

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
    fn from_actuators(&self, frame: Frame, actuators: &[f32], action: &mut [f32]);

    /// Its parts, to draw, and their names.
    fn shapes(&self) -> &'static [(&'static str, Shape)];
}
