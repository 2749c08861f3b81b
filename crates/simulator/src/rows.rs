//! Steps as flat words: what travels between processes, read in place.
//!
//! A row is a whole number of 32-bit words: flags, reward, log-probability, observation, action,
//! goal. Bytes of an image lie four in a word.

use crate::{Dtype, Spaces, Values};

/// Bits of a row's flags.
pub mod flags {
    /// The episode ended for good after this step.
    pub const TERMINAL: u32 = 1;
    /// The episode was cut off after this step.
    pub const TRUNCATED: u32 = 2;
    /// The body cannot go on after this step, as an ant on its back.
    pub const FELL: u32 = 4;
    /// Not a step: only the observation that follows the last one.
    pub const FINAL: u32 = 8;
    /// The episode's goal was reached by this step.
    pub const SUCCESS: u32 = 16;
    /// A step of a test: no policy learns from it.
    pub const TEST: u32 = 32;
}

const FLAGS: usize = 0;
const REWARD: usize = 1;
const LOG_PROB: usize = 2;
const HEAD: usize = 3;

/// Where a row's values are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowLayout {
    dtype: Dtype,
    elements: usize,
    action: usize,
    goal: usize,
    stride: usize,
}

impl RowLayout {
    /// Of steps in these spaces.
    #[must_use]
    pub fn new(spaces: &Spaces) -> Self {
        let action = HEAD + spaces.observation.words();
        let goal = action + spaces.action.len();
        Self {
            dtype: spaces.observation.dtype,
            elements: spaces.observation.len(),
            action,
            goal,
            stride: goal + spaces.goal,
        }
    }

    /// Words of a row.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Rows in words; words beyond the last whole row are left out.
    #[must_use]
    pub fn rows<'a>(&'a self, words: &'a [u32]) -> Rows<'a> {
        Rows {
            layout: self,
            words,
        }
    }
}

/// Rows that lie one after another.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    layout: &'a RowLayout,
    words: &'a [u32],
}

impl<'a> Rows<'a> {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.len() / self.layout.stride
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The words of all rows.
    #[must_use]
    pub fn words(&self) -> &'a [u32] {
        self.words
    }

    /// One row.
    ///
    /// # Panics
    /// When there are not as many.
    #[must_use]
    pub fn row(&self, number: usize) -> Row<'a> {
        let stride = self.layout.stride;
        Row {
            layout: self.layout,
            words: &self.words[number * stride..(number + 1) * stride],
        }
    }

    /// All rows in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = Row<'a>> + ExactSizeIterator + use<'a> {
        let (layout, words) = (self.layout, self.words);
        words
            .chunks_exact(layout.stride)
            .map(move |words| Row { layout, words })
    }
}

/// One step, or the observation after the last one ([`flags::FINAL`]).
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    layout: &'a RowLayout,
    words: &'a [u32],
}

impl<'a> Row<'a> {
    /// Bits of [`flags`].
    #[must_use]
    pub fn flags(&self) -> u32 {
        self.words[FLAGS]
    }

    /// Whether any of some bits of [`flags`] is set.
    #[must_use]
    pub fn has(&self, flags: u32) -> bool {
        self.flags() & flags != 0
    }

    /// Reward after the action.
    #[must_use]
    pub fn reward(&self) -> f32 {
        f32::from_bits(self.words[REWARD])
    }

    /// Log-probability of the action.
    #[must_use]
    pub fn log_prob(&self) -> f32 {
        f32::from_bits(self.words[LOG_PROB])
    }

    /// Observation before the action.
    #[must_use]
    pub fn observation(&self) -> Values<'a> {
        let words = &self.words[HEAD..self.layout.action];
        match self.layout.dtype {
            Dtype::F32 => Values::F32(bytemuck::cast_slice(words)),
            Dtype::U8 => Values::U8(&bytemuck::cast_slice(words)[..self.layout.elements]),
        }
    }

    /// The action as sampled; the simulator clips it.
    #[must_use]
    pub fn action(&self) -> &'a [f32] {
        bytemuck::cast_slice(&self.words[self.layout.action..self.layout.goal])
    }

    /// The goal that was pursued.
    #[must_use]
    pub fn goal(&self) -> &'a [f32] {
        bytemuck::cast_slice(&self.words[self.layout.goal..])
    }

    /// Whether every float is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        self.reward().is_finite()
            && self.log_prob().is_finite()
            && self.observation().is_finite()
            && finite(self.action())
            && finite(self.goal())
    }
}

/// What a row is made of.
#[derive(Debug, Clone, Copy)]
pub struct RowValues<'a> {
    /// Bits of [`flags`].
    pub flags: u32,
    /// Reward after the action.
    pub reward: f32,
    /// Log-probability of the action.
    pub log_prob: f32,
    /// Observation before the action.
    pub observation: Values<'a>,
    /// The action; zeros where it is empty.
    pub action: &'a [f32],
    /// The goal; zeros where it is empty.
    pub goal: &'a [f32],
}

