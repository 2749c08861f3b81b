//! Latest values: weights, graph, directive. A late joiner gets them at once; a value that was
//! overtaken is never seen.

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::WireError;
use crate::bus::{Bus, Ipc, Topic, Waker};
use crate::records::{Directive, Module, SnapshotHeader};

struct Outlet<T: std::fmt::Debug + ZeroCopySend + Copy + 'static> {
    publisher: Publisher<Ipc, [T], SnapshotHeader>,
    wake: Vec<Notifier<Ipc>>,
    service: &'static str,
    limit: usize,
}

impl<T: std::fmt::Debug + ZeroCopySend + Copy + 'static> Outlet<T> {
    fn new(
        bus: &Bus,
        topic: &Topic<T, SnapshotHeader>,
        service: &'static str,
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
            service,
            limit,
        })
    }

    fn publish(&self, header: SnapshotHeader, values: &[T]) -> Result<(), WireError> {
        if values.len() > self.limit {
            let (got, limit) = (values.len(), self.limit);
            return Err(WireError::TooLong {
                what: self.service,
                got,
                limit,
            });
        }
        let failed = |reason: String| WireError::Service {
            service: self.service.to_owned(),
            action: "publish",
            reason,
        };
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

fn newest<T: std::fmt::Debug + ZeroCopySend>(
    subscriber: &Subscriber<Ipc, [T], SnapshotHeader>,
) -> Option<Sample<Ipc, [T], SnapshotHeader>> {
    let mut newest = None;
    while let Ok(Some(sample)) = subscriber.receive() {
        newest = Some(sample);
    }
    newest
}

/// Publishes a module's weights.
pub struct WeightsPublisher(Outlet<f32>);

impl WeightsPublisher {
    /// For a module.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus, module: Module) -> Result<Self, WireError> {
        let limit = bus.limits().weights[module as usize];
        let topic = bus.weights(module)?;
        let wake = [Waker::Readers, Waker::Actors];
        Outlet::new(bus, &topic, module.service(), limit, &wake).map(Self)
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

/// Receives a module's weights.
pub struct WeightsSubscriber(Subscriber<Ipc, [f32], SnapshotHeader>);

impl WeightsSubscriber {
    /// For a module.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus, module: Module) -> Result<Self, WireError> {
        let topic = bus.weights(module)?;
        bus.port(module.service(), "get a subscriber", || {
            topic.subscriber_builder().create()
        })
        .map(Self)
    }

    /// The newest weights, if there are newer ones than at the last call. Weights with values
    /// that are not finite are passed over.
    #[must_use]
    pub fn latest(&self) -> Option<Weights> {
        let sample = newest(&self.0)?;
        let SnapshotHeader {
            version,
            shape_hash,
        } = *sample.user_header();
        let values = sample.payload().to_vec();
        let finite = values.iter().all(|value| value.is_finite());
        finite.then_some(Weights {
            version,
            shape_hash,
            values,
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
pub struct GraphSubscriber(Subscriber<Ipc, [u8], SnapshotHeader>);

impl GraphSubscriber {
    /// For the run's graph.
    ///
    /// # Errors
    /// A port that cannot be made.
    pub fn new(bus: &Bus) -> Result<Self, WireError> {
        let topic = bus.graph()?;
        bus.port("graph", "get a subscriber", || {
            topic.subscriber_builder().create()
        })
        .map(Self)
    }

    /// Version and bytes of the newest graph, if there is a newer one than at the last call.
    #[must_use]
    pub fn latest(&self) -> Option<(u64, Vec<u8>)> {
        newest(&self.0).map(|sample| (sample.user_header().version, sample.payload().to_vec()))
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
        })
    }

    /// The newest directive; the default one before the launcher has spoken.
    pub fn latest(&mut self) -> Directive {
        if let Some(sample) = newest(&self.subscriber)
            && let Some(directive) = sample.payload().first()
        {
            self.last = *directive;
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::tests::limits;
    use crate::domain::RunDomain;

    #[test]
    fn a_late_joiner_gets_the_newest_weights_and_only_once() {
        let domain = RunDomain::create().unwrap();
        let host = Bus::host(&domain, &limits()).unwrap();
        let publisher = WeightsPublisher::new(&host, Module::Encoder).unwrap();
        publisher.publish(1, 7, &[1.0; 100]).unwrap();
        publisher.publish(2, 7, &[2.0; 100]).unwrap();
        let bus = Bus::join(&RunDomain::open(domain.id()).unwrap(), "late").unwrap();
        let subscriber = WeightsSubscriber::new(&bus, Module::Encoder).unwrap();
        publisher.keep_alive();
        let weights = subscriber.latest().unwrap();
        assert_eq!((weights.version, weights.shape_hash), (2, 7));
        assert_eq!(weights.values, vec![2.0; 100]);
        assert_eq!(subscriber.latest(), None);
        assert!(publisher.publish(3, 7, &[0.0; 101]).is_err());
        publisher.publish(3, 7, &[f32::NAN; 3]).unwrap();
        assert_eq!(subscriber.latest(), None);
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
        drop((publisher, subscriber, host));
        domain.remove();
    }
}
