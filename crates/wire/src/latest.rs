//! Latest values: weights, graph, directive. A late joiner gets them at once; a value that was
//! overtaken is never seen.

use std::cell::RefCell;
use std::fmt::Display;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::WireError;
use crate::bus::{Bus, Ipc, Topic, Waker};
use crate::directive::Directive;
use crate::limits::Part;
use crate::records::SnapshotHeader;

struct Outlet<T: std::fmt::Debug + ZeroCopySend + Copy + 'static> {
    publisher: Publisher<Ipc, [T], SnapshotHeader>,
    wake: Vec<Notifier<Ipc>>,
    service: String,
    limit: usize,
}

impl<T: std::fmt::Debug + ZeroCopySend + Copy + 'static> Outlet<T> {
    fn new(
        bus: &Bus,
        topic: &Topic<T, SnapshotHeader>,
        service: &str,
        limit: usize,
        wake: &[Waker],
    ) -> Result<Self, WireError> {
        let publisher = bus.port(service, "get a publisher", || {
            topic
                .publisher_builder()
                .initial_max_slice_len(limit.max(1))
                .allocation_strategy(AllocationStrategy::Static)
                .create()
        })?;
        let wake = wake
            .iter()
            .map(|waker| bus.notifier(*waker))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            publisher,
            wake,
            service: service.to_owned(),
            limit,
        })
    }

    fn publish(&self, header: SnapshotHeader, values: &[T]) -> Result<(), WireError> {
        if values.len() > self.limit {
            let (got, limit) = (values.len(), self.limit);
            return Err(WireError::TooLong {
                what: "snapshot",
                got,
                limit,
            });
        }
        let failed = |reason: String| WireError::service(&self.service, "publish", reason, None);
        let mut sample = self
            .publisher
            .loan_slice_uninit(values.len())
            .map_err(|e| failed(format!("{e:?}")))?;
        *sample.user_header_mut() = header;
        sample
            .write_from_slice(values)
            .send()
            .map_err(|e| failed(format!("{e:?}")))?;
        self.wake.iter().for_each(|notifier| {
            let _ = notifier.notify();
        });
        Ok(())
    }

    /// The history lives in the publisher: it must look up for late joiners to get it.
    fn keep_alive(&self) {
        let _ = self.publisher.update_connections();
    }
}

/// The newest sample that is sound; what is not is counted, and named in the log at first.
fn newest<T: std::fmt::Debug + ZeroCopySend>(
    subscriber: &Subscriber<Ipc, [T], SnapshotHeader>,
    refused: &mut u64,
    sound: impl Fn(&[T]) -> Result<(), String>,
) -> Option<Sample<Ipc, [T], SnapshotHeader>> {
    let mut newest = None;
    while let Ok(Some(sample)) = subscriber.receive() {
        match sound(sample.payload()) {
            Ok(()) => newest = Some(sample),
            Err(what) => {
                *refused += 1;
                if *refused <= NAMED {
                    log::warn!("refused at the door: {what}");
                }
            }
        }
    }
    newest
}

/// Refusals that are named in the log.
const NAMED: u64 = 10;

/// A part of the run's algorithm by its number.
fn part(bus: &Bus, number: usize) -> Result<Part, WireError> {
    let part = bus.limits().parts.get(number);
    part.cloned().ok_or(WireError::NoPart(number))
}

/// Publishes the weights of one of the algorithm's networks.
pub struct WeightsPublisher(Outlet<f32>);

impl WeightsPublisher {
    /// For a network, by its place among the run's [parts](crate::Limits::parts).
    ///
    /// # Errors
    /// A network that the run does not have, a port that cannot be made.
    pub fn new(bus: &Bus, number: usize) -> Result<Self, WireError> {
        let part = part(bus, number)?;
        let topic = bus.weights(&part)?;
        let wake = [Waker::Readers, Waker::Actors];
        Outlet::new(bus, &topic, &part.service(), part.values, &wake).map(Self)
    }

    /// Publishes a version; `shape_hash` tells readers which network it is of.
    ///
    /// # Errors
    /// More values than the run's limit, or what iceoryx2 refuses.
    pub fn publish(&self, version: u64, shape_hash: u64, weights: &[f32]) -> Result<(), WireError> {
        self.0.publish(
            SnapshotHeader {
                version,
                shape_hash,
            },
            weights,
        )
    }

