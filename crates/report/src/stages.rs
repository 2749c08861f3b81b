//! What each stage of a run achieved and how long it took, so that a low score can be traced to its
//! cause.

mod describe;
mod quality;

use std::collections::BTreeMap;
use std::fmt::Write;

use agents::Summary;
use config::Config;
use runs::metrics::Newest;
use runs::times::Times;

pub use describe::{Stage, stages};
pub use quality::{json, weakest};

/// Values of a config by `table.key`, in TOML.
pub type Settings = BTreeMap<String, String>;

/// What the algorithm of a config says of its stages. A run of an earlier version names none, and is of
/// the first one.
pub(crate) fn summary(settings: &Settings, newest: &Newest) -> Vec<Summary> {
    let name = settings.get("run.algorithm");
    let name = name.map(|name| name.trim_matches(['"', '\'']));
    let named = name.and_then(agents::find);
    let algorithm = match name {
        Some(_) => named,
        None => agents::ALGORITHMS.first().copied(),
    };
    let setting = |key: &str| settings.get(key).cloned();
    let metric = |name: &str| newest.get(name).copied();
    algorithm.map_or_else(Vec::new, |algorithm| algorithm.summary(&setting, &metric))
}

/// A line for each stage.
pub fn table(config: &Config, newest: &Newest, times: &Times) -> String {
    let mut text = String::new();
    for stage in stages(&config.values(), newest, times) {
        let seconds = match stage.seconds {
            Some(seconds) => format!("{seconds:.0} s"),
            None => "-".to_owned(),
        };
        let _ = writeln!(text, "{:<9}{seconds:>8}  {}", stage.name, stage.text);
    }
    text.trim_end().to_owned()
}
