//! Layers, losses' plumbing and Adam over faer; parameter files. Knows no reinforcement learning.
//!
//! Batches are sample-contiguous: `[batch, features]` row-major, which is `features x batch`
//! column-major for faer. All parameters of a network are one flat `Vec<f32>`, so that Adam,
//! slow targets, clipping, publishing and saving are single loops.

pub mod categorical;
pub mod file;
mod kernel;
mod mlp;
mod optimiser;

pub use mlp::{Activation, Mlp, Workspace};
pub use optimiser::{Adam, clip_global_norm, polyak};
