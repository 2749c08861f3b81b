//! Both ends of the trajectories together.

use std::time::{Duration, Instant};

use simulator::{Dtype, RowBuffer, RowLayout, RowValues, Space, Values};

use crate::domain::RunDomain;
use crate::ledger::Ledger;
use crate::limits::tests::limits;
use crate::records::Kind;
use crate::{
    Bus, Claim, LAYOUT, Reader, TrajectoryHeader, TrajectoryReceiver, TrajectorySender, WireError,
};

fn connected(bus: &Bus, claim: Claim, deadline: Duration) -> TrajectorySender {
    let sender = TrajectorySender::connect(bus, claim, deadline, &|| false);
    sender.unwrap().unwrap()
}

#[test]
fn an_actor_that_is_stopped_waits_for_no_answer() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let start = Instant::now();
    let stopped = || start.elapsed() > Duration::from_millis(50);
    let claim = host.claim(0).unwrap();
    let sender = TrajectorySender::connect(&host, claim, Duration::from_secs(60), &stopped);
    assert!(sender.unwrap().is_none());
    assert!(start.elapsed() < Duration::from_secs(5));
    drop(host);
    domain.remove();
}

/// So many rows with this reward.
fn steps(number: usize, reward: f32) -> RowBuffer {
    let mut rows = RowBuffer::new(RowLayout::new(&limits().spaces), number);
    for _ in 0..number {
        rows.push(RowValues {
            flags: 0,
            reward,
            log_prob: 0.0,
            observation: Values::F32(&[0.5; 4]),
            action: &[],
            goal: &[],
        });
    }
    rows
}

fn forgetful(bus: &Bus) -> TrajectoryReceiver {
    let opened = (Ledger::none(), crate::Books::default());
    TrajectoryReceiver::join(bus, Reader::Learner, opened).unwrap()
}

#[test]
fn readers_that_are_replaced_take_each_trajectory_once() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let each = 60_u32;
    let mut seen = vec![];
    std::thread::scope(|scope| {
        let id = domain.id().to_owned();
        scope.spawn(move || {
            let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
            let deadline = Duration::from_secs(20);
            let claim = bus.claim(0).unwrap();
            assert!(matches!(bus.claim(0), Err(WireError::Taken(0))));
            let mut sender = connected(&bus, claim, deadline);
            for i in 0..each {
                assert!(sender.wait_credit(deadline));
                let header = TrajectoryHeader::default();
                sender
                    .send(header, steps(2, i as f32).rows(), &[i])
                    .unwrap();
            }
            let drained = sender.drain(deadline);
            assert!(drained.acknowledged, "{drained:?}");
        });
        let start = Instant::now();
        let mut left = false;
        // Each reader takes seven messages and ends without a word; of the last ones the actor
        // never hears that they were taken.
        while !left {
            let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "learner").unwrap();
            let mut receiver =
                TrajectoryReceiver::new(&bus, Reader::Learner, folder.path()).unwrap();
            let mut taken = 0;
            while taken < 7 && !left {
                assert!(start.elapsed() < Duration::from_secs(60), "{seen:?}");
                taken += receiver.receive(3, |_, trajectory| {
                    seen.push((trajectory.rows.row(0).reward(), trajectory.choices[0]));
                });
                if taken < 7 {
                    receiver.acknowledge();
                } else {
                    receiver.note();
                }
                left = receiver.sources().any(|source| source.left);
                receiver.wait(Duration::from_millis(5));
            }
            if left {
                receiver.acknowledge();
            }
        }
    });
    let expected: Vec<(f32, u32)> = (0..each).map(|i| (i as f32, i)).collect();
    assert_eq!(seen, expected);
    let books = crate::Books::read(&Reader::Learner.ledger(folder.path())).unwrap();
    assert_eq!(books.counts.transitions, u64::from(2 * each));
    drop(host);
    domain.remove();
}

