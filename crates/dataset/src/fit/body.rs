//! Bodies of the simulators, with the shape of their data.

use std::fmt;

use maze::{Action, Observation, mirrored, mirrored_action};

use crate::Shape;

/// Body of a run's simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// D4RL's ant. Its quaternion, height, joints and velocities are checked as well.
    Ant,
    /// A point mass: x, y and their velocities, with a force along each axis.
    Point,
}

impl fmt::Display for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ant => "ant",
            Self::Point => "point",
        })
    }
}

impl Body {
    /// All bodies.
    pub const ALL: [Self; 2] = [Self::Ant, Self::Point];

    /// The body of a run's simulator.
    #[must_use]
    pub fn named(simulator: &str) -> Self {
        let mut all = Self::ALL.into_iter();
        all.find(|body| body.to_string() == simulator)
            .unwrap_or(Self::Ant)
    }

    /// Shape of its data.
    #[must_use]
    pub fn shape(self) -> Shape {
        match self {
            Self::Ant => Shape::ant(),
            Self::Point => Shape::vectors(4, 2),
        }
    }

    /// The body whose data have this shape.
    #[must_use]
    pub fn of(shape: &Shape) -> Option<Self> {
        Self::ALL.into_iter().find(|body| body.shape() == *shape)
    }

    /// Mirrors a row across the x axis: position, velocity and action.
    pub(super) fn mirror(self, observation: &mut [f32], action: &mut [f32]) {
        match self {
            Self::Ant => {
                if let Ok(row) = <&mut Observation>::try_from(observation) {
                    *row = mirrored(row);
                }
                if let Ok(row) = <&mut Action>::try_from(action) {
                    *row = mirrored_action(row);
                }
            }
            Self::Point => {
                let moves = observation.chunks_exact_mut(2).chain([action]);
                for y in moves.filter_map(|pair| pair.get_mut(1)) {
                    *y = -*y;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_identifies_a_body() {
        for body in Body::ALL {
            assert_eq!(Body::of(&body.shape()), Some(body));
        }
        assert_eq!(Body::of(&Shape::vectors(27, 8)), None);
        assert_eq!(Body::of(&Shape::images(&[29], 8)), None);
    }

    #[test]
    fn mirroring_twice_is_the_identity() {
        for body in Body::ALL {
            let row = |count: usize| (1..=count).map(|at| at as f32).collect::<Vec<_>>();
            let (mut o, mut a) = (row(body.shape().observation()), row(body.shape().action()));
            body.mirror(&mut o, &mut a);
            assert_eq!(o[..2], [1.0, -2.0]);
            body.mirror(&mut o, &mut a);
            assert_eq!(o, row(body.shape().observation()));
            assert_eq!(a, row(body.shape().action()));
        }
    }
}
