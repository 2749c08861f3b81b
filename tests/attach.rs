//! Actors that join a run from another shell and leave it again.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::path::Path;
use std::process::{Child, Command};
use std::time::Duration;

use system_tests::{
    binary, domain, eventually, finished, formica, kill, one_at_a_time, piped, shared_memory,
    start, started, text,
};

fn attach(folder: &Path, run: &str) -> Child {
    piped(&mut formica(folder, &["actor", "--attach", run]))
}

/// Ids of actors that hold a claim in the run's domain.
fn names_in_domain(run: &Path) -> Vec<String> {
    let user = rustix::process::getuid().as_raw();
    let folder = format!("/tmp/formica-{user}/{}", domain(run));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect()
}

/// Transitions that each actor process sent, by the learner's ledger.
fn sources(run: &Path) -> Vec<wire::Source> {
    let ledger = wire::Reader::Learner.ledger(run);
    let books = wire::Books::read(&ledger).unwrap_or_default();
    books.sources().copied().collect()
}

#[test]
fn an_attached_actor_adds_transitions_and_leaves_without_a_trace() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["rollouts.seconds=14"]);
    let run = folder.path().join("runs/small");
    let graph = || run.join("graph.bin").is_file();
    assert!(eventually(Duration::from_secs(60), graph));
    let first = attach(folder.path(), "small");
    let second = attach(folder.path(), "runs/small");
    let sent = |actor: u32| {
        let of = |source: &wire::Source| source.actor == actor && source.transitions > 0;
        sources(&run).iter().any(of)
    };
    assert!(eventually(Duration::from_secs(10), || sent(2) && sent(3)));
    assert!(kill(first.id(), "-INT"));
    assert!(kill(second.id(), "-9"));
    let (code, told) = finished(first, Duration::from_secs(5));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("all acknowledged"), "{told}");
    let (code, _) = finished(second, Duration::from_secs(5));
    assert_eq!(code, None, "it was killed");
    // A third one takes the place of the first.
    let third = attach(folder.path(), "latest");
    let again = || {
        sources(&run)
            .iter()
            .filter(|source| source.actor >= 2)
            .count()
            == 3
    };
    assert!(eventually(Duration::from_secs(10), again));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    let (code, told) = finished(third, Duration::from_secs(5));
    assert_eq!(code, Some(0), "the run's end is its own: {told}");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
    assert_eq!(names_in_domain(&run), Vec::<String>::new());
}

