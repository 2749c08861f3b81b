//! Arrays in chunks whose index is laid out for more columns than there are: fixed arrays and
//! implicit indices count chunks by the greatest shape that an array may have, where `hdf5-reader`
//! takes its present one.

use hdf5_reader::Dataset as Array;
use hdf5_reader::chunk_index::{ChunkEntry, collect_implicit_chunk_entries};
use hdf5_reader::error::{Error, Result};
use hdf5_reader::filters::apply_pipeline_with_limit;
use hdf5_reader::fixed_array::collect_fixed_array_chunk_entries_storage;
use hdf5_reader::group::Group;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::messages::layout::{ChunkIndexing, DataLayout};
use hdf5_reader::object_header::ObjectHeader;
use hdf5_reader::{Datatype, H5Type};

use super::filters;
use super::number::Number;

/// Such an array's chunks.
pub(crate) struct Wide {
    group: Group,
    chunks: Vec<ChunkEntry>,
    /// Sides of a chunk.
    sides: [usize; 2],
    filters: Vec<FilterDescription>,
    datatype: Datatype,
    /// Of values that were never written.
    fill: f32,
}

/// The chunks of an array of `group`, if it is such a one.
pub(super) fn wide(group: &Group, array: &Array) -> Result<Option<Wide>> {
    let (Some(chunk), Some(most)) = (array.chunks(), array.max_dims()) else {
        return Ok(None);
    };
    let (&[_, columns], &[rows, width], &[tall, across]) = (array.shape(), most, &chunk[..]) else {
        return Ok(None);
    };
    let across = u64::from(across.max(1));
    let unlimited = rows == u64::MAX || width == u64::MAX;
    if unlimited || width.div_ceil(across) == columns.div_ceil(across) {
        return Ok(None);
    }
    let (offset, length) = (group.offset_size(), group.length_size());
    let storage = group.storage();
    let header = ObjectHeader::parse_at_storage(storage, array.address(), offset, length)?;
    let mut layout = None;
    let (mut filters, mut fill) = (vec![], vec![]);
    for message in header.messages {
        match message {
            HdfMessage::DataLayout(found) => layout = Some(found.layout),
            HdfMessage::FilterPipeline(found) => filters = found.filters,
            HdfMessage::FillValue(found) => fill = found.value.unwrap_or_default(),
            _ => {}
        }
    }
    let Some(DataLayout::Chunked {
        address,
        chunk_indexing,
        ..
    }) = layout
    else {
        // An array of another file, whose header is not here.
        return Err(Error::UnsupportedChunkIndexType(0));
    };
    let size = Number::element_size(array.dtype());
    let end = storage.len();
    let chunks = match chunk_indexing {
        Some(ChunkIndexing::Implicit) => {
            collect_implicit_chunk_entries(address, most, &chunk, size, None, end)?
        }
        Some(ChunkIndexing::FixedArray { .. }) => collect_fixed_array_chunk_entries_storage(
            storage, address, offset, length, most, &chunk, None,
        )?,
        _ => return Ok(None),
    };
    Ok(Some(Wide {
        group: group.clone(),
        chunks,
        sides: [tall as usize, across as usize],
        filters,
        fill: Number::from_bytes(&fill, array.dtype()).map_or(0.0, |Number(value)| {
            if value.is_nan() { 0.0 } else { value }
        }),
        datatype: array.dtype().clone(),
    }))
}

impl Wide {
    /// The rows from `start` that `into` has room for, `width` values each.
    pub(super) fn read(&self, start: usize, width: usize, into: &mut [f32]) -> Result<()> {
        into.fill(self.fill);
        let end = start + into.len() / width.max(1);
        let [tall, across] = self.sides;
        let size = Number::element_size(&self.datatype);
        let bytes = tall
            .checked_mul(across)
            .and_then(|count| count.checked_mul(size))
            .ok_or_else(|| Error::InvalidData("a chunk is too large".into()))?;
        let registry = filters::registry();
        for chunk in &self.chunks {
            let [top, left] =
                [0, 1].map(|side| chunk.offsets.get(side).copied().unwrap_or(0) as usize);
            if top >= end || top.saturating_add(tall) <= start || left >= width {
                continue;
            }
            // Without filters no size is stored.
            let packed = match chunk.size {
                0 => bytes,
                size => usize::try_from(size)
                    .map_err(|_| Error::InvalidData("a chunk is too large".into()))?,
            };
            let packed = self.group.storage().read_range(chunk.address, packed)?;
            let mask = chunk.filter_mask;
            let values = apply_pipeline_with_limit(
                packed.as_ref(),
                &self.filters,
                mask,
                size,
                Some(&registry),
                Some(bytes),
            )?;
            if values.len() != bytes {
                return Err(Error::InvalidData(format!(
                    "a chunk holds {} bytes, not {bytes}",
                    values.len()
                )));
            }
            let columns = left..width.min(left + across);
            for row in top.max(start)..end.min(top + tall) {
                for column in columns.clone() {
                    let at = ((row - top) * across + column - left) * size;
                    let Number(value) = Number::from_bytes(&values[at..at + size], &self.datatype)?;
                    into[(row - start) * width + column] = value;
                }
            }
        }
        Ok(())
    }
}