    /// To be called now and then, so that late joiners get the weights.
    pub fn keep_alive(&self) {
        self.0.keep_alive();
    }
}

/// Weights as received.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Their version.
    pub version: u64,
    /// Hash of their network's shape.
    pub shape_hash: u64,
    /// The values, all finite.
    pub values: Vec<f32>,
}

/// Receives the weights of one of the algorithm's networks.
pub struct WeightsSubscriber {
    subscriber: Subscriber<Ipc, [f32], SnapshotHeader>,
    part: Part,
    refused: u64,
}

impl WeightsSubscriber {
    /// For a network, by its place among the run's [parts](crate::Limits::parts).
    ///
    /// # Errors
    /// A network that the run does not have, a port that cannot be made.
    pub fn new(bus: &Bus, number: usize) -> Result<Self, WireError> {
        let part = part(bus, number)?;
        let topic = bus.weights(&part)?;
        let subscriber = bus.port(&part.service(), "get a subscriber", || {
            topic.subscriber_builder().create()
        })?;
        Ok(Self {
            subscriber,
            part,
            refused: 0,
        })
    }

    /// How many were refused at the door.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The newest weights, if there are newer ones than at the last call. Weights with values
    /// that are not finite, or not as many as the network has, are refused; of a network that
    /// grows with a graph, not more than it can come to have.
    pub fn latest(&mut self) -> Option<Weights> {
        let Part {
            values: most,
            grows,
            ..
        } = self.part;
        let name = &self.part.name;
        let sample = newest(&self.subscriber, &mut self.refused, |values: &[f32]| {
            let got = values.len();
            let fits = got == most || (grows && (1..most).contains(&got));
            if !fits {
                return Err(format!(
                    "weights-{name}: {got} values where {most} are expected"
                ));
            }
            match values.iter().position(|value| !value.is_finite()) {
                Some(at) => Err(format!("weights-{name}: value {at} of {got} is not finite")),
                None => Ok(()),
            }
        })?;
        let SnapshotHeader {
            version,
            shape_hash,
        } = *sample.user_header();
        Some(Weights {
            version,
            shape_hash,
            values: sample.payload().to_vec(),
        })
    }
}

/// Publishes the graph.
pub struct GraphPublisher(Outlet<u8>);

impl GraphPublisher {
    /// For the run's graph.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let topic = bus.graph()?;
        let wake = [Waker::Readers, Waker::Actors];
        Outlet::new(bus, &topic, "graph", bus.limits().graph_bytes, &wake).map(Self)
    }

    /// Publishes a version, as the graph file's bytes.
    ///
    /// # Errors
    /// More bytes than the run's limit, or what iceoryx2 refuses.
    pub fn publish(&self, version: u64, bytes: &[u8]) -> Result<(), WireError> {
        self.0.publish(
            SnapshotHeader {
                version,
                shape_hash: 0,
            },
            bytes,
        )
    }

    /// To be called now and then, so that late joiners get the graph.
    pub fn keep_alive(&self) {
        self.0.keep_alive();
    }
}

/// Receives the graph.
pub struct GraphSubscriber {
    subscriber: Subscriber<Ipc, [u8], SnapshotHeader>,
    refused: u64,
}

impl GraphSubscriber {
    /// For the run's graph.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let topic = bus.graph()?;
        let subscriber = bus.port("graph", "get a subscriber", || {
            topic.subscriber_builder().create()
        })?;
        Ok(Self {
            subscriber,
            refused: 0,
        })
    }

    /// How many were refused at the door.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// What `read` makes of the newest graph's bytes, if there is a newer one than at the last
    /// call. Bytes that it finds no graph in are refused.
    pub fn latest<G, E: Display>(&mut self, read: impl Fn(&[u8]) -> Result<G, E>) -> Option<G> {
        let found = RefCell::new(None);
        newest(&self.subscriber, &mut self.refused, |bytes: &[u8]| {
            let graph = read(bytes).map_err(|what| format!("graph: {what}"))?;
            *found.borrow_mut() = Some(graph);
            Ok(())
        });
        found.into_inner()
    }
}

