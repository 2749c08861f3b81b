//! The settings that an algorithm has read from its own tables.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

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
