//! Minari's HDF5 layout (Farama-Foundation/Minari, `minari/dataset/_storages/hdf5_storage.py`) with
//! the observations of Gymnasium-Robotics' AntMaze: a group for each episode, and observations as
//! a dict of `observation`, `achieved_goal` and `desired_goal`.
//!
//! An episode of T actions has T + 1 observations; its last row in memory has an action of zeros.
//! A row is `achieved_goal` followed by the first 27 values of `observation`; further values
//! (AntMaze from v5 on has contact forces, 105 in all) are left out.

mod read;
mod write;

pub(crate) use read::{from_reader, read_with};
pub use read::{read, read_bytes};
pub(crate) use write::stage;
pub use write::write;

/// The file that holds the episodes.
const MAIN: &str = "main_data.hdf5";
/// The file beside it that describes them.
const METADATA: &str = "metadata.json";
/// All that a folder holds, by its path in it.
pub(crate) const HOLDS: &[&str] = &["data/main_data.hdf5", "data/metadata.json"];
/// Values of `observation` that are taken: all of a row but the place.
const PROPRIOCEPTION: usize = crate::OBSERVATION - 2;
