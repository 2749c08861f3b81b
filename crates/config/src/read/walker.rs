//! `[walker]`.

use std::path::Path;

use crate::read::data::file;
use crate::read::optional::optional_table;
use crate::reader::{Document, Table};
use crate::sections::WalkerTraining;

pub(super) fn walker(d: &mut Document<'_>, wanted: bool) -> WalkerTraining {
    optional_table(d, wanted, "walker", |t| {
        let walker = WalkerTraining {
            environments: t.count("environments", 32, [1, 1024]),
            segment: t.count("segment", 64, [2, 4096]),
            batch: t.count("batch", 16_384, [64, 10_000_000]),
            epochs: t.count("epochs", 5, [1, 100]),
            minibatch: t.count("minibatch", 2048, [16, 1_000_000]),
            learning_rate: t.number("learning_rate", 3e-4, [0.0, 1.0]),
            clip: t.number("clip", 0.2, [0.01, 1.0]),
            entropy: t.number("entropy", 0.0, [0.0, 10.0]),
            discount: t.number("discount", 0.97, [0.0, 0.9999]),
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]),
            hidden: t.layers("hidden", &[128, 128]),
            initial_log_std: t.number("initial_log_std", -0.5, [-2.5, 0.5]),
            target_kl: t.number("target_kl", 0.02, [0.0001, 10.0]),
            steps: t.count("steps", 10_000_000, [1, 10_000_000_000]),
            turn_every: t.number("turn_every", 60.0, [1.0, 100_000.0]),
            maze_share: t.number("maze_share", 0.5, [0.0, 1.0]),
            top_speed: t.number("top_speed", 2.0, [0.1, 10.0]),
            fall_cost: t.number("fall_cost", 3.0, [0.0, 1000.0]),
            tilt_cost: t.number("tilt_cost", 0.3, [0.0, 100.0]),
            start: file(t, "start").unwrap_or_default(),
            output: output(t, "output"),
        };
        if walker.minibatch > walker.batch {
            let message = format!(
                "{} is more than the batch of {}",
                walker.minibatch, walker.batch
            );
            t.fault("minibatch", message);
        }
        walker
    })
}

/// A file that can be written when the training is over.
fn output(t: &mut Table<'_, '_>, key: &'static str) -> String {
    let Some(given) = t.path(key) else {
        return String::new();
    };
    let path = Path::new(&given.path);
    let folder = path.parent().unwrap_or(path);
    if path.is_dir() {
        t.fault(key, format!("'{}' is a folder; name a file", given.shown()));
    } else if !folder.is_dir() {
        let folder = folder.display();
        t.missing(
            key,
            format!("no folder '{folder}' to write the walker in; make it first"),
        );
    }
    given.path
}
