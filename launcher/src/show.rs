//! What the user sees of a run: the live view in a terminal, lines elsewhere.

pub(crate) mod live;
pub(crate) mod progress;
pub(crate) mod scene;