#[test]
fn a_stranger_that_says_it_is_an_actor_is_refused() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let mut receiver = forgetful(&host);
    let topic = host.trajectories().unwrap();
    let publisher = topic
        .publisher_builder()
        .initial_max_slice_len(4000)
        .create()
        .unwrap();
    let sound = TrajectoryHeader {
        layout: LAYOUT,
        incarnation: 5,
        ..TrajectoryHeader::default()
    };
    let mut send = |header: TrajectoryHeader, number: usize| {
        let sent = steps(number, f32::NAN);
        let words = sent.rows().words();
        let mut sample = publisher.loan_slice_uninit(words.len()).unwrap();
        *sample.user_header_mut() = TrajectoryHeader {
            rows: number as u32,
            ..header
        };
        sample.write_from_slice(words).send().unwrap();
        let before = receiver.counts().refused;
        receiver.receive(10, |_, _| unreachable!("it was taken"));
        receiver.counts().refused - before
    };
    assert_eq!(send(sound, 0), 1, "nobody has claimed the id");
    assert_eq!(send(TrajectoryHeader { layout: 1, ..sound }, 0), 1);
    assert_eq!(send(TrajectoryHeader { kind: 9, ..sound }, 0), 1);
    let actor = u32::MAX;
    assert_eq!(send(TrajectoryHeader { actor, ..sound }, 0), 1);
    let _claim = host.claim(0).unwrap();
    assert_eq!(send(sound, 0), 1, "the claim is another process's");
    let own = TrajectoryHeader {
        incarnation: crate::incarnation(),
        ..sound
    };
    assert_eq!(send(own, 0), 0);
    let data = TrajectoryHeader {
        kind: Kind::Data as u32,
        sequence: 1,
        ..own
    };
    assert_eq!(send(data, 3), 1, "not finite");
    assert_eq!(send(data, 200), 1, "too long");
    let mut sample = publisher.loan_slice_uninit(20).unwrap();
    *sample.user_header_mut() = TrajectoryHeader {
        rows: u32::MAX,
        ..data
    };
    sample.write_from_fn(|_| 0).send().unwrap();
    receiver.receive(10, |_, _| unreachable!("it was taken"));
    assert_eq!(receiver.counts().refused, 8, "fewer words than rows");
    drop((publisher, receiver, host));
    domain.remove();
}

#[test]
fn a_slow_reader_loses_nothing_from_three_actors() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let (actors, each) = (3_u32, 100_u32);
    let mut sums = [0.0_f64; 3];
    std::thread::scope(|scope| {
        for actor in 0..actors {
            let domain = RunDomain::open(domain.id()).unwrap();
            scope.spawn(move || {
                let bus = Bus::join(&domain, &format!("actor-{actor}")).unwrap();
                let deadline = Duration::from_secs(10);
                let mut sender = connected(&bus, bus.claim(actor).unwrap(), deadline);
                for i in 0..each {
                    assert!(sender.wait_credit(deadline));
                    let header = TrajectoryHeader::default();
                    sender
                        .send(header, steps(10, i as f32).rows(), &[])
                        .unwrap();
                }
                let drained = sender.drain(deadline);
                assert!(drained.acknowledged, "{drained:?}");
                assert_eq!(drained.transitions, 1000);
            });
        }
        let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "learner").unwrap();
        let mut receiver = forgetful(&bus);
        let start = Instant::now();
        while receiver.sources().filter(|s| s.left).count() < 3 {
            assert!(
                start.elapsed() < Duration::from_secs(20),
                "{:?}",
                receiver.counts()
            );
            receiver.receive(2, |header, trajectory| {
                let rewards = trajectory.rows.iter().map(|row| f64::from(row.reward()));
                sums[header.actor as usize] += rewards.sum::<f64>();
            });
            receiver.acknowledge();
            receiver.wait(Duration::from_millis(1));
        }
        let counts = receiver.counts();
        assert_eq!(
            (counts.trajectories, counts.transitions),
            (300, 3000),
            "{counts:?}"
        );
        assert_eq!((counts.early, counts.repeated, counts.refused), (0, 0, 0));
    });
    assert_eq!(sums, [10.0 * 99.0 * 50.0; 3]);
    drop(host);
    domain.remove();
}