#[test]
fn as_many_as_there_are_places_attach_and_one_more_is_told_so() {
    let _one = one_at_a_time();
    let sets = [
        "topology.max_actors=34",
        "topology.window=2",
        "rollouts.seconds=30",
    ];
    let (folder, launcher) = started(&sets);
    let run = folder.path().join("runs/small");
    assert!(eventually(Duration::from_secs(60), || run
        .join("graph.bin")
        .is_file()));
    let attached: Vec<Child> = (0..33).map(|_| attach(folder.path(), "small")).collect();
    let claimed = || {
        let names = names_in_domain(&run);
        names
            .iter()
            .filter(|name| name.starts_with("actor-"))
            .count()
            == 34
    };
    assert!(eventually(Duration::from_secs(60), claimed));
    let all = || {
        sources(&run)
            .iter()
            .filter(|source| source.actor >= 2)
            .count()
            == 32
    };
    assert!(
        eventually(Duration::from_secs(60), all),
        "{}",
        sources(&run).len()
    );
    for child in &attached {
        let _ = kill(child.id(), "-INT");
    }
    let told: Vec<_> = attached
        .into_iter()
        .map(|child| finished(child, Duration::from_secs(10)))
        .collect();
    let refused: Vec<_> = told.iter().filter(|(code, _)| *code == Some(1)).collect();
    assert_eq!(refused.len(), 1, "{told:?}");
    assert!(
        refused[0].1.contains("34 places for actors are taken"),
        "{told:?}"
    );
    let left = told.iter().filter(|(code, _)| *code == Some(0)).count();
    assert_eq!(left, 32, "{told:?}");
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("(0 lost, 0 refused)"), "{told}");
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn an_attached_actor_leaves_when_its_run_dies() {
    let _one = one_at_a_time();
    let (folder, mut launcher) = started(&["low.updates=1000000"]);
    let run = folder.path().join("runs/small");
    assert!(eventually(Duration::from_secs(60), || run
        .join("graph.bin")
        .is_file()));
    let attached = attach(folder.path(), "small");
    let there = || sources(&run).iter().any(|source| source.actor == 2);
    assert!(eventually(Duration::from_secs(10), there));
    launcher.kill().unwrap();
    launcher.wait().unwrap();
    let (code, told) = finished(attached, Duration::from_secs(6));
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("is no longer alive"), "{told}");
    let late = formica(folder.path(), &["actor", "--attach", "small"])
        .output()
        .unwrap();
    assert_eq!(late.status.code(), Some(1));
    assert!(text(&late).contains("is not alive"), "{}", text(&late));
    assert!(text(&late).contains("--resume"), "{}", text(&late));
    let doctor = formica(folder.path(), &["doctor"]).output().unwrap();
    assert!(doctor.status.success(), "{}", text(&doctor));
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn wrong_names_other_layouts_and_other_users_runs_are_refused() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["low.updates=1000000"]);
    let run = folder.path().join("runs/small");
    let refused = |command: &mut Command| {
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", text(&output));
        text(&output)
    };
    let told = refused(&mut formica(folder.path(), &["actor", "--attach", "smal"]));
    assert!(told.contains("there is no run 'smal'"), "{told}");
    let twice = refused(&mut formica(
        folder.path(),
        &["launch", "--resume", "small"],
    ));
    assert!(twice.contains("is alive"), "{twice}");
    let user = rustix::process::getuid();
    let limits = format!("/tmp/formica-{}/{}/limits", user.as_raw(), domain(&run));
    let ours = std::fs::read_to_string(&limits).unwrap();
    let theirs = ours.replace(&format!("layout={}", wire::LAYOUT), "layout=1");
    assert_ne!(ours, theirs);
    std::fs::write(&limits, theirs).unwrap();
    let told = refused(&mut formica(folder.path(), &["actor", "--attach", "small"]));
    assert!(told.contains("speaks channel layout 1"), "{told}");
    std::fs::write(&limits, ours).unwrap();
    // To be somebody else takes rights that not every machine gives.
    if user.is_root() {
        let program = folder.path().join("formica");
        std::fs::copy(binary(), &program).unwrap();
        let open = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(folder.path(), open).unwrap();
        let mut other = Command::new("setpriv");
        other
            .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
            .arg(&program)
            .args(["actor", "--attach", "small"])
            .current_dir(folder.path());
        let told = refused(&mut other);
        assert!(
            told.contains("belongs to the user with number 0, this is number 65534"),
            "{told}"
        );
        let shared = shared_memory(&run);
        assert_ne!(shared, Vec::<String>::new());
        for name in shared {
            use std::os::unix::fs::MetadataExt;
            let mode = std::fs::metadata(Path::new("/dev/shm").join(&name))
                .unwrap()
                .mode();
            assert_eq!(mode & 0o077, 0, "{name} may be opened by others: {mode:o}");
        }
    }
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(6));
    assert_eq!(code, Some(130), "{told}");
}

#[test]
fn two_runs_side_by_side_do_not_meet() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("small.toml"), system_tests::SMALL).unwrap();
    let collected = formica(folder.path(), &["collect", "small.toml"])
        .output()
        .unwrap();
    assert!(collected.status.success(), "{}", text(&collected));
    let first = start(folder.path(), &["run.seed=1"]);
    let second = start(folder.path(), &["run.seed=2"]);
    let mut runs = vec![
        folder.path().join("runs/small"),
        folder.path().join("runs/small-2"),
    ];
    // A third one of somebody else, where this test may be somebody else.
    let other = tempfile::tempdir().unwrap();
    let mut third = None;
    if rustix::process::getuid().is_root() {
        for name in ["small.toml", "data.hdf5"] {
            std::fs::copy(folder.path().join(name), other.path().join(name)).unwrap();
        }
        std::fs::copy(binary(), other.path().join("formica")).unwrap();
        let owned = Command::new("chown")
            .args(["-R", "65534:65534"])
            .arg(other.path())
            .status();
        assert!(owned.unwrap().success());
        let mut command = Command::new("setpriv");
        command
            .args([
                "--reuid=65534",
                "--regid=65534",
                "--clear-groups",
                "./formica",
            ])
            .args(["launch", "small.toml"])
            .current_dir(other.path());
        third = Some(piped(&mut command));
        runs.push(other.path().join("runs/small"));
    }
    for launcher in [Some(first), Some(second), third].into_iter().flatten() {
        let (code, told) = finished(launcher, Duration::from_secs(120));
        assert_eq!(code, Some(0), "{told}");
        assert!(
            told.contains("received by the learner (0 lost, 0 refused)"),
            "{told}"
        );
        assert!(
            told.contains("received by the graph-builder (0 lost, 0 refused)"),
            "{told}"
        );
        assert!(!told.contains("refused by the launcher"), "{told}");
    }
    let domains: std::collections::BTreeSet<_> = runs.iter().map(|run| domain(run)).collect();
    assert_eq!(domains.len(), runs.len());
    for run in &runs {
        assert_eq!(shared_memory(run), Vec::<String>::new());
    }
}
