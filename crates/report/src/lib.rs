//! Reports on runs and traces: a page of HTML, learning curves, what each stage achieved, and single
//! episodes. Returns text, which the launcher prints or writes.

pub mod curves;
pub mod episode;
pub mod page;
pub mod seed_table;
pub mod stages;
