//! The links of a group, as the file has them: also those that lead nowhere.

use hdf5_reader::btree_v1::collect_btree_v1_leaves_storage;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::error::{Error, Result};
use hdf5_reader::fractal_heap::{FractalHeap, FractalHeapDirectBlockCache};
use hdf5_reader::group::Group;
use hdf5_reader::io::Cursor;
use hdf5_reader::local_heap::LocalHeap;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::link::{self, LinkTarget};
use hdf5_reader::messages::link_info::LinkInfoMessage;
use hdf5_reader::messages::symbol_table_msg::SymbolTableMessage;
use hdf5_reader::object_header::ObjectHeader;
use hdf5_reader::symbol_table::SymbolTableNode;

/// Longest header of a group that is believed; h5py's own end at 64 KiB.
const LONGEST_HEADER: usize = 1 << 24;
/// What marks a soft link in a group of the old form.
const SOFT: u32 = 2;

/// A name in a group.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) target: Target,
}

/// What a name stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Target {
    /// An object of this file.
    Object,
    /// A path within this file.
    Soft(String),
    /// A path within another file.
    External { file: String, path: String },
}

/// All links of a group. Nothing that they lead to is looked at.
///
/// # Errors
/// Damage.
pub(super) fn links(group: &Group) -> Result<Vec<Link>> {
    let (offset, length) = (group.offset_size(), group.length_size());
    let header = ObjectHeader::parse_at_storage_with_limit(
        group.storage(),
        group.address(),
        offset,
        length,
        LONGEST_HEADER,
    )?;
    let mut found = vec![];
    for message in &header.messages {
        match message {
            HdfMessage::SymbolTable(table) => found.extend(old_form(group, table)?),
            HdfMessage::Link(link) => found.push(of(link.name.clone(), &link.target)),
            HdfMessage::LinkInfo(info)
                if !Cursor::is_undefined_offset(info.fractal_heap_address, offset) =>
            {
                found.extend(dense(group, info)?);
            }
            _ => {}
        }
    }
    Ok(found)
}

fn of(name: String, target: &LinkTarget) -> Link {
    let target = match target {
        LinkTarget::Hard { .. } => Target::Object,
        LinkTarget::Soft { path } => Target::Soft(path.clone()),
        LinkTarget::External { filename, path } => Target::External {
            file: filename.clone(),
            path: path.clone(),
        },
    };
    Link { name, target }
}

/// The links of a group of the old form: a tree of tables, names in a heap beside it.
fn old_form(group: &Group, table: &SymbolTableMessage) -> Result<Vec<Link>> {
    let (offset, length) = (group.offset_size(), group.length_size());
    let storage = group.storage();
    let heap = LocalHeap::parse_at_storage(storage, table.heap_address, offset, length)?;
    let text = |at: u64| heap.get_string_storage(at, storage);
    let leaves = collect_btree_v1_leaves_storage(
        storage,
        table.btree_address,
        offset,
        length,
        None,
        &[],
        None,
    )?;
    let mut found = vec![];
    for (_, address) in leaves {
        // Signature, version and count, then entries of two addresses, two numbers, 16 bytes.
        let head = storage.read_range(address, 8)?;
        let [.., low, high] = head.as_ref() else {
            return Err(Error::InvalidData("a table of links is cut off".into()));
        };
        let count = usize::from(u16::from_le_bytes([*low, *high]));
        let bytes = storage.read_range(address, 8 + count * (2 * usize::from(offset) + 24))?;
        let node = SymbolTableNode::parse(&mut Cursor::new(bytes.as_ref()), offset, length)?;
        for entry in &node.entries {
            let [a, b, c, d, ..] = entry.scratch;
            let target = if entry.cache_type == SOFT {
                Target::Soft(text(u64::from(u32::from_le_bytes([a, b, c, d])))?)
            } else {
                Target::Object
            };
            found.push(Link {
                name: text(entry.link_name_offset)?,
                target,
            });
        }
    }
    Ok(found)
}

/// The links of a group that has many: records of a tree lead to messages in a heap.
fn dense(group: &Group, info: &LinkInfoMessage) -> Result<Vec<Link>> {
    let (offset, length) = (group.offset_size(), group.length_size());
    let storage = group.storage();
    let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
    let tree =
        BTreeV2Header::parse_at_storage(storage, info.btree_name_index_address, offset, length)?;
    let records =
        collect_btree_v2_records_storage(storage, &tree, offset, length, None, &[], None)?;
    let mut blocks = FractalHeapDirectBlockCache::default();
    let mut found = vec![];
    for record in records {
        let BTreeV2Record::LinkNameHash { heap_id, .. } = record else {
            return Err(Error::InvalidData(
                "an index of links of another kind".into(),
            ));
        };
        let bytes = heap.get_object_storage_cached_with_registry(
            &heap_id,
            storage,
            offset,
            length,
            &mut blocks,
            None,
        )?;
        let message = link::parse(&mut Cursor::new(&bytes), offset, length, bytes.len())?;
        found.push(of(message.name, &message.target));
    }
    Ok(found)
}
