//! What is shown of an algorithm's training.

/// A value by its key or name.
pub type Lookup<'a, T> = &'a dyn Fn(&str) -> Option<T>;

/// How a metric is called where it is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    /// The metric, as `low/policy_loss`.
    pub metric: &'static str,
    /// Its label, as `low policy loss`.
    pub label: &'static str,
    /// Decimals to show.
    pub decimals: usize,
    /// The rate that its steps make, where these count the work of a stage.
    pub rate: Option<Rate>,
}

/// Work of a stage by time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    /// The metric of the rate, as `throughput/low_updates_per_s`.
    pub metric: &'static str,
    /// What is counted, as `updates`.
    pub unit: &'static str,
}

/// What a stage came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The stage, as `low`.
    pub name: &'static str,
    /// Its name in text, as `low level`.
    pub title: &'static str,
    /// What it took (s), where that is known.
    pub seconds: Option<f64>,
    /// What it came to, in a phrase; empty where nothing was measured.
    pub text: String,
    /// What it is worth, from 0 to 1, where that was measured.
    pub quality: Option<f64>,
}

/// The parts of a list that there are, with commas.
pub(crate) fn listed<const N: usize>(parts: [Option<String>; N]) -> String {
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}