/// Rows being gathered; its memory is kept.
#[derive(Debug, Clone)]
pub struct RowBuffer {
    layout: RowLayout,
    words: Vec<u32>,
}

impl RowBuffer {
    /// Room for so many rows.
    #[must_use]
    pub fn new(layout: RowLayout, rows: usize) -> Self {
        Self {
            words: Vec::with_capacity(rows * layout.stride),
            layout,
        }
    }

    /// Appends a row.
    ///
    /// # Panics
    /// When a value is not of the layout's width.
    pub fn push(&mut self, values: RowValues<'_>) {
        let layout = &self.layout;
        let start = self.words.len();
        self.words.resize(start + layout.stride, 0);
        let row = &mut self.words[start..];
        row[FLAGS] = values.flags;
        row[REWARD] = values.reward.to_bits();
        row[LOG_PROB] = values.log_prob.to_bits();
        let observation = &mut row[HEAD..layout.action];
        match values.observation {
            Values::F32(floats) => {
                bytemuck::cast_slice_mut(observation).copy_from_slice(floats);
            }
            Values::U8(bytes) => {
                let space: &mut [u8] = bytemuck::cast_slice_mut(observation);
                space[..layout.elements].copy_from_slice(bytes);
            }
        }
        for (range, values) in [
            (layout.action..layout.goal, values.action),
            (layout.goal..layout.stride, values.goal),
        ] {
            if !values.is_empty() {
                bytemuck::cast_slice_mut(&mut row[range]).copy_from_slice(values);
            }
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.len() / self.layout.stride
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// All rows.
    #[must_use]
    pub fn rows(&self) -> Rows<'_> {
        self.layout.rows(&self.words)
    }

    /// Forgets all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.words.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Space;

    fn spaces(observation: Space) -> Spaces {
        Spaces {
            observation,
            action: Space::vector(2),
            goal: 3,
            control_seconds: 0.1,
        }
    }

    #[test]
    fn rows_come_back_as_they_were_put_in() {
        let layout = RowLayout::new(&spaces(Space::vector(4)));
        assert_eq!(layout.stride(), 3 + 4 + 2 + 3);
        let mut buffer = RowBuffer::new(layout, 2);
        buffer.push(RowValues {
            flags: flags::SUCCESS | flags::TERMINAL,
            reward: 1.0,
            log_prob: -0.5,
            observation: Values::F32(&[1.0, 2.0, 3.0, 4.0]),
            action: &[0.25, -1.5],
            goal: &[7.0, 8.0, 9.0],
        });
        buffer.push(RowValues {
            flags: flags::FINAL,
            reward: 0.0,
            log_prob: 0.0,
            observation: Values::F32(&[5.0; 4]),
            action: &[],
            goal: &[],
        });
        let rows = buffer.rows();
        let row = rows.row(0);
        assert!(row.has(flags::SUCCESS) && !row.has(flags::FINAL));
        assert_eq!((row.reward(), row.log_prob()), (1.0, -0.5));
        assert_eq!(row.observation(), Values::F32(&[1.0, 2.0, 3.0, 4.0]));
        assert_eq!(
            (row.action(), row.goal()),
            (&[0.25, -1.5][..], &[7.0, 8.0, 9.0][..])
        );
        let last = rows.iter().next_back().unwrap();
        assert_eq!((last.action(), last.goal()), (&[0.0; 2][..], &[0.0; 3][..]));
        assert_eq!((rows.len(), buffer.len()), (2, 2));
    }

    #[test]
    fn images_lie_in_rows_as_bytes() {
        let image = Space {
            shape: vec![3, 3, 3],
            dtype: Dtype::U8,
        };
        let layout = RowLayout::new(&spaces(image));
        let mut buffer = RowBuffer::new(layout, 1);
        let bytes: Vec<u8> = (0..27).collect();
        buffer.push(RowValues {
            flags: 0,
            reward: 0.0,
            log_prob: 0.0,
            observation: Values::U8(&bytes),
            action: &[0.0; 2],
            goal: &[0.0; 3],
        });
        assert_eq!(buffer.rows().row(0).observation(), Values::U8(&bytes));
        assert!(buffer.rows().row(0).is_finite());
    }

    #[test]
    fn a_value_that_is_not_finite_is_found_wherever_it_is() {
        let layout = RowLayout::new(&spaces(Space::vector(4)));
        let zeros = vec![0; layout.stride()];
        assert!(layout.rows(&zeros).row(0).is_finite());
        for word in 1..layout.stride() {
            let mut words = zeros.clone();
            words[word] = f32::NAN.to_bits();
            assert!(!layout.rows(&words).row(0).is_finite(), "word {word}");
        }
    }
}
