//! One episode, from its trace.

pub mod inspect;
mod layout;
mod notes;
pub mod overview;
pub mod replay;
mod subgoals;
mod summary;
mod svg_map;
mod text_map;

pub(crate) use layout::layout_of;
pub use summary::EpisodeSummary;
pub(crate) use svg_map::svg;
