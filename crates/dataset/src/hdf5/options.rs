//! Options that a file is opened with.

use hdf5_reader::OpenOptions;

use super::filters;

/// A deflated byte expands to at most 1032 bytes (zlib's technical notes), so no valid file holds more bytes
/// than this per byte of its own.
pub(super) const INFLATION: u64 = 1032;

/// Options for a file of `length` bytes.
pub(super) fn options(length: u64) -> OpenOptions {
    let most = usize::try_from(length.saturating_mul(INFLATION)).unwrap_or(usize::MAX);
    OpenOptions::default()
        .with_filter_registry(filters::registry())
        // Each chunk is read once.
        .with_chunk_cache_bytes(0)
        .with_max_chunk_bytes(most.max(1 << 20))
}
