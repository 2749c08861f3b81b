//! Tables that only one kind of run has.

use crate::reader::Document;
use crate::table::Table;

/// Reads a table, or its defaults if it belongs to the other kind of run.
pub(super) fn optional_table<T>(
    d: &mut Document<'_>,
    wanted: bool,
    name: &'static str,
    read: impl FnOnce(&mut Table<'_, '_>) -> T,
) -> T {
    if wanted {
        d.table(name, read)
    } else {
        Document::new("", &[], &[], &[]).table(name, read)
    }
}
