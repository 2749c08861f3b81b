//! `formica doctor`: checks the machine, and clears what dead runs left.

use std::process::ExitCode;

use rustix::process::{Resource, getrlimit};
use wire::{Kept, Leftover, Liveness, Unseen};

use crate::output;

/// Shared memory for a run with a few actors (MiB).
const ENOUGH_SHARED: u64 = 256;
/// Space for sockets and names (bytes).
const ENOUGH_SOCKETS: u64 = 64 << 20;
/// Open files of a process in a run with 64 actors.
const ENOUGH_FILES: u64 = 1100;
/// Memory of a run with a million transitions (MiB).
const ENOUGH_MEMORY: u64 = 2048;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Also clear a run of which no lock is seen. Only when it is alive nowhere: not in another
    /// container, mount namespace or service
    #[arg(long, value_name = "ID")]
    clear: Vec<String>,
}

/// Lines of a report, and whether a run may fail to start.
#[derive(Default)]
struct Report {
    text: String,
    bad: bool,
}

impl Report {
    fn line(&mut self, what: &str, found: &str) {
        self.text += &format!("{what:<14}{found}\n");
    }

    /// Adds advice if something does not hold.
    fn check(&mut self, holds: bool, advice: &str) {
        if !holds {
            self.text += &format!("{:<14}-> {advice}\n", "");
            self.bad = true;
        }
    }
}

/// Checks the machine, clears what dead runs left, and prints advice. The exit code is 1 if a run may fail.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut report = Report::default();
    report.line(
        "formica",
        &format!(
            "{}, channel layout {}",
            env!("CARGO_PKG_VERSION"),
            wire::LAYOUT
        ),
    );
    machine(&mut report)?;
    for id in &args.clear {
        match wire::clear_unseen(id) {
            Ok(()) => report.line(&format!("run {id}"), "cleared"),
            Err(why) => {
                report.line(&format!("run {id}"), &format!("not cleared: {why}"));
                report.bad = true;
            }
        }
    }
    leftovers(&mut report);
    output::text(report.text);
    Ok(ExitCode::from(u8::from(report.bad)))
}

fn machine(report: &mut Report) -> anyhow::Result<()> {
    let cores = std::thread::available_parallelism()?.get();
    report.line("cores", &cores.to_string());
    report.check(
        cores >= 2,
        "learner and actors share one core: expect runs to take twice as long",
    );
    channels(report);
    let memory = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let available = memory
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))
        .and_then(|rest| rest.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok());
    if let Some(kib) = available {
        let free = kib >> 10;
        report.line("memory", &format!("{free} MiB available"));
        report.check(
            free >= ENOUGH_MEMORY,
            "little; a data set of a million transitions takes about 1 GiB of it",
        );
    }
    // A run raises the soft limit itself.
    let files = getrlimit(Resource::Nofile).maximum.unwrap_or(u64::MAX);
    let limit = match files {
        u64::MAX => "no limit".to_owned(),
        files => files.to_string(),
    };
    report.line("open files", &format!("{limit} a process"));
    report.check(
        files >= ENOUGH_FILES,
        "few; raise the hard limit: `ulimit -Hn 4096` as root, systemd by LimitNOFILE, docker by \
         --ulimit nofile=4096",
    );
    Ok(())
}

/// Checks shared memory, and the folder of sockets and names.
fn channels(report: &mut Report) {
    match wire::shared_memory_available() {
        Ok(free) => {
            let free = free >> 20;
            report.line(wire::SHARED_MEMORY, &format!("{free} MiB free"));
            report.check(
                free >= ENOUGH_SHARED,
                "little; in a container start it with --shm-size=1g, elsewhere `mount -o \
                 remount,size=1g /dev/shm`, or lower topology.window and topology.max_actors",
            );
            report.check(
                wire::shared_memory_is_in_memory(),
                "on a disk, so every message waits for it; `mount -t tmpfs -o size=1g tmpfs \
                 /dev/shm` puts it in memory",
            );
        }
        Err(error) => {
            report.line(wire::SHARED_MEMORY, "not usable");
            report.check(false, &error.to_string());
        }
    }
    match wire::sockets_available() {
        Ok(free) => {
            report.line(wire::SOCKETS, &format!("{} MiB free", free >> 20));
            report.check(
                free >= ENOUGH_SOCKETS,
                "little; sockets and names of a run's channels lie there",
            );
        }
        Err(error) => {
            report.line(wire::SOCKETS, "not usable");
            report.check(false, &error.to_string());
        }
    }
}

fn leftovers(report: &mut Report) {
    let found = wire::leftovers();
    for run in &found {
        let size = format!("{} files, {} MiB", run.files, run.bytes >> 20);
        report.line(
            &format!("run {}", run.id),
            &format!("{size}, {}", state(run)),
        );
    }
    if found.is_empty() {
        report.line("runs", "none, nothing left behind");
    }
}

/// Clears a dead run. Returns its state, with advice.
fn state(run: &Leftover) -> String {
    let id = &run.id;
    match &run.liveness {
        Liveness::Alive => "alive".to_owned(),
        Liveness::Dead => match wire::clear(id) {
            Ok(()) | Err(Kept::Nothing) => "dead: cleared".to_owned(),
            Err(why) => format!("dead, not cleared: {why}"),
        },
        Liveness::Unknown(Unseen::NoLock) => format!(
            "left alone: no lock of it is visible from here, so it may be alive in another container \
             or mount namespace; if it is not, `formica doctor --clear {id}` clears it"
        ),
        Liveness::Unknown(why @ Unseen::Foreign { .. }) => {
            format!("left alone: {why}, who alone can clear it")
        }
        Liveness::Unknown(why) => format!(
            "left alone: {why}, so it may be alive; `formica doctor` clears it once its lock can be \
             seen"
        ),
    }
}
