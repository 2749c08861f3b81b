//! Shape of a data set's rows: shape and type of an observation, width of an action.

use std::fmt;

use maze::AntBody;
use simulator::{Body, Dtype, Space};

/// Type of an observation's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// `f32`, whatever number type the file has.
    F32,
    /// Bytes of images.
    U8,
}

/// Shape of a data set's rows. `Display` describes it in a few words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    sides: Vec<usize>,
    element: Element,
    action: usize,
}

impl Shape {
    /// Observations of `observation` values, of which the first two are x and y.
    #[must_use]
    pub fn vectors(observation: usize, action: usize) -> Self {
        Self {
            sides: vec![observation],
            element: Element::F32,
            action,
        }
    }

    /// Images with these dimensions (rows, columns, channels), one byte per value.
    #[must_use]
    pub fn images(sides: &[usize], action: usize) -> Self {
        Self {
            sides: sides.to_vec(),
            element: Element::U8,
            action,
        }
    }

    /// The shape of a simulator's rows.
    #[must_use]
    pub fn of(body: &dyn Body) -> Self {
        let spaces = body.spaces();
        Self {
            sides: spaces.observation.shape,
            element: match spaces.observation.dtype {
                Dtype::F32 => Element::F32,
                Dtype::U8 => Element::U8,
            },
            action: spaces.action.len(),
        }
    }

    /// The ant's: 29 values and 8 torques.
    #[must_use]
    pub fn ant() -> Self {
        Self::of(&AntBody)
    }

    /// Bodies of the simulators whose rows have this shape.
    pub fn bodies(&self) -> impl Iterator<Item = &'static dyn Body> + use<> {
        let observation = Space {
            shape: self.sides.clone(),
            dtype: match self.element {
                Element::F32 => Dtype::F32,
                Element::U8 => Dtype::U8,
            },
        };
        simulators::with_spaces(observation, Space::vector(self.action))
    }

    /// Dimensions of an observation; one for a vector.
    #[must_use]
    pub fn sides(&self) -> &[usize] {
        &self.sides
    }

    /// Type of an observation's values.
    #[must_use]
    pub fn element(&self) -> Element {
        self.element
    }

    /// Number of values in an observation.
    #[must_use]
    pub fn observation(&self) -> usize {
        self.sides.iter().product()
    }

    /// Number of values in an action.
    #[must_use]
    pub fn action(&self) -> usize {
        self.action
    }

    /// Number of positions at the start of an observation, if a simulator is known whose
    /// observations are positions and then velocities.
    pub(crate) fn positions(&self) -> Option<usize> {
        let body = self
            .bodies()
            .next()
            .filter(|_| self.element == Element::F32)?;
        Some(body.columns().positions(self.observation()))
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sides: Vec<String> = self.sides.iter().map(usize::to_string).collect();
        let observation = match self.element {
            Element::F32 => format!("observations of {} values", sides.join(" x ")),
            Element::U8 => format!("images of {} bytes", sides.join(" x ")),
        };
        write!(f, "{observation} and actions of {}", self.action)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_and_names_of_shapes() {
        let ant = Shape::ant();
        assert_eq!((ant.observation(), ant.action()), (29, 8));
        assert_eq!(
            ant.to_string(),
            "observations of 29 values and actions of 8"
        );
        let images = Shape::images(&[64, 64, 3], 8);
        assert_eq!(images.observation(), 12_288);
        assert_eq!(
            images.to_string(),
            "images of 64 x 64 x 3 bytes and actions of 8"
        );
        let names = |shape: &Shape| shape.bodies().map(Body::name).collect::<Vec<_>>();
        assert_eq!(names(&ant), ["ant"]);
        assert_eq!(names(&Shape::vectors(4, 2)), ["point"]);
        assert!(names(&images).is_empty() && names(&Shape::vectors(27, 8)).is_empty());
        let positions = [ant, Shape::vectors(4, 2), Shape::vectors(29, 2), images];
        let positions = positions.map(|shape| shape.positions());
        assert_eq!(positions, [Some(15), Some(2), None, None]);
    }
}
