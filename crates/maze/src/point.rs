//! A point mass: a disc that an action moves, after OGBench's `pointmaze` (seohongpark/ogbench,
//! `ogbench/locomaze/point.py`, `assets/point.xml`).
//!
//! As there, an action is added to the place: a full one is a step of 0.2 m in an axis. The disc
//! slides along walls without friction. An observation is x, y (m), and the velocity of the last step
//! vx, vy (m/s).

mod body;
mod simulator;

pub use body::PointBody;
pub use simulator::PointSimulator;
