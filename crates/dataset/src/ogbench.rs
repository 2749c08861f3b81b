//! OGBench's npz layout (seohongpark/ogbench, `data_gen_scripts/generate_locomaze.py`,
//! `ogbench/utils.py`): numpy arrays in a zip archive, flat, `terminals` marking each trajectory's
//! end, whose row has an action without effect. No rewards and no goals. The visual sets' observations
//! are images of bytes (64 x 64 x 3). Training and validation
//! data are two files of the same layout, `X.npz` and `X-val.npz`.

mod entry;
mod npy;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub(crate) use read::read_with;
pub use read::{read, read_bytes};
pub(crate) use write::stage;
pub use write::{validation_path, write};
