//! Runs at full load: memory, descriptors, shared memory and throughput stay constant.
//!
//! The short form is part of every change, the long one is behind `--ignored` (`just soak`). Its figures are
//! in docs/reliability.md.

#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests are tests too.

use std::time::{Duration, Instant};

use system_tests::{domain, ends_well, eventually, footprint, one_at_a_time, started};

/// Runs at full load. Memory, descriptors, shared memory and the rate of transitions must not change.
fn soak(seconds: u64) {
    let rollouts = format!("rollouts.seconds={}", seconds + 20);
    let (folder, launcher) = started(&["run.checkpoint_seconds=5", &rollouts]);
    let run = folder.path().join("runs/small");
    let transitions = || {
        let books = wire::Books::read(&wire::Reader::Learner.ledger(&run)).unwrap_or_default();
        books.counts.transitions
    };
    let under_way = || transitions() > 20_000;
    assert!(eventually(Duration::from_secs(60), under_way));
    let id = domain(&run);
    // At first buffers grow to their size.
    std::thread::sleep(Duration::from_secs(10));
    let parts = 6;
    let mut seen = vec![(Instant::now(), transitions(), footprint(&launcher, &id))];
    for _ in 0..parts {
        std::thread::sleep(Duration::from_millis(1000 * (seconds - 10) / parts));
        seen.push((Instant::now(), transitions(), footprint(&launcher, &id)));
    }
    let rate = |pair: &[(Instant, u64, [u64; 3])]| {
        let [(before, sent, _), (now, more, _)] = pair else {
            unreachable!("windows of two")
        };
        (more - sent) as f64 / (*now - *before).as_secs_f64()
    };
    let rates: Vec<f64> = seen.windows(2).map(rate).collect();
    let [first, last] = [seen[0].2, seen[seen.len() - 1].2];
    println!("transitions/s {rates:.0?}; memory, descriptors, shared memory {first:?} {last:?}");
    for (_, _, now) in &seen {
        println!(
            "{:.1} MiB, {} descriptors, {:.1} MiB shared",
            now[0] as f64 / 1048576.0,
            now[1],
            now[2] as f64 / 1048576.0
        );
    }
    ends_well(folder.path(), launcher, Duration::from_secs(120));
    // Curves and logs take a few bytes per second.
    assert!(
        last[0] < first[0] + first[0] / 50 + (4 << 20),
        "memory grows: {first:?} {last:?}"
    );
    assert!(
        last[1] <= first[1] + 2,
        "descriptors grow: {first:?} {last:?}"
    );
    assert_eq!(last[2], first[2], "shared memory grows");
    // Other work on the machine shows in windows of seconds, not in those of minutes.
    let least = if seconds > 600 { 0.95 } else { 0.7 };
    let half = rates.len() / 2;
    let mean = |rates: &[f64]| rates.iter().sum::<f64>() / rates.len() as f64;
    let (first, last) = (mean(&rates[..half]), mean(&rates[half..]));
    assert!(last > least * first, "it slows down: {rates:.0?}");
}

#[test]
fn a_minute_of_full_load_leaves_memory_and_throughput_as_they_are() {
    let _one = one_at_a_time();
    soak(45);
}

#[test]
#[ignore = "an hour: just soak"]
fn long_soak() {
    let _one = one_at_a_time();
    soak(3600);
}
