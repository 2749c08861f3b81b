//! `formica watch`: plays the newest traces of a run to Foxglove or Lichtblick.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use runs::traces;
use trace::Server;

use crate::exit;
use crate::interrupts::Interrupts;

/// Time between two searches for a trace.
const LOOK: Duration = Duration::from_millis(500);

#[derive(clap::Args)]
pub(crate) struct Args {
    /// A run by its name or folder, a folder of traces, or a trace
    run: PathBuf,
    /// Port on 127.0.0.1; 0 is any that is free
    #[arg(long, default_value_t = 8765)]
    port: u16,
    /// Times as fast as the simulated world
    #[arg(long, default_value_t = 1.0, value_parser = speed)]
    speed: f64,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|s| (0.01..=100.0).contains(s));
    speed.ok_or_else(|| "a speed is a number from 0.01 to 100".to_owned())
}

/// Plays until Ctrl-C.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let named = traces::find(&args.run)?;
    let interrupts = Interrupts::listen()?;
    let stopped = || interrupts.count() > 0;
    let server = Server::start(args.port).context("listening; give another --port")?;
    outln!(
        "open ws://127.0.0.1:{} in Foxglove or Lichtblick; Ctrl-C ends",
        server.port()
    );
    while !stopped() {
        match traces::newest(&named) {
            Some(path) => {
                outln!("{}", path.display());
                if let Err(error) = server.play(&path, args.speed, &stopped) {
                    log::warn!("{error}");
                    std::thread::sleep(LOOK);
                }
            }
            None => std::thread::sleep(LOOK),
        }
    }
    server.stop();
    Ok(ExitCode::from(exit::SIGNAL))
}
