//! What iceoryx2 says, to the `log` crate: its own way of printing panics where it cannot.

use iceoryx2::prelude::set_log_level_from_env_or;
use iceoryx2_log::{Log, LogLevel, set_logger};

struct Forward;

/// Has errors of iceoryx2 logged, or what IOX2_LOG_LEVEL asks for. They are warnings here: an error
/// that matters comes back from the call that it is of.
pub(crate) fn forward() {
    set_logger(&Forward);
    set_log_level_from_env_or(LogLevel::Error);
}

impl Log for Forward {
    fn log(
        &self,
        level: LogLevel,
        origin: std::fmt::Arguments<'_>,
        message: std::fmt::Arguments<'_>,
    ) {
        let level = match level {
            LogLevel::Trace => log::Level::Trace,
            LogLevel::Debug => log::Level::Debug,
            LogLevel::Info => log::Level::Info,
            LogLevel::Warn | LogLevel::Error | LogLevel::Fatal => log::Level::Warn,
        };
        log::log!(level, "{message} ({origin})");
    }
}
