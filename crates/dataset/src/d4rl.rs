//! D4RL's HDF5 layout (Farama-Foundation/d4rl, `scripts/generation/generate_ant_maze_datasets.py`,
//! `d4rl/offline_env.py`): flat arrays, episodes ended by `timeouts`.

mod next;
mod read;
mod write;

pub(crate) use read::from_reader;
pub use read::{read, read_bytes};
pub use write::{Rows, stage_rows, write, write_rows};
pub(crate) use write::{bools, compress, failed, stage};

/// Width of `infos/qpos`.
pub const QPOS: usize = 15;
/// Width of `infos/qvel`.
pub const QVEL: usize = 14;
