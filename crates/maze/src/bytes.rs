//! States as bytes, little-endian.

/// Appends floats.
pub(crate) fn put_floats(bytes: &mut Vec<u8>, values: &[f32]) {
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

/// Takes `N` floats off the front; `None` if there are fewer.
pub(crate) fn take_floats<const N: usize>(bytes: &mut &[u8]) -> Option<[f32; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        let (first, rest) = bytes.split_first_chunk()?;
        *value = f32::from_le_bytes(*first);
        *bytes = rest;
    }
    Some(values)
}

/// Takes a number off the front; `None` if there are too few bytes.
pub(crate) fn take_number(bytes: &mut &[u8]) -> Option<u64> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(u64::from_le_bytes(*first))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_taken_in_the_order_they_were_put_in() {
        let mut bytes = vec![];
        put_floats(&mut bytes, &[1.5, -0.0]);
        bytes.extend(7_u64.to_le_bytes());
        let mut rest = &bytes[..];
        let [a, b] = take_floats(&mut rest).unwrap();
        assert_eq!(
            (a.to_bits(), b.to_bits()),
            (1.5_f32.to_bits(), (-0.0_f32).to_bits())
        );
        assert_eq!((take_number(&mut rest), rest.len()), (Some(7), 0));
        assert_eq!(
            (take_number(&mut rest), take_floats::<1>(&mut rest)),
            (None, None)
        );
    }
}
