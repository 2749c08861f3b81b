//! What damage costs.

use std::fmt;

/// Bytes of a file that are no whole record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// The first.
    pub from: u64,
    /// The one after the last.
    pub to: u64,
    /// What is wrong there.
    pub reason: String,
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from, to, reason } = self;
        write!(f, "bytes {from} to {to} are lost: {reason}")
    }
}
