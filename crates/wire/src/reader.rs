//! The readers that every trajectory goes to.

/// Who must receive every trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// The learner.
    Learner = 0,
    /// The graph-builder.
    GraphBuilder = 1,
}

impl Reader {
    /// Both readers.
    pub const ALL: [Self; 2] = [Self::Learner, Self::GraphBuilder];

    /// Where a reader in a run's folder notes what it had from every actor.
    #[must_use]
    pub fn ledger(self, folder: &std::path::Path) -> std::path::PathBuf {
        folder.join(format!("{}.ledger", self.name()))
    }

    /// The reader's name, which is its role's.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Learner => "learner",
            Self::GraphBuilder => "graph-builder",
        }
    }
}
