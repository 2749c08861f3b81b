//! Minari's HDF5 layout (Farama-Foundation/Minari, `minari/dataset/_storages/hdf5_storage.py`) with
//! the observations of Gymnasium-Robotics' AntMaze: a group for each episode, and observations as
//! a dict of `observation`, `achieved_goal` and `desired_goal`.
//!
//! An episode of T actions has T + 1 observations; its last row in memory has an action of zeros.
//!
//! How `observation` becomes a row is known by the file's first episode:
//! - Where it begins with `achieved_goal` in every row, as in PointMaze, it is the row.
//! - An image of bytes is the row's image, and `achieved_goal` its place.
//! - Otherwise a row is `achieved_goal` followed by `observation`, as in AntMaze. The contact forces
//!   that Ant adds to it are left out (78 values from v5 on, 84 before;
//!   Farama-Foundation/Gymnasium, `gymnasium/envs/mujoco/ant_v5.py` and `ant_v4.py`).

mod episode;
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
/// The same where the folder is the inner one.
pub(crate) const HOLDS_ITSELF: &[&str] = &["main_data.hdf5", "metadata.json"];
/// Values of the ant's `observation` that are taken: all of a row but the place.
const PLACE_APART: usize = maze::OBSERVATION - 2;
/// Widths that it has with contact forces.
const WITH_FORCES: [usize; 2] = [PLACE_APART + 78, PLACE_APART + 84];
