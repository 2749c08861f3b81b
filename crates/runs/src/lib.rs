//! A run's folder under `runs/`: its layout, what is written to it and read back, and how runs and
//! traces are found by name.

pub mod file;
pub mod find;
pub mod folder;
pub mod inputs;
pub mod latest;
pub mod metrics;
pub mod read;
pub mod seeds;
pub mod times;
pub mod traces;
