//! Shapes and element types of what is observed and done.

use std::fmt;

/// Element type of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// 32-bit floats.
    F32,
    /// Bytes, as of an image.
    U8,
}

impl Dtype {
    /// Bytes of an element.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::U8 => 1,
        }
    }
}

/// Shape and element type of an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Space {
    /// Sizes of its axes, as `[64, 64, 3]`.
    pub shape: Vec<usize>,
    /// Element type.
    pub dtype: Dtype,
}

impl Space {
    /// A vector of floats.
    #[must_use]
    pub fn vector(len: usize) -> Self {
        Self {
            shape: vec![len],
            dtype: Dtype::F32,
        }
    }

    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether it has no element.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// 32-bit words that its elements take, the last one filled up.
    #[must_use]
    pub fn words(&self) -> usize {
        (self.len() * self.dtype.bytes()).div_ceil(4)
    }
}

impl fmt::Display for Space {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dtype = match self.dtype {
            Dtype::F32 => "f32",
            Dtype::U8 => "u8",
        };
        let shape: Vec<String> = self.shape.iter().map(ToString::to_string).collect();
        write!(f, "{dtype}:{}", shape.join("x"))
    }
}

/// A text that describes no [`Spaces`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' describes no spaces; expected observation action goal seconds, as f32:29 f32:8 2 0.1"
)]
pub struct SpacesError(pub String);

/// What a run's simulator observes and takes. It goes between processes as
/// [text](fmt::Display).
#[derive(Debug, Clone, PartialEq)]
pub struct Spaces {
    /// Observations.
    pub observation: Space,
    /// Actions, floats in [-1, 1].
    pub action: Space,
    /// Width of a goal.
    pub goal: usize,
    /// Simulated time of a step (s).
    pub control_seconds: f32,
}

/// An axis is at most this long, and so is a whole array: no product overflows.
const MOST: usize = 1 << 26;

fn space(text: &str) -> Option<Space> {
    let (dtype, shape) = text.split_once(':')?;
    let dtype = match dtype {
        "f32" => Dtype::F32,
        "u8" => Dtype::U8,
        _ => return None,
    };
    let mut len = 1_usize;
    let mut axes = vec![];
    for axis in shape.split('x') {
        let axis: usize = axis.parse().ok()?;
        len = len
            .checked_mul(axis)
            .filter(|len| (1..=MOST).contains(len))?;
        axes.push(axis);
    }
    Some(Space { shape: axes, dtype })
}

impl Spaces {
    /// Reads what [`Display`](fmt::Display) writes.
    ///
    /// # Errors
    /// [`SpacesError`] for anything else, and for arrays of more than 2^26 elements.
    pub fn parse(text: &str) -> Result<Self, SpacesError> {
        let read = || {
            let mut parts = text.split_whitespace();
            let spaces = Self {
                observation: space(parts.next()?)?,
                action: space(parts.next()?).filter(|space| space.dtype == Dtype::F32)?,
                goal: parts.next()?.parse().ok().filter(|goal| *goal <= MOST)?,
                control_seconds: parts.next()?.parse().ok()?,
            };
            let timed = spaces.control_seconds.is_finite() && spaces.control_seconds > 0.0;
            (timed && parts.next().is_none()).then_some(spaces)
        };
        read().ok_or_else(|| SpacesError(text.to_owned()))
    }
}

impl fmt::Display for Spaces {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            observation,
            action,
            goal,
            control_seconds,
        } = self;
        write!(f, "{observation} {action} {goal} {control_seconds}")
    }
}

/// Values of a [`Space`], read in place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Values<'a> {
    /// Of [`Dtype::F32`].
    F32(&'a [f32]),
    /// Of [`Dtype::U8`].
    U8(&'a [u8]),
}

impl<'a> Values<'a> {
    /// The floats; `None` for bytes.
    #[must_use]
    pub fn floats(self) -> Option<&'a [f32]> {
        match self {
            Self::F32(values) => Some(values),
            Self::U8(_) => None,
        }
    }

    /// Whether every value is finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.floats()
            .is_none_or(|values| values.iter().all(|value| value.is_finite()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> Spaces {
        Spaces {
            observation: Space {
                shape: vec![64, 64, 3],
                dtype: Dtype::U8,
            },
            action: Space::vector(8),
            goal: 2,
            control_seconds: 0.1,
        }
    }

    #[test]
    fn spaces_go_through_text() {
        let text = image().to_string();
        assert_eq!(text, "u8:64x64x3 f32:8 2 0.1");
        assert_eq!(Spaces::parse(&text), Ok(image()));
    }

    #[test]
    fn a_text_that_describes_no_spaces_is_refused() {
        for text in [
            "",
            "f32:29",
            "f32:29 f32:8 2",
            "f32:29 f32:8 2 0.1 more",
            "f32:0 f32:8 2 0.1",
            "f32:29 u8:8 2 0.1",
            "f64:29 f32:8 2 0.1",
            "f32:4294967296x4294967296 f32:8 2 0.1",
            "f32:29 f32:8 -1 0.1",
            "f32:29 f32:8 2 nan",
            "f32:29 f32:8 2 0",
        ] {
            assert!(Spaces::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn bytes_fill_whole_words() {
        let bytes = |len| Space {
            shape: vec![len],
            dtype: Dtype::U8,
        };
        assert_eq!([1, 4, 5].map(|len| bytes(len).words()), [1, 1, 2]);
        assert_eq!(Space::vector(29).words(), 29);
    }
}
