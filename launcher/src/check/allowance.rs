//! Limits of processes and threads, compared with the needs of a run.

use std::path::{Path, PathBuf};

use anyhow::Context;
use config::Config;
use rustix::process::{Resource, getrlimit, getuid};

use super::limits::limits;

/// Threads per process of a run: usually two or three.
const THREADS: u64 = 4;

/// Raises the limits of this process to the needs of a run.
///
/// # Errors
/// A limit is too low, with how to raise it, or channels cannot be created.
pub(crate) fn check(config: &Config) -> anyhow::Result<()> {
    wire::sockets_available()?;
    let plan = agents::plan(config).context("the config's algorithm is unknown")?;
    limits(config, &*plan).allow()?;
    let needed = THREADS * (config.topology.actors as u64 + 3);
    // The kernel does not apply this limit to root.
    let limit = getrlimit(Resource::Nproc)
        .current
        .filter(|_| !getuid().is_root());
    if let Some(limit) = limit {
        let had = tasks_of(getuid().as_raw());
        anyhow::ensure!(
            had + needed <= limit,
            "this user may have {limit} processes and threads and has {had}, and the run starts \
             about {needed}; raise the limit with `ulimit -u {}`, or end others",
            had + needed
        );
    }
    if let Some((limit, had, path)) = own_group() {
        anyhow::ensure!(
            had + needed <= limit,
            "this container or service may have {limit} processes and threads and has {had}, and the \
             run starts about {needed}; raise {}, docker by --pids-limit, systemd by TasksMax",
            path.display()
        );
    }
    Ok(())
}

/// Raises the limit on the size of files to the needs of a run's channels. Only before the run's folder is made:
/// collected data come first, which may need more.
///
/// # Errors
/// The limit is too low, with how to raise it.
pub(crate) fn segments(config: &Config) -> anyhow::Result<()> {
    let plan = agents::plan(config).context("the config's algorithm is unknown")?;
    Ok(limits(config, &*plan).allow_segments()?)
}

/// Visible processes and threads of a user.
fn tasks_of(user: u32) -> u64 {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let threads = |entry: std::fs::DirEntry| {
        let status = std::fs::read_to_string(entry.path().join("status")).ok()?;
        threads_of(&status, user)
    };
    processes.filter_map(threads).sum()
}

/// Threads of a process by its `status`; `None` if it belongs to another user.
fn threads_of(status: &str, user: u32) -> Option<u64> {
    let value = |key: &str| {
        let mut lines = status.lines();
        lines.find_map(|line| line.strip_prefix(key)?.split_whitespace().next())
    };
    let own = value("Uid:")?.parse() == Ok(user);
    own.then(|| value("Threads:")?.parse().ok()).flatten()
}

/// Limit and number of tasks in the control group of this process, and the file of the limit. Parent groups are
/// not visible from within.
fn own_group() -> Option<(u64, u64, PathBuf)> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let own = groups.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let folder = Path::new("/sys/fs/cgroup").join(own);
    let number = |name: &str| {
        let text = std::fs::read_to_string(folder.join(name)).ok()?;
        text.trim().parse().ok()
    };
    Some((
        number("pids.max")?,
        number("pids.current")?,
        folder.join("pids.max"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_threads_of_own_processes_are_counted() {
        let status = "Name:\tx\nUid:\t1000\t0\t0\t0\nThreads:\t7\n";
        assert_eq!(threads_of(status, 1000), Some(7));
        assert_eq!(threads_of(status, 0), None);
        assert_eq!(threads_of("", 0), None);
        assert!(tasks_of(getuid().as_raw()) >= 2, "this test's own");
    }
}
