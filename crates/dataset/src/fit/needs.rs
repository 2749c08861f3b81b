//! What an algorithm and its run want of data.

use maze::Layout;
use simulator::Body;

/// What an algorithm needs of its data.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Needs {
    /// Steps that an episode must be longer than, by the config's keys.
    pub lags: Vec<(&'static str, usize)>,
    /// Rows in which the body must be under way.
    pub nodes: usize,
}

/// What a run wants of its data.
#[derive(Debug, Clone)]
pub struct Expect<'a> {
    /// The body of the simulator.
    pub body: &'static dyn Body,
    /// The maze's name, for messages.
    pub maze: &'a str,
    /// Its map.
    pub layout: &'a Layout,
    /// Steps that an episode must be longer than, by the config's keys.
    pub lags: &'a [(&'static str, usize)],
    /// Nodes of the graph.
    pub nodes: usize,
}
