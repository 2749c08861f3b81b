//! A process of the same user that publishes garbage on every channel: what is refused is counted
//! and named, nobody crashes, and the run ends with its score.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::time::{Duration, Instant};

use simulator::{RowBuffer, RowLayout, RowValues, Values};
use system_tests::{domain, eventually, finished, one_at_a_time, shared_memory, started};
use wire::{
    Bus, Directive, DirectivePublisher, EpisodeResult, GraphPublisher, Metric, Reporter, Role,
    RunDomain, Status, TrajectoryHeader, TrajectorySender, WeightsPublisher,
};

/// Five rows, each with a value that is not finite.
fn rows(layout: RowLayout, number: usize) -> RowBuffer {
    let mut rows = RowBuffer::new(layout, 5);
    let (mut observation, mut goal, mut reward) = ([0.0; 29], [0.0; 2], 0.0);
    match number % 3 {
        0 => reward = f32::NAN,
        1 => observation = [f32::INFINITY; 29],
        _ => goal = [f32::NEG_INFINITY; 2],
    }
    for _ in 0..5 {
        rows.push(RowValues {
            flags: u32::MAX,
            reward,
            log_prob: 0.0,
            observation: Values::F32(&observation),
            action: &[],
            goal: &goal,
        });
    }
    rows
}

/// Publishes an invalid directive and invalid reports.
fn publish_reports(directives: &DirectivePublisher, reporter: &Reporter) {
    let directive = Directive {
        phase: 77,
        episodes: u32::MAX,
        ..Directive::default()
    };
    directives.publish(&directive).unwrap();
    reporter.status(&Status {
        role: 99,
        id: u32::MAX,
        ..Status::default()
    });
    reporter.metric(&Metric::new(Role::Actor, u32::MAX, "", 0, f64::NAN));
    reporter.result(&EpisodeResult {
        episode: u32::MAX,
        success: 1000,
        nearest: f32::NAN,
        ..EpisodeResult::default()
    });
}

#[test]
fn garbage_on_every_channel_is_refused_at_the_door() {
    let _one = one_at_a_time();
    let (folder, launcher) = started(&["rollouts.seconds=10"]);
    let run = folder.path().join("runs/small");
    assert!(eventually(Duration::from_secs(60), || run
        .join("graph.bin")
        .is_file()));
    let bus = Bus::join(&RunDomain::open(&domain(&run)).unwrap(), "stranger").unwrap();
    let parts = bus.limits().parts.clone();
    let weights: Vec<_> = (0..parts.len())
        .map(|number| (number, WeightsPublisher::new(&bus, number).unwrap()))
        .collect();
    let graph = GraphPublisher::new(&bus).unwrap();
    let directives = DirectivePublisher::new(&bus).unwrap();
    let reporter = Reporter::new(&bus).unwrap();
    let claim = bus.claim_any(2).unwrap();
    let actor = claim.actor;
    let mut sender = TrajectorySender::connect(&bus, claim, Duration::from_secs(20), &|| false)
        .unwrap()
        .unwrap();
    let end = Instant::now() + Duration::from_secs(4);
    let mut sent = 0;
    while Instant::now() < end {
        for (number, publisher) in &weights {
            let limit = parts[*number].values;
            publisher
                .publish(u64::MAX, 7, &vec![f32::NAN; limit])
                .unwrap();
            publisher.publish(u64::MAX, 7, &[]).unwrap();
            assert!(publisher.publish(1, 7, &vec![0.0; limit + 1]).is_err());
        }
        graph.publish(u64::MAX, &[0xff; 100]).unwrap();
        graph.publish(0, b"FORMICAG").unwrap();
        publish_reports(&directives, &reporter);
        if sender.credit() {
            let header = TrajectoryHeader {
                episode: u64::MAX,
                first_step: u32::MAX,
                versions: [u64::MAX; wire::PARTS],
                ..TrajectoryHeader::default()
            };
            let rows = rows(RowLayout::new(&bus.limits().spaces), sent);
            sender.send(header, rows.rows(), &[u32::MAX; 9]).unwrap();
            sent += 1;
        }
        sender.wait(Duration::from_millis(20));
    }
    assert!(sender.drain(Duration::from_secs(5)).acknowledged);
    drop((weights, graph, directives, reporter, sender, bus));
    let (code, told) = finished(launcher, Duration::from_secs(120));
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("normalized score"), "{told}");
    assert!(told.contains("reports refused by the launcher: "), "{told}");
    let refused = format!("received by the learner (0 lost, {sent} refused)");
    assert!(told.contains(&refused), "{refused}\n{told}");
    assert!(!told.contains("restarts"), "{told}");
    let log = |name: &str| std::fs::read_to_string(run.join("logs").join(name)).unwrap();
    let named =
        format!("refused a message of 5 steps that says it is number 2, kind 1, of actor {actor}");
    assert!(
        log("learner-0.log").contains(&named),
        "{}",
        log("learner-0.log")
    );
    for told in [
        "weights-low: 0 values where",
        "graph: not a graph file",
        "directive: 1 parts",
    ] {
        assert!(
            log("actor-0.log").contains(told),
            "{told}: {}",
            log("actor-0.log")
        );
    }
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}
