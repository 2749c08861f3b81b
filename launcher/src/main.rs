//! `formica`: launches a run and supervises its processes. The roles themselves are subcommands.
//!
//! Exit codes: see [`exit::EXIT_CODES`].

#[macro_use]
mod output;

mod check;
mod cli;
mod commands;
mod exit;
mod fault;
mod interrupts;
mod output_files;
mod record;
mod show;
mod supervise;

use std::process::ExitCode;

use clap::Parser;

use cli::Cli;

fn main() -> ExitCode {
    // On failure a write beyond the limit ends the process, as by default.
    let _ = interrupts::outlive_small_files();
    output::init_log();
    let code = match Cli::try_parse() {
        Ok(cli) => commands::run(cli.command).unwrap_or_else(|error| {
            log::error!("{}", fault::sentence(&error));
            ExitCode::from(match fault::is_input(&error) {
                true => exit::INPUT,
                false => exit::FAILED,
            })
        }),
        Err(error) => help(&error),
    };
    output::end(code)
}

/// Prints help, the version, or an error in the arguments.
fn help(error: &clap::Error) -> ExitCode {
    let printed = error.print();
    if error.use_stderr() {
        return ExitCode::from(exit::INPUT);
    }
    if let Err(error) = printed {
        output::record_failure(&error);
    }
    ExitCode::SUCCESS
}
