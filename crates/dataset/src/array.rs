//! Arrays in memory of their own or in a mapped file.

use std::fmt;
use std::ops::{Deref, DerefMut, Range};
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;

/// A slice in a vector or in a mapped file. Modifying a mapped array copies it to a vector first, as
/// [`std::borrow::Cow`] does; the file is never modified.
#[derive(Clone)]
pub struct Array<T>(Store<T>);

#[derive(Clone)]
enum Store<T> {
    Owned(Vec<T>),
    /// A byte range that casts to `[T]`.
    Mapped(Arc<Mmap>, Range<usize>),
}

impl<T: Pod> Array<T> {
    /// Casts a byte range of a file; `None` if it is out of bounds, misaligned, or not a whole number
    /// of elements.
    pub(crate) fn mapped(map: &Arc<Mmap>, bytes: Range<usize>) -> Option<Self> {
        let found = map.get(bytes.clone())?;
        bytemuck::try_cast_slice::<u8, T>(found).ok()?;
        Some(Self(Store::Mapped(Arc::clone(map), bytes)))
    }

    /// Returns true if the array is in a mapped file.
    #[must_use]
    pub fn is_mapped(&self) -> bool {
        matches!(self.0, Store::Mapped(..))
    }

    /// Returns the vector, copying a mapped array first.
    pub fn to_mut(&mut self) -> &mut Vec<T> {
        if self.is_mapped() {
            self.0 = Store::Owned(self.to_vec());
        }
        match &mut self.0 {
            Store::Owned(values) => values,
            Store::Mapped(..) => unreachable!("a mapped array was copied"),
        }
    }

    /// Appends an element.
    pub fn push(&mut self, value: T) {
        self.to_mut().push(value);
    }

    /// Appends elements.
    pub fn extend_from_slice(&mut self, values: &[T]) {
        self.to_mut().extend_from_slice(values);
    }
}

impl<T: Pod> Deref for Array<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Store::Owned(values) => values,
            Store::Mapped(map, bytes) => bytemuck::cast_slice(&map[bytes.clone()]),
        }
    }
}

impl<T: Pod> DerefMut for Array<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.to_mut()
    }
}

impl<T> Default for Array<T> {
    fn default() -> Self {
        Self(Store::Owned(vec![]))
    }
}

impl<T> From<Vec<T>> for Array<T> {
    fn from(values: Vec<T>) -> Self {
        Self(Store::Owned(values))
    }
}

impl<T> FromIterator<T> for Array<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        Vec::from_iter(values).into()
    }
}

impl<T: Pod> Extend<T> for Array<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, values: I) {
        self.to_mut().extend(values);
    }
}

impl<'a, T: Pod> IntoIterator for &'a Array<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<T: Pod + fmt::Debug> fmt::Debug for Array<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

impl<T: Pod + PartialEq> PartialEq for Array<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Pod + PartialEq> PartialEq<[T]> for Array<T> {
    fn eq(&self, other: &[T]) -> bool {
        **self == *other
    }
}

impl<T: Pod + PartialEq> PartialEq<&[T]> for Array<T> {
    fn eq(&self, other: &&[T]) -> bool {
        **self == **other
    }
}

impl<T: Pod + PartialEq, const N: usize> PartialEq<[T; N]> for Array<T> {
    fn eq(&self, other: &[T; N]) -> bool {
        **self == *other
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn map(bytes: &[u8]) -> Arc<Mmap> {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        Arc::new(crate::mapped::map(&file).unwrap())
    }

    #[test]
    fn a_mapped_array_is_copied_on_write() {
        let values = [1.5_f32, -2.0, 3.25];
        let map = map(bytemuck::cast_slice(&values));
        let mut array = Array::<f32>::mapped(&map, 0..12).unwrap();
        assert!(array.is_mapped());
        assert_eq!(array, values);
        assert_eq!(array.clone().into_iter().sum::<f32>(), 2.75);
        array[1] = 4.0;
        array.push(5.0);
        assert!(!array.is_mapped());
        assert_eq!(array, [1.5, 4.0, 3.25, 5.0]);
        // The file is unchanged.
        assert_eq!(*Array::<f32>::mapped(&map, 0..12).unwrap(), values);
    }

    #[test]
    fn invalid_ranges_are_refused() {
        let map = map(&[0; 16]);
        assert!(Array::<f32>::mapped(&map, 0..10).is_none());
        assert!(Array::<f32>::mapped(&map, 2..6).is_none());
        assert!(Array::<f32>::mapped(&map, 12..20).is_none());
        assert!(Array::<u64>::mapped(&map, 8..16).is_some());
        assert!(Array::<[f32; 2]>::mapped(&map, 0..16).is_some());
        assert!(Array::<f32>::mapped(&map, 4..4).unwrap().is_empty());
    }
}
