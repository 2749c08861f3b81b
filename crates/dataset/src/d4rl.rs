//! D4RL's HDF5 layout (Farama-Foundation/d4rl, `scripts/generation/generate_ant_maze_datasets.py`,
//! `d4rl/offline_env.py`): flat arrays, episodes ended by `timeouts`.
//!
//! D4RL has no images of mazes. Here they are `observations` of bytes with more than two sides, and
//! `infos/xy` has x and y of each row, before the action.

mod next;
mod read;
mod write;

pub(crate) use read::from_reader;
pub use read::{read, read_bytes};
pub use write::{Rows, stage_rows, write, write_rows};
pub(crate) use write::{bools, compress, failed, stage};

/// Where x and y of images are.
const XY: &str = "infos/xy";
