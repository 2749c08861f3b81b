//! Processes are killed and stopped at any moment: the run ends by itself, with every transition
//! accounted for, and leaves nothing behind.
//!
//! Each test has a short form, which every change passes, and a long one behind `--ignored`
//! (`just chaos`), whose figures stand in docs/reliability.md.

#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests are tests too.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use system_tests::{
    children, domain, ends_well, eventually, finished, footprint, formica, is_alive, kill, of_role,
    one_at_a_time, piped, shared_memory, shared_memory_of, start, started,
};

/// However often they die.
const PATIENT: [&str; 9] = [
    "actor.restarts=100000",
    "actor.pause_seconds=0.02",
    "actor.longest_pause_seconds=0.05",
    "learner.restarts=100000",
    "learner.pause_seconds=0.02",
    "learner.longest_pause_seconds=0.05",
    "graph_builder.restarts=100000",
    "graph_builder.pause_seconds=0.02",
    "graph_builder.longest_pause_seconds=0.05",
];

fn patient<'s>(more: &[&'s str]) -> Vec<&'s str> {
    [PATIENT.as_slice(), more].concat()
}

fn score(told: &str) -> f64 {
    let (_, rest) = told.split_once("normalized score ").unwrap();
    rest.split(':').next().unwrap().parse().unwrap()
}

/// Kills processes of a role one after the other, each once its place is filled, and the run
/// goes on each time; `pause` is the longest time between them (ms).
fn kill_one_by_one(
    role: &str,
    kills: usize,
    pause: u64,
    sets: &[&str],
    rng: &mut Pcg64Mcg,
) -> String {
    let (folder, launcher) = started(&patient(sets));
    let places = of_role(&launcher, role).len();
    let mut longest = Duration::ZERO;
    for number in 0..kills {
        std::thread::sleep(Duration::from_millis(rng.random_range(0..pause)));
        let now = of_role(&launcher, role);
        let victim = now[rng.random_range(0..now.len())];
        assert!(kill(victim, "-9"));
        let died = Instant::now();
        let back = eventually(Duration::from_secs(5), || {
            let now = of_role(&launcher, role);
            now.len() == places && !now.contains(&victim)
        });
        assert!(back, "{role} is back within 5 s of kill {number}");
        longest = longest.max(died.elapsed());
    }
    let told = ends_well(folder.path(), launcher, LONG);
    assert!(told.contains(&format!("restarts: {kills}")), "{told}");
    println!("{kills} kills of {role}: back within {longest:.1?}\n{told}");
    told
}

#[test]
fn actors_are_killed() {
    let _one = one_at_a_time();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    kill_one_by_one("actor", 20, 600, &["rollouts.seconds=20"], &mut rng);
}

#[test]
fn the_learner_is_killed() {
    let _one = one_at_a_time();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    // A graph that is published once has to do for every learner.
    let sets = [
        "run.checkpoint_seconds=0.5",
        "rollouts.seconds=5",
        "graph.refresh_seconds=3600",
    ];
    kill_one_by_one("learner", 3, 3000, &sets, &mut rng);
}

#[test]
fn the_graph_builder_is_killed() {
    let _one = one_at_a_time();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    kill_one_by_one("graph-builder", 3, 3000, &["rollouts.seconds=5"], &mut rng);
}

