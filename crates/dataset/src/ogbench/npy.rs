//! The header of numpy's array files (numpy/numpy, `numpy/lib/format.py`): a Python dict literal.

use std::io::{self, Read};

use crate::number::{Decode, Kind, decoder};

/// What every array file begins with.
const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header that is believed; numpy's own are of 128 bytes, its reader stops at 10,000.
const LONGEST: usize = 1 << 16;

/// What the header tells.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// Byte order, kind and size of a value, such as `<f4`.
    pub(super) descr: String,
    /// Whether the first index runs fastest.
    pub(super) fortran: bool,
    /// Length of each side.
    pub(super) shape: Vec<u64>,
}

/// Reads a header, up to the first value.
pub(super) fn header(reader: &mut impl Read) -> Result<Header, String> {
    let mut exact = |count: usize| -> Result<Vec<u8>, String> {
        let mut bytes = vec![0; count];
        reader
            .read_exact(&mut bytes)
            .map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => "is cut off in its header".to_owned(),
                _ => format!("cannot be read: {error}"),
            })?;
        Ok(bytes)
    };
    let start = exact(8)?;
    if !start.starts_with(MAGIC) {
        return Err("is no numpy array".to_owned());
    }
    let width = match start[6] {
        1 => 2,
        2 | 3 => 4,
        version => return Err(format!("is of numpy's array format {version}, not 1 to 3")),
    };
    let length = exact(width)?
        .iter()
        .rev()
        .fold(0_u64, |all, byte| all << 8 | u64::from(*byte));
    let length = usize::try_from(length)
        .ok()
        .filter(|length| *length <= LONGEST);
    let bytes = exact(length.ok_or("has a header that is too long")?)?;
    let text = String::from_utf8(bytes).map_err(|_| "has a header that is no text".to_owned())?;
    parse(&text).ok_or_else(|| format!("has a header that cannot be read: {}", text.trim()))
}

/// The header that numpy writes for values of a type in rows of a width.
pub(super) fn written(descr: &str, shape: &[usize]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    let sides = sides.join(", ");
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({sides}{comma}), }}");
    // Values begin at a multiple of 64 bytes; the header's last byte ends a line.
    let before = MAGIC.len() + 4;
    let length = (before + text.len() + 1).next_multiple_of(64) - before;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    text.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}

/// A dict literal with the three keys of a header, none else and none twice.
fn parse(text: &str) -> Option<Header> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let (mut descr, mut fortran, mut shape) = (None, None, None);
    while !rest.is_empty() {
        let (key, after) = quoted(rest)?;
        let after = after.trim_start().strip_prefix(':')?.trim_start();
        let twice;
        (rest, twice) = match key {
            "descr" => {
                let (value, after) = quoted(after)?;
                (after, descr.replace(value.to_owned()).is_some())
            }
            "fortran_order" => {
                let value = after.starts_with("True");
                let after = after.strip_prefix(if value { "True" } else { "False" })?;
                (after, fortran.replace(value).is_some())
            }
            "shape" => {
                let (sides, after) = after.strip_prefix('(')?.split_once(')')?;
                (after, shape.replace(tuple(sides)?).is_some())
            }
            _ => return None,
        };
        if twice {
            return None;
        }
        rest = rest.trim_start();
        if !rest.is_empty() {
            rest = rest.strip_prefix(',')?.trim_start();
        }
    }
    Some(Header {
        descr: descr?,
        fortran: fortran?,
        shape: shape?,
    })
}

