//! The run file: parsed, checked as a whole (all faults at once, each with its line), resolved.
//!
//! The tables that every run has are read here. An algorithm reads its own, by the [`Registry`] that
//! a [`Reader`] is made with.

mod fault;
mod key;
mod names;
mod paths;
mod read;
mod reader;
mod registry;
mod resume;
mod run_file;
mod sections;
mod settings;
mod syntax;
mod table;
mod text;
mod value;

pub use fault::{Fault, Faults};
pub use key::{Key, OnResume};
pub use paths::Paths;
pub use reader::Document;
pub use registry::Registry;
pub use resume::Change;
pub use run_file::Reader;
pub use sections::{
    Collect, Config, Dataset, Evaluation, Maze, Misfit, OnFault, Rollouts, Run, Supervision,
    Topology, Traces,
};
pub use settings::Settings;
pub use table::Table;

impl Config {
    /// The whole file with every default written out and every path absolute; reading it gives this
    /// config again, wherever it is read.
    #[must_use]
    pub fn resolved(&self) -> &str {
        &self.resolved
    }

    /// A hash of the resolved file (FNV-1a, 16 hexadecimal digits). Of files that it names the names
    /// count, not where they lie: the same run elsewhere has the same hash.
    #[must_use]
    pub fn hash(&self) -> String {
        let hash = self
            .portable
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        format!("{hash:016x}")
    }
}
