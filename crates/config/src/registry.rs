//! What the run file's reader knows of algorithms and simulators: their names, and who reads their
//! tables.

use crate::reader::Document;
use crate::settings::Settings;

/// The algorithms and simulators that a run file may name.
pub trait Registry: Sync {
    /// Names of the algorithms, the default first.
    fn algorithms(&self) -> Vec<&'static str>;

    /// Names of the simulators, the default first.
    fn simulators(&self) -> Vec<&'static str>;

    /// Whether an algorithm learns from a data set, and is scored in an evaluation. Others learn
    /// from rollouts alone.
    fn is_offline(&self, algorithm: &str) -> bool;

    /// Reads the tables of an algorithm.
    fn read(&self, algorithm: &str, document: &mut Document<'_>) -> Settings;
}
