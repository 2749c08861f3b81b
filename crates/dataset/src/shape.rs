//! Shape of a data set's rows: shape and type of an observation, width of an action.

use std::fmt;

use maze::{ACTION, OBSERVATION};

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

    /// The ant's: 29 values and 8 torques.
    #[must_use]
    pub fn ant() -> Self {
        Self::vectors(OBSERVATION, ACTION)
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

    /// Number of positions at the start of an observation, if the rest are velocities.
    pub(crate) fn positions(&self) -> Option<usize> {
        match (self.element, self.sides.as_slice()) {
            // A quaternion has one value more than its velocity.
            (Element::F32, [OBSERVATION]) => Some(15),
            (Element::F32, [4]) => Some(2),
            _ => None,
        }
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
        let positions = [ant, Shape::vectors(4, 2), Shape::vectors(29, 2), images];
        let positions = positions.map(|shape| shape.positions());
        assert_eq!(positions, [Some(15), Some(2), Some(15), None]);
    }
}