/// Kills the launcher, or all processes at once, after a random time, and resumes the run, again
/// and again; nothing is left of any of them.
fn kill_and_resume(
    everything: bool,
    kills: usize,
    longest: u64,
    sets: &[&str],
    rng: &mut Pcg64Mcg,
) -> String {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("runs/small");
    let mut launcher = start(folder.path(), &patient(sets));
    let mut domains = vec![];
    for number in 0..kills {
        let hosted = || run.join("domain").is_file() && !domains.contains(&domain(&run));
        assert!(eventually(Duration::from_secs(60), hosted), "kill {number}");
        std::thread::sleep(Duration::from_millis(rng.random_range(0..longest)));
        let early = launcher.try_wait().unwrap();
        assert_eq!(early, None, "it came to its end before kill {number}");
        let family = children(&launcher);
        domains.push(domain(&run));
        launcher.kill().unwrap();
        if everything {
            for pid in &family {
                let _ = kill(*pid, "-9");
            }
        }
        launcher.wait().unwrap();
        let gone = || family.iter().all(|pid| !is_alive(*pid));
        assert!(
            eventually(Duration::from_secs(5), gone),
            "children are left after kill {number}"
        );
        launcher = piped(&mut formica(
            folder.path(),
            &["launch", "--resume", "small"],
        ));
    }
    let told = ends_well(folder.path(), launcher, LONG);
    for id in &domains {
        assert_eq!(shared_memory_of(id), Vec::<String>::new());
    }
    println!("{} kills, everything: {everything}\n{told}", domains.len());
    told
}

const RESUMED: [&str; 2] = ["run.checkpoint_seconds=0.5", "rollouts.seconds=12"];

#[test]
fn the_launcher_is_killed_and_the_run_resumed() {
    let _one = one_at_a_time();
    kill_and_resume(false, 3, 4000, &RESUMED, &mut Pcg64Mcg::seed_from_u64(4));
}

#[test]
fn everything_is_killed_at_once_and_the_run_resumed() {
    let _one = one_at_a_time();
    kill_and_resume(true, 3, 4000, &RESUMED, &mut Pcg64Mcg::seed_from_u64(5));
}

/// Kills any process while channels and processes are being made.
fn kill_at_the_start(kills: usize, rng: &mut Pcg64Mcg) {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("runs/small");
    let mut launcher = start(folder.path(), &patient(&["rollouts.seconds=1"]));
    let mut domains = vec![];
    for number in 0..kills {
        let hosted = || run.join("domain").is_file() && !domains.contains(&domain(&run));
        assert!(eventually(Duration::from_secs(60), hosted), "kill {number}");
        std::thread::sleep(Duration::from_millis(rng.random_range(0..500)));
        let mut family = children(&launcher);
        family.push(launcher.id());
        let _ = kill(family[rng.random_range(0..family.len())], "-9");
        domains.push(domain(&run));
        // The launcher ends the rest in order, unless it is the one that died.
        let _ = kill(launcher.id(), "-INT");
        let over = eventually(Duration::from_secs(6), || {
            launcher.try_wait().unwrap().is_some()
        });
        assert!(over, "it ends within 6 s of kill {number}");
        let gone = || family.iter().all(|pid| !is_alive(*pid));
        assert!(
            eventually(Duration::from_secs(5), gone),
            "children are left after kill {number}"
        );
        launcher = piped(&mut formica(
            folder.path(),
            &["launch", "--resume", "small"],
        ));
    }
    ends_well(folder.path(), launcher, LONG);
    for id in &domains {
        assert_eq!(shared_memory_of(id), Vec::<String>::new());
    }
}

#[test]
fn processes_are_killed_while_they_start() {
    let _one = one_at_a_time();
    kill_at_the_start(20, &mut Pcg64Mcg::seed_from_u64(6));
}

/// A process that is stopped, as by a debugger, is silent: it is killed and its place filled.
fn stop_one(role: &str) {
    let hung = [
        "actor.hung_seconds=2",
        "learner.hung_seconds=2",
        "graph_builder.hung_seconds=2",
        "rollouts.seconds=6",
    ];
    let (folder, launcher) = started(&patient(&hung));
    // All have said that they are at work: only then is silence a fault so soon.
    let run = folder.path().join("runs/small");
    let at_work = || {
        let metrics = std::fs::read_to_string(run.join("metrics.csv")).unwrap_or_default();
        let told = ["learner,0,encoder/", "graph-builder,0,graph/nodes"];
        let books = wire::Books::read(&wire::Reader::Learner.ledger(&run)).unwrap_or_default();
        told.iter().all(|name| metrics.contains(name))
            && books
                .sources()
                .filter(|source| source.transitions > 0)
                .count()
                == 2
    };
    assert!(eventually(Duration::from_secs(60), at_work));
    let victim = of_role(&launcher, role)[0];
    assert!(kill(victim, "-STOP"));
    let replaced = eventually(Duration::from_secs(10), || {
        let now = of_role(&launcher, role);
        !now.is_empty() && !now.contains(&victim)
    });
    if !replaced {
        assert!(kill(launcher.id(), "-INT"));
        let (_, told) = finished(launcher, Duration::from_secs(10));
        unreachable!("{role} is replaced:\n{told}");
    }
    let told = ends_well(folder.path(), launcher, Duration::from_secs(120));
    assert!(told.contains("was killed: it was silent for 2 s"), "{told}");
}