#[test]
fn without_acknowledgements_an_actor_stops_at_its_window() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let mut receiver = forgetful(&host);
    let (ready, wait) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        let id = domain.id().to_owned();
        scope.spawn(move || {
            let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
            let claim = bus.claim(0).unwrap();
            let mut sender = connected(&bus, claim, Duration::from_secs(10));
            let mut sent = 0;
            while sent < 100 && sender.wait_credit(Duration::from_millis(300)) {
                let header = TrajectoryHeader::default();
                let value = if sent == 1 { f32::NAN } else { 0.0 };
                sender.send(header, steps(1, value).rows(), &[]).unwrap();
                sent += 1;
            }
            let header = TrajectoryHeader::default();
            assert!(sender.send(header, steps(66, 0.0).rows(), &[]).is_err());
            assert!(sender.send(header, steps(1, 0.0).rows(), &[0; 9]).is_err());
            ready.send(sent).unwrap();
        });
        // Answers both hellos and then nothing.
        while receiver.sources().all(|source| source.next < 2) {
            receiver.receive(1, |_, _| {});
            receiver.acknowledge();
            receiver.wait(Duration::from_millis(10));
        }
        let sent = wait.recv_timeout(Duration::from_secs(10)).unwrap();
        assert_eq!(sent, limits().window);
    });
    receiver.receive(100, |_, _| {});
    let counts = receiver.counts();
    assert_eq!(
        (counts.trajectories, counts.refused, counts.early),
        (3, 1, 0)
    );
    drop(receiver);
    drop(host);
    domain.remove();
}

#[test]
fn nobody_at_home_is_an_error_with_a_name() {
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits()).unwrap();
    let error = TrajectorySender::connect(
        &host,
        host.claim(0).unwrap(),
        Duration::from_millis(150),
        &|| false,
    )
    .err()
    .unwrap();
    assert!(
        matches!(
            error,
            WireError::NoAnswer {
                reader: "learner",
                ..
            }
        ),
        "{error}"
    );
    drop(host);
    domain.remove();
}

/// Whether a slice lies in memory that is shared with other processes.
fn is_shared(bytes: &[u8]) -> bool {
    let address = bytes.as_ptr() as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines().any(|line| {
        let (range, _) = line.split_once(' ').unwrap();
        let (from, to) = range.split_once('-').unwrap();
        let [from, to] = [from, to].map(|text| usize::from_str_radix(text, 16).unwrap());
        (from..to).contains(&address) && line.contains("/dev/shm/")
    })
}

#[test]
fn images_are_read_in_place() {
    let image = Space {
        shape: vec![64, 64, 3],
        dtype: Dtype::U8,
    };
    let mut limits = limits();
    limits.spaces.observation = image;
    let pixels = |row: u32| (0_u32..).map(move |i| (i * 7 + row) as u8);
    let domain = RunDomain::create().unwrap();
    let host = Bus::host(&domain, &limits).unwrap();
    let mut receiver = forgetful(&host);
    let mut taken = 0;
    std::thread::scope(|scope| {
        let id = domain.id().to_owned();
        scope.spawn(move || {
            let bus = Bus::join(&RunDomain::open(&id).unwrap(), "actor-0").unwrap();
            let deadline = Duration::from_secs(20);
            let mut sender = connected(&bus, bus.claim(0).unwrap(), deadline);
            let layout = RowLayout::new(&bus.limits().spaces);
            let mut rows = RowBuffer::new(layout, 65);
            for row in 0..65 {
                let bytes: Vec<u8> = pixels(row).take(64 * 64 * 3).collect();
                rows.push(RowValues {
                    flags: 0,
                    reward: 1.0,
                    log_prob: 0.0,
                    observation: Values::U8(&bytes),
                    action: &[0.25; 2],
                    goal: &[1.0, 2.0],
                });
            }
            for _ in 0..3 {
                assert!(sender.wait_credit(deadline));
                let header = TrajectoryHeader::default();
                sender.send(header, rows.rows(), &[]).unwrap();
            }
            assert!(sender.drain(deadline).acknowledged);
        });
        let start = Instant::now();
        while !receiver.sources().any(|source| source.left) {
            assert!(start.elapsed() < Duration::from_secs(60));
            receiver.receive(3, |_, trajectory| {
                for (number, row) in (0_u32..).zip(trajectory.rows.iter()) {
                    let Values::U8(bytes) = row.observation() else {
                        panic!("the image came as floats");
                    };
                    assert!(bytes.len() == 64 * 64 * 3 && is_shared(bytes));
                    assert!(bytes.iter().copied().eq(pixels(number).take(bytes.len())));
                    assert_eq!((row.reward(), row.action()), (1.0, &[0.25; 2][..]));
                }
                assert_eq!(trajectory.rows.len(), 65);
                taken += 1;
            });
            receiver.acknowledge();
            receiver.wait(Duration::from_millis(1));
        }
    });
    assert_eq!((taken, receiver.counts().refused), (3, 0));
    drop((receiver, host));
    domain.remove();
}
