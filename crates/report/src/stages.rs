//! What each stage of a run achieved and how long it took, so that a low score can be traced to its
//! cause.

mod choices;
mod describe;
mod quality;

use std::fmt::Write;

use config::Config;
use runs::metrics::Newest;
use runs::times::Times;

pub use choices::Choices;
pub use describe::{Stage, stages};
pub use quality::{json, weakest};

/// A line for each stage.
pub fn table(config: &Config, newest: &Newest, times: &Times) -> String {
    let mut text = String::new();
    for stage in stages(&Choices::of(config), newest, times) {
        let seconds = match stage.seconds {
            Some(seconds) => format!("{seconds:.0} s"),
            None => "-".to_owned(),
        };
        let _ = writeln!(text, "{:<9}{seconds:>8}  {}", stage.name, stage.text);
    }
    text.trim_end().to_owned()
}