#[test]
fn a_process_that_hangs_is_replaced() {
    let _one = one_at_a_time();
    ["actor", "learner", "graph-builder"]
        .into_iter()
        .for_each(stop_one);
}

#[test]
fn a_learner_that_stands_still_stops_the_actors_and_nothing_is_lost() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["rollouts.seconds=12", "topology.window=4"]);
    let run = folder.path().join("runs/small");
    let received = || {
        let ledger = wire::Reader::GraphBuilder.ledger(&run);
        let books = wire::Books::read(&ledger).unwrap_or_default();
        books.counts.transitions
    };
    assert!(eventually(Duration::from_secs(60), || received() > 5000));
    let learner = of_role(&launcher, "learner")[0];
    let memory = || footprint(&launcher, &domain(&run))[0];
    let before = (received(), memory());
    assert!(kill(learner, "-STOP"));
    std::thread::sleep(Duration::from_secs(2));
    let stopped = received();
    // Two actors with windows of four trajectories, and what was under way.
    let most = 2 * 129 * (4 + 1);
    assert!(stopped - before.0 <= most, "{} more", stopped - before.0);
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(received(), stopped, "actors wait");
    assert!(memory() < before.1 + (2 << 20), "memory grows");
    assert!(kill(learner, "-CONT"));
    assert!(eventually(Duration::from_secs(5), || received() > stopped + 1000));
    let told = ends_well(folder.path(), launcher, Duration::from_secs(120));
    assert!(!told.contains("restarts"), "{told}");
}

#[test]
fn a_launcher_that_stood_still_kills_nobody_for_it() {
    let _one = one_at_a_time();
    let hung = [
        "actor.hung_seconds=2",
        "learner.hung_seconds=2",
        "graph_builder.hung_seconds=2",
    ];
    let (folder, launcher) = started(&hung);
    assert!(kill(launcher.id(), "-STOP"));
    std::thread::sleep(Duration::from_secs(5));
    assert!(kill(launcher.id(), "-CONT"));
    let told = ends_well(folder.path(), launcher, Duration::from_secs(120));
    assert!(!told.contains("restarts"), "{told}");
}

#[test]
fn a_role_that_keeps_failing_ends_the_run_with_its_last_words() {
    let _one = one_at_a_time();
    let sets = [
        "learner.restarts=2",
        "learner.pause_seconds=0.1",
        "low.updates=1000000",
    ];
    let (folder, launcher) = started(&sets);
    let mut last = 0;
    for _ in 0..3 {
        let other = || of_role(&launcher, "learner").iter().any(|pid| *pid != last);
        assert!(eventually(Duration::from_secs(10), other));
        last = of_role(&launcher, "learner")[0];
        assert!(kill(last, "-9"));
    }
    let (code, told) = finished(launcher, Duration::from_secs(6));
    assert_eq!(code, Some(1), "{told}");
    let why = "learner-0 ended with signal: 9 (SIGKILL), after 2 restarts within 60 s";
    assert!(told.contains(why), "{told}");
    assert_eq!(
        shared_memory(&folder.path().join("runs/small")),
        Vec::<String>::new()
    );
}

