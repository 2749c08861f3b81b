//! HDF5's number types.

use hdf5_reader::error::{ByteOrder, Error, Result};
use hdf5_reader::{Dataset as Array, Datatype, H5Type};

use crate::number::{Decode, Kind, decoder};

/// A value of any number type; bools, which h5py stores as enums, are 0 and 1.
#[derive(Clone, Copy)]
pub(crate) struct Number(pub(super) f32);

impl H5Type for Number {
    fn hdf5_type() -> Datatype {
        Datatype::FloatingPoint {
            size: 4,
            byte_order: ByteOrder::LittleEndian,
        }
    }

    fn from_bytes(bytes: &[u8], datatype: &Datatype) -> Result<Self> {
        let (_, decode) = of(datatype)?;
        Ok(Self(decode(bytes)))
    }

    fn element_size(datatype: &Datatype) -> usize {
        of(datatype).map_or(0, |(size, _)| size)
    }

    fn decode_vec(raw: &[u8], datatype: &Datatype, count: usize) -> Option<Result<Vec<Self>>> {
        Some(of(datatype).and_then(|(size, decode)| {
            let bytes = count.checked_mul(size).and_then(|end| raw.get(..end));
            let bytes = bytes.ok_or_else(|| Error::InvalidData("is cut off".to_owned()))?;
            let values = bytes.chunks_exact(size).map(|bytes| Self(decode(bytes)));
            Ok(values.collect())
        }))
    }
}

/// Bytes of a value, and how one is read.
fn of(datatype: &Datatype) -> Result<(usize, Decode)> {
    let (kind, size, order) = match datatype {
        Datatype::FloatingPoint { size, byte_order } => (Kind::Float, *size, *byte_order),
        Datatype::FixedPoint {
            size,
            signed,
            byte_order,
        } => {
            let kind = if *signed {
                Kind::Signed
            } else {
                Kind::Unsigned
            };
            (kind, *size, *byte_order)
        }
        Datatype::Bitfield { size, byte_order } => (Kind::Unsigned, *size, *byte_order),
        Datatype::Enum { base, .. } if !matches!(**base, Datatype::Enum { .. }) => {
            return of(base);
        }
        _ => return Err(unreadable(datatype)),
    };
    let size = usize::from(size);
    decoder(kind, size, order == ByteOrder::BigEndian)
        .map(|decode| (size, decode))
        .ok_or_else(|| unreadable(datatype))
}

/// That a type holds no numbers that are read.
fn unreadable(datatype: &Datatype) -> Error {
    let told = match datatype {
        Datatype::FloatingPoint { size, .. } => {
            format!("holds floats of {size} bytes, not of 2, 4 or 8")
        }
        Datatype::FixedPoint { size, .. } | Datatype::Bitfield { size, .. } => {
            format!("holds integers of {size} bytes, not of 1, 2, 4 or 8")
        }
        Datatype::String { .. } => "holds text, not numbers".to_owned(),
        Datatype::VarLen { .. } => "holds lists or text, not numbers".to_owned(),
        Datatype::Compound { .. } => "holds records of several fields, not numbers".to_owned(),
        Datatype::Array { .. } => "holds arrays within its values, not numbers".to_owned(),
        Datatype::Reference { .. } => "holds references, not numbers".to_owned(),
        Datatype::Opaque { .. } => "holds bytes of an unknown type, not numbers".to_owned(),
        Datatype::Enum { .. } => "holds an enumeration of no numbers".to_owned(),
    };
    Error::UnsupportedEncoding(told)
}

/// Whether an array's values are what [`Number`] reads: a type of numbers, and its bits where
/// two's complement and IEEE 754 have them.
///
/// # Errors
/// What the type is instead.
pub(super) fn check(array: &Array) -> Result<()> {
    of(array.dtype())?;
    let floats = match array.dtype() {
        Datatype::FloatingPoint { .. } => true,
        Datatype::FixedPoint { .. } | Datatype::Bitfield { .. } => false,
        // An enumeration's values are compared with 0 alone.
        _ => return Ok(()),
    };
    // Class and byte order, 4 bytes; size, 4; then what HDF5's format calls the properties.
    let raw = array.raw_datatype()?;
    let short = |at: usize| {
        raw.get(at..at + 2)
            .map(|b| u16::from_le_bytes([b[0], b[1]]))
    };
    let size = raw.get(4).copied().unwrap_or(0);
    let whole = short(8) == Some(0) && short(10) == Some(8 * u16::from(size));
    // Where exponent and mantissa lie, how long they are, and the exponent's bias.
    let ieee: &[u8] = match size {
        2 => &[10, 5, 0, 10, 15, 0, 0, 0],
        4 => &[23, 8, 0, 23, 127, 0, 0, 0],
        _ => &[52, 11, 0, 52, 255, 3, 0, 0],
    };
    // VAX's order has both bits set.
    let vax = raw.get(1).is_some_and(|bits| bits & 0x41 == 0x41);
    if !whole || (floats && (vax || raw.get(12..20) != Some(ieee))) {
        let kind = if floats { "floats" } else { "integers" };
        return Err(Error::UnsupportedEncoding(format!(
            "holds {kind} of an unusual layout, such as bfloat16; write it as float32 with h5py"
        )));
    }
    Ok(())
}
