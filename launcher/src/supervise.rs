//! A run and its processes.

mod children;
pub(crate) mod collect;
mod delivery_audit;
mod ending;
mod host;
pub(crate) mod launch;
mod phases;
mod progress_file;
mod reports;
mod resume;
pub(crate) mod role;
mod run;
mod run_loop;
pub(crate) mod salvage;