/// The launcher's word.
pub struct DirectivePublisher(Outlet<Directive>);

impl DirectivePublisher {
    /// For the launcher.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let topic = bus.directive()?;
        Outlet::new(
            bus,
            &topic,
            "directive",
            1,
            &[Waker::Readers, Waker::Actors],
        )
        .map(Self)
    }

    /// Says it to all, also to those who join later.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn publish(&self, directive: &Directive) -> Result<(), WireError> {
        self.0
            .publish(SnapshotHeader::default(), std::slice::from_ref(directive))
    }

    /// To be called now and then, so that late joiners hear it.
    pub fn keep_alive(&self) {
        self.0.keep_alive();
    }
}

/// A role's ear for the launcher.
pub struct DirectiveSubscriber {
    subscriber: Subscriber<Ipc, [Directive], SnapshotHeader>,
    last: Directive,
    heard: bool,
    refused: u64,
}

impl DirectiveSubscriber {
    /// For a role.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let topic = bus.directive()?;
        let subscriber = bus.port("directive", "get a subscriber", || {
            topic.subscriber_builder().create()
        })?;
        Ok(Self {
            subscriber,
            last: Directive::default(),
            heard: false,
            refused: 0,
        })
    }

    /// How many were refused at the door.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The launcher's first word, however long `wait` waits for it; none once `wait` is false.
    pub fn first(&mut self, mut wait: impl FnMut() -> bool) -> Option<Directive> {
        loop {
            let directive = self.latest();
            if self.heard {
                return Some(directive);
            }
            if !wait() {
                return None;
            }
        }
    }

    /// The newest directive; the default one before the launcher has spoken.
    pub fn latest(&mut self) -> Directive {
        let sound = |parts: &[Directive]| match parts {
            [directive] if directive.is_sound() => Ok(()),
            parts => Err(format!(
                "directive: {} parts that no launcher says",
                parts.len()
            )),
        };
        if let Some(sample) = newest(&self.subscriber, &mut self.refused, sound)
            && let Some(directive) = sample.payload().first()
        {
            self.last = *directive;
            self.heard = true;
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::RunDomain;
    use crate::limits::tests::limits;

    #[test]
    fn a_late_joiner_gets_the_newest_weights_and_only_once() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let publisher = WeightsPublisher::new(&host, 0).unwrap();
        publisher.publish(1, 7, &[1.0; 100]).unwrap();
        publisher.publish(2, 7, &[2.0; 100]).unwrap();
        let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "late").unwrap();
        let mut subscriber = WeightsSubscriber::new(&bus, 0).unwrap();
        publisher.keep_alive();
        let weights = subscriber.latest().unwrap();
        assert_eq!((weights.version, weights.shape_hash), (2, 7));
        assert_eq!(weights.values, vec![2.0; 100]);
        assert_eq!(subscriber.latest(), None);
        assert!(publisher.publish(3, 7, &[0.0; 101]).is_err());
        publisher.publish(3, 7, &[f32::NAN; 100]).unwrap();
        assert_eq!(subscriber.latest(), None);
        publisher.publish(4, 7, &[0.0; 99]).unwrap();
        assert_eq!(subscriber.latest(), None);
        assert_eq!(subscriber.refused(), 2);
        assert!(matches!(
            WeightsSubscriber::new(&bus, 7),
            Err(WireError::NoPart(7))
        ));
        drop((publisher, subscriber, bus, host));
        domain.remove();
    }

    #[test]
    fn a_directive_stays_until_the_next_one() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let publisher = DirectivePublisher::new(&host).unwrap();
        let mut subscriber = DirectiveSubscriber::new(&host).unwrap();
        assert_eq!(subscriber.latest().phase(), crate::Phase::Train);
        let directive = Directive {
            phase: 1,
            episodes: 5,
            ..Directive::default()
        };
        publisher.publish(&directive).unwrap();
        assert_eq!(subscriber.latest(), directive);
        assert_eq!(subscriber.latest(), directive);
        let garbage = Directive {
            phase: 77,
            ..directive
        };
        publisher.publish(&garbage).unwrap();
        assert_eq!(subscriber.latest(), directive);
        assert_eq!(subscriber.refused(), 1);
        drop((publisher, subscriber, host));
        domain.remove();
    }
}