#[test]
fn a_second_interrupt_ends_at_once() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["low.updates=1000000"]);
    let family = children(&launcher);
    // Nobody hears the first.
    family.iter().for_each(|pid| assert!(kill(*pid, "-STOP")));
    assert!(kill(launcher.id(), "-INT"));
    std::thread::sleep(Duration::from_millis(300));
    assert!(kill(launcher.id(), "-INT"));
    let (code, told) = finished(launcher, Duration::from_secs(1));
    assert_eq!(code, Some(130), "{told}");
    assert!(family.iter().all(|pid| !is_alive(*pid)));
    assert_eq!(
        shared_memory(&folder.path().join("runs/small")),
        Vec::<String>::new()
    );
}

/// A run that learns something, so that its score says whether chaos cost it.
const LEARNING: [&str; 5] = [
    "low.updates=3000",
    "low.hidden=[64, 64]",
    "collect.transitions=60000",
    "evaluation.episodes=100",
    "evaluation.max_steps=700",
];

fn learning<'s>(more: &[&'s str]) -> Vec<&'s str> {
    [LEARNING.as_slice(), more].concat()
}

/// Scores of three runs that nobody disturbs.
fn undisturbed() -> &'static [f64] {
    static SCORES: OnceLock<Vec<f64>> = OnceLock::new();
    SCORES.get_or_init(|| {
        let run = |seed: usize| {
            let folder = tempfile::tempdir().unwrap();
            let seed = format!("run.seed={seed}");
            let launcher = start(folder.path(), &learning(&[&seed, "rollouts.seconds=20"]));
            score(&ends_well(folder.path(), launcher, LONG))
        };
        (0..3).map(run).collect()
    })
}

const LONG: Duration = Duration::from_secs(1200);

/// Within the undisturbed ones' spread and three standard errors of a share of 100 episodes.
fn scores_as_ever(told: &str) {
    let least = undisturbed().iter().copied().fold(100.0, f64::min);
    println!("score {}, undisturbed {:?}", score(told), undisturbed());
    assert!(score(told) >= least - 5.0, "{told}");
}

#[test]
#[ignore = "about 12 minutes: just chaos"]
fn long_kills_of_actors() {
    let _one = one_at_a_time();
    let sets = learning(&["rollouts.seconds=600"]);
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    scores_as_ever(&kill_one_by_one("actor", 1000, 250, &sets, &mut rng));
}

#[test]
#[ignore = "about 5 minutes: just chaos"]
fn long_kills_of_the_learner() {
    let _one = one_at_a_time();
    let sets = learning(&["rollouts.seconds=220", "run.checkpoint_seconds=0.5"]);
    let mut rng = Pcg64Mcg::seed_from_u64(12);
    scores_as_ever(&kill_one_by_one("learner", 100, 2000, &sets, &mut rng));
}

#[test]
#[ignore = "about 5 minutes: just chaos"]
fn long_kills_of_the_graph_builder() {
    let _one = one_at_a_time();
    let sets = learning(&["rollouts.seconds=220"]);
    let mut rng = Pcg64Mcg::seed_from_u64(13);
    scores_as_ever(&kill_one_by_one(
        "graph-builder",
        100,
        2000,
        &sets,
        &mut rng,
    ));
}

#[test]
#[ignore = "about 8 minutes: just chaos"]
fn long_kills_of_the_launcher() {
    let _one = one_at_a_time();
    let sets = learning(&["rollouts.seconds=220", "run.checkpoint_seconds=0.5"]);
    let mut rng = Pcg64Mcg::seed_from_u64(14);
    scores_as_ever(&kill_and_resume(false, 100, 3000, &sets, &mut rng));
}

#[test]
#[ignore = "about 15 minutes: just chaos"]
fn long_kills_of_everything() {
    let _one = one_at_a_time();
    let sets = learning(&["rollouts.seconds=440", "run.checkpoint_seconds=0.5"]);
    let mut rng = Pcg64Mcg::seed_from_u64(15);
    scores_as_ever(&kill_and_resume(true, 200, 3000, &sets, &mut rng));
}

#[test]
#[ignore = "about half an hour: just chaos"]
fn long_kills_while_processes_start() {
    let _one = one_at_a_time();
    kill_at_the_start(500, &mut Pcg64Mcg::seed_from_u64(8));
}
