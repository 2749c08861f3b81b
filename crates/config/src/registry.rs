//! What the run file's reader knows of algorithms and simulators: their names, and who reads their
//! tables.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use crate::reader::Document;

/// An algorithm's settings, of a type that it alone knows.
#[derive(Clone)]
pub struct Settings(Arc<dyn Any + Send + Sync>);

impl Settings {
    /// Of a value.
    #[must_use]
    pub fn new(value: impl Any + Send + Sync) -> Self {
        Self(Arc::new(value))
    }

    /// The value, where it is of this type.
    #[must_use]
    pub fn get<T: Any + Send + Sync>(&self) -> Option<&T> {
        self.0.downcast_ref()
    }
}

impl fmt::Debug for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Settings")
    }
}

/// Settings come from the run file alone, whose resolved text is compared beside them.
impl PartialEq for Settings {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

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