/// A text in quotes of either kind, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text
        .chars()
        .next()
        .filter(|quote| matches!(quote, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// Whole numbers between commas, the last comma with or without a number after it.
fn tuple(text: &str) -> Option<Vec<u64>> {
    let text = text.trim();
    if text.is_empty() {
        return Some(vec![]);
    }
    let sides = text.strip_suffix(',').unwrap_or(text).split(',');
    // Python 2 wrote long numbers with an L.
    sides
        .map(|side| side.trim().trim_end_matches('L').parse().ok())
        .collect()
}

/// Bytes of a value of a type, and how one is read; none for types that are no real numbers.
pub(super) fn number(descr: &str) -> Option<(usize, Decode)> {
    let mut letters = descr.chars();
    let (order, kind) = (letters.next()?, letters.next()?);
    let size = letters.as_str().parse().ok()?;
    let kind = match kind {
        'f' => Kind::Float,
        'i' => Kind::Signed,
        'u' => Kind::Unsigned,
        'b' if size == 1 => Kind::Unsigned,
        _ => return None,
    };
    let big_endian = match order {
        '>' => true,
        '<' => false,
        // No order: a byte.
        '|' if size == 1 => false,
        _ => return None,
    };
    decoder(kind, size, big_endian).map(|decode| (size, decode))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(descr: &str, fortran: bool, shape: &[u64]) -> Header {
        Header {
            descr: descr.to_owned(),
            fortran,
            shape: shape.to_vec(),
        }
    }

    #[test]
    fn headers_are_read_as_numpy_writes_them() {
        for (text, expected) in [
            (
                "{'descr': '<f4', 'fortran_order': False, 'shape': (12, 29), }   \n",
                head("<f4", false, &[12, 29]),
            ),
            (
                "{\"shape\": (3L,), 'fortran_order':True , 'descr': '|b1'}",
                head("|b1", true, &[3]),
            ),
            (
                "{'descr': '<f8', 'fortran_order': False, 'shape': ()}",
                head("<f8", false, &[]),
            ),
        ] {
            assert_eq!(parse(text), Some(expected), "{text}");
        }
        for text in [
            "",
            "{",
            "{}",
            "{'descr': '<f4', 'fortran_order': False}",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,,)}",
            "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,)}",
            "{'\u{e9}': 1}",
            "\u{e9}",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_written_is_read_and_values_begin_at_64_bytes() {
        for shape in [vec![1_000_000, 29], vec![7], vec![0, 8]] {
            let bytes = written("<f4", &shape);
            assert_eq!(bytes.len() % 64, 0);
            let sides: Vec<u64> = shape.iter().map(|side| *side as u64).collect();
            assert_eq!(
                header(&mut bytes.as_slice()).unwrap(),
                head("<f4", false, &sides)
            );
        }
    }

    #[test]
    fn damaged_headers_are_errors() {
        let sound = written("<f4", &[3, 29]);
        for length in 0..sound.len() {
            assert!(header(&mut &sound[..length]).is_err(), "cut at {length}");
        }
        for (at, byte) in [(0, b'x'), (6, 9), (9, 0xff)] {
            let mut bytes = sound.clone();
            bytes[at] = byte;
            assert!(header(&mut bytes.as_slice()).is_err(), "byte {at}");
        }
        let mut long = sound;
        long[6] = 2;
        assert!(
            header(&mut long.as_slice())
                .unwrap_err()
                .contains("too long")
        );
    }

    #[test]
    fn numbers_of_all_types_are_read() {
        for (descr, bytes, expected) in [
            ("<f4", 1.5_f32.to_le_bytes().to_vec(), 1.5),
            (">f4", 1.5_f32.to_be_bytes().to_vec(), 1.5),
            ("<f8", (-2.5_f64).to_le_bytes().to_vec(), -2.5),
            (">f8", (-2.5_f64).to_be_bytes().to_vec(), -2.5),
            ("|b1", vec![1], 1.0),
            ("|i1", vec![0xff], -1.0),
            ("<i8", (-7_i64).to_le_bytes().to_vec(), -7.0),
            (">i4", (-7_i32).to_be_bytes().to_vec(), -7.0),
            (">u2", 700_u16.to_be_bytes().to_vec(), 700.0),
            ("<f2", vec![0x00, 0x3e], 1.5),
            (">f2", vec![0xc1, 0x00], -2.5),
        ] {
            let (size, value) = number(descr).unwrap();
            assert_eq!((size, value(&bytes)), (bytes.len(), expected), "{descr}");
        }
        for descr in [
            "<f16", "<c8", "|S4", "<U3", "O", "|O", "<M8[ns]", "|f4", "<b4", "", "<", "<f", "=f4",
        ] {
            assert!(number(descr).is_none(), "{descr}");
        }
    }
}
