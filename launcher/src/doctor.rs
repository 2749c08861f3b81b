//! What this machine offers, what dead runs left on it, and what to do about either.

use std::process::ExitCode;

use rustix::process::{Resource, getrlimit};

/// Shared memory that a run of a few actors can come to need (MiB).
const ENOUGH_SHARED: u64 = 256;
/// Open files that a process of a run with 64 actors can come to need.
const ENOUGH_FILES: u64 = 1024;
/// Memory of a run with a million transitions (MiB).
const ENOUGH_MEMORY: u64 = 2048;

/// Lines of a report, and whether anything in it keeps a run from starting.
#[derive(Default)]
struct Report {
    text: String,
    bad: bool,
}

impl Report {
    fn line(&mut self, what: &str, found: &str) {
        self.text += &format!("{what:<14}{found}\n");
    }

    /// What is to be done where something does not hold.
    fn check(&mut self, holds: bool, advice: &str) {
        if !holds {
            self.text += &format!("{:<14}-> {advice}\n", "");
            self.bad = true;
        }
    }
}

/// Looks at the machine, clears what dead runs left, and says what to do. The exit code is 1
/// when a run may not start or not last.
pub(crate) fn doctor() -> anyhow::Result<ExitCode> {
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
    runs(&mut report);
    crate::output::text(report.text);
    Ok(ExitCode::from(u8::from(report.bad)))
}

fn machine(report: &mut Report) -> anyhow::Result<()> {
    let cores = std::thread::available_parallelism()?.get();
    report.line("cores", &cores.to_string());
    report.check(
        cores >= 2,
        "learner and actors share one core: expect runs to take twice as long",
    );
    let free = wire::shared_memory_available()? >> 20;
    report.line("/dev/shm", &format!("{free} MiB free"));
    report.check(
        free >= ENOUGH_SHARED,
        "little; in a container start it with --shm-size=1g, elsewhere `mount -o \
         remount,size=1g /dev/shm`, or lower topology.window and topology.max_actors",
    );
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
    // No limit is as good as any.
    let files = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let told = match files {
        u64::MAX => "no limit".to_owned(),
        files => files.to_string(),
    };
    report.line("open files", &format!("{told} a process"));
    report.check(
        files >= ENOUGH_FILES,
        "few; `ulimit -n 4096` in the shell that launches",
    );
    let folder = std::env::temp_dir();
    let space = rustix::fs::statvfs(&folder)?;
    let free = (space.f_bavail * space.f_frsize) >> 20;
    report.line(&folder.display().to_string(), &format!("{free} MiB free"));
    report.check(
        free >= 64,
        "sockets and names of a run's channels lie there",
    );
    Ok(())
}

fn runs(report: &mut Report) {
    let found = wire::leftovers();
    for run in &found {
        let what = format!("{} files, {} MiB", run.files, run.bytes >> 20);
        let state = if run.alive {
            "alive"
        } else if wire::clear(run) {
            "dead: cleared"
        } else {
            "alive again"
        };
        report.line(&format!("run {}", run.id), &format!("{what}, {state}"));
    }
    if found.is_empty() {
        report.line("runs", "none, nothing left behind");
    }
}
