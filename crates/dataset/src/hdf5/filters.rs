//! Compressions of HDF5 beyond those of its own library.

use hdf5_reader::FilterRegistry;
use hdf5_reader::error::{Error, Result};

/// h5py's own compression, by its number in the HDF Group's register.
const LZF: u16 = 32_000;

/// No byte of LZF stands for more: three encode at most 264.
const LZF_INFLATION: usize = 88;

/// Compressions that are not read, by their number in the HDF Group's register.
const OTHERS: [(u16, &str); 9] = [
    (307, "bzip2"),
    (32_001, "Blosc"),
    (32_004, "LZ4"),
    (32_008, "Bitshuffle"),
    (32_013, "ZFP"),
    (32_015, "Zstandard"),
    (32_017, "SZ"),
    (32_019, "FCIDECOMP"),
    (32_026, "Blosc2"),
];

/// All that are read: those of HDF5's library, and LZF.
pub(super) fn registry() -> FilterRegistry {
    let mut registry = FilterRegistry::new();
    registry.register(
        LZF,
        Box::new(|filter, bytes, _| {
            // The third of its parameters is the length of a chunk.
            let length = filter.client_data.get(2).map(|length| *length as usize);
            let length = length.ok_or_else(|| damaged("has no length"))?;
            lzf(bytes, length)
        }),
    );
    registry
}

/// What is said of a compression that is not read; `told` is `filter id N`.
pub(super) fn unsupported(told: &str) -> String {
    let number = told.rsplit(' ').next().and_then(|id| id.parse().ok());
    let name = OTHERS.iter().find(|(id, _)| Some(*id) == number);
    let name = name.map_or_else(
        || told.to_owned(),
        |(id, name)| format!("{name} (filter {id})"),
    );
    format!(
        "is compressed with {name}, which is not read; `h5repack -f GZIP=1 OLD NEW` writes one that is"
    )
}

fn damaged(reason: &str) -> Error {
    Error::DecompressionError(format!("LZF: {reason}"))
}

/// Expands LZF (liblzf's format): runs of bytes as they are, and copies of what came before.
fn lzf(bytes: &[u8], length: usize) -> Result<Vec<u8>> {
    if length > bytes.len().saturating_mul(LZF_INFLATION) {
        return Err(damaged("tells of more bytes than it can hold"));
    }
    let mut rest = bytes.iter().copied();
    let mut next = || {
        rest.next()
            .map(usize::from)
            .ok_or_else(|| damaged("is cut off"))
    };
    let mut expanded = Vec::with_capacity(length);
    while expanded.len() < length {
        let control = next()?;
        if control < 32 {
            for _ in 0..=control {
                expanded.push(next()? as u8);
            }
            continue;
        }
        let mut count = control >> 5;
        if count == 7 {
            count += next()?;
        }
        let back = ((control & 31) << 8 | next()?) + 1;
        let from = expanded.len().checked_sub(back);
        let from = from.ok_or_else(|| damaged("refers to bytes before its first"))?;
        // What is copied may overlap what it is copied to.
        for at in from..from + count + 2 {
            expanded.push(expanded[at]);
        }
    }
    if expanded.len() != length {
        return Err(damaged("holds more bytes than it tells of"));
    }
    Ok(expanded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_copies_are_expanded_and_damage_is_an_error() {
        // "abc", then 3 of what is 3 back, then 9 of the last byte.
        let bytes = [2, b'a', b'b', b'c', 1 << 5, 2, 7 << 5, 0, 0];
        assert_eq!(lzf(&bytes, 15).unwrap(), b"abcabcccccccccc");
        for cut in 0..bytes.len() {
            assert!(lzf(&bytes[..cut], 15).is_err(), "cut at {cut}");
        }
        assert!(lzf(&bytes, 14).is_err() && lzf(&bytes, 16).is_err());
        assert!(lzf(&[1 << 5, 0], 3).is_err());
        assert!(lzf(&bytes, usize::MAX).is_err());
        assert!(lzf(&[], 0).unwrap().is_empty());
    }

    #[test]
    fn what_is_not_read_is_named() {
        let told = unsupported("filter id 32001");
        assert!(
            told.contains("Blosc (filter 32001)") && told.contains("h5repack"),
            "{told}"
        );
        assert!(unsupported("filter id 7").contains("with filter id 7,"));
    }
}
