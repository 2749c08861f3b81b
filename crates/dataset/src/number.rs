//! Values of any number type, read as `f32`.

use half::f16;

/// What the bytes of a value are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// IEEE 754 binary floating point.
    Float,
    /// Two's complement.
    Signed,
    /// Without a sign; flags are 0 and 1.
    Unsigned,
}

/// Reads a value from its bytes, which are as many as it has.
pub(crate) type Decode = fn(&[u8]) -> f32;

/// How values of a kind, a size in bytes and a byte order are read; none for sizes that are not known.
pub(crate) fn decoder(kind: Kind, size: usize, big_endian: bool) -> Option<Decode> {
    macro_rules! of {
        ($type:ty, $convert:expr) => {
            if big_endian {
                |bytes: &[u8]| {
                    bytes
                        .first_chunk()
                        .map_or(f32::NAN, |bytes| $convert(<$type>::from_be_bytes(*bytes)))
                }
            } else {
                |bytes: &[u8]| {
                    bytes
                        .first_chunk()
                        .map_or(f32::NAN, |bytes| $convert(<$type>::from_le_bytes(*bytes)))
                }
            }
        };
        ($type:ty) => {
            of!($type, |value: $type| value as f32)
        };
    }
    Some(match (kind, size) {
        (Kind::Float, 2) => of!(f16, f16::to_f32),
        (Kind::Float, 4) => of!(f32, f32::from),
        (Kind::Float, 8) => of!(f64),
        (Kind::Signed, 1) => of!(i8),
        (Kind::Signed, 2) => of!(i16),
        (Kind::Signed, 4) => of!(i32),
        (Kind::Signed, 8) => of!(i64),
        (Kind::Unsigned, 1) => of!(u8),
        (Kind::Unsigned, 2) => of!(u16),
        (Kind::Unsigned, 4) => of!(u32),
        (Kind::Unsigned, 8) => of!(u64),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The value of the bytes, in both orders.
    fn both(kind: Kind, little: &[u8]) -> [f32; 2] {
        let big: Vec<u8> = little.iter().rev().copied().collect();
        let read = |bytes: &[u8], order| decoder(kind, bytes.len(), order).unwrap()(bytes);
        [read(little, false), read(&big, true)]
    }

    proptest! {
        #[test]
        fn numbers_of_all_types_and_both_byte_orders_are_read(value in any::<i64>(), real in any::<f64>()) {
            let (small, single) = (value as i16, real as f32);
            prop_assert_eq!(both(Kind::Signed, &value.to_le_bytes()), [value as f32; 2]);
            prop_assert_eq!(both(Kind::Signed, &(value as i32).to_le_bytes()), [value as i32 as f32; 2]);
            prop_assert_eq!(both(Kind::Signed, &small.to_le_bytes()), [f32::from(small); 2]);
            prop_assert_eq!(both(Kind::Signed, &[value as u8]), [f32::from(value as i8); 2]);
            prop_assert_eq!(both(Kind::Unsigned, &value.to_le_bytes()), [value as u64 as f32; 2]);
            prop_assert_eq!(both(Kind::Unsigned, &(value as u32).to_le_bytes()), [value as u32 as f32; 2]);
            prop_assert_eq!(both(Kind::Unsigned, &(value as u16).to_le_bytes()), [f32::from(value as u16); 2]);
            prop_assert_eq!(both(Kind::Unsigned, &[value as u8]), [f32::from(value as u8); 2]);
            if !single.is_nan() {
                let half = f16::from_f32(single);
                prop_assert_eq!(both(Kind::Float, &half.to_le_bytes()), [half.to_f32(); 2]);
                prop_assert_eq!(both(Kind::Float, &single.to_le_bytes()), [single; 2]);
                prop_assert_eq!(both(Kind::Float, &real.to_le_bytes()), [real as f32; 2]);
            }
        }
    }

    #[test]
    fn sizes_that_no_number_has_are_none() {
        for size in [0, 1, 3, 10, 16] {
            assert!(decoder(Kind::Float, size, false).is_none(), "{size}");
        }
        assert!(decoder(Kind::Signed, 3, true).is_none());
        // Too few bytes are no value.
        assert!(decoder(Kind::Float, 4, false).unwrap()(&[0; 3]).is_nan());
    }
}
