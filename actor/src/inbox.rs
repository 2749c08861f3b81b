//! The newest weights and graph, and the policies that they make.

use std::sync::Arc;

use agents::{GraphRule, Parts, Plan, Policy, Versions, Weights};
use wire::{Bus, GraphSubscriber, WeightsSubscriber};

const _: () = assert!(agents::PARTS == wire::PARTS && agents::GRAPH == wire::GRAPH);

/// What has come.
pub(crate) struct Inbox<'a> {
    plan: &'a dyn Plan,
    weights: Vec<WeightsSubscriber>,
    graph: Option<(GraphSubscriber, Arc<dyn GraphRule>)>,
    parts: Parts,
}

impl<'a> Inbox<'a> {
    pub(crate) fn new(plan: &'a dyn Plan, bus: &Bus) -> anyhow::Result<Self> {
        let networks = plan.networks().len();
        let weights = (0..networks).map(|number| WeightsSubscriber::new(bus, number));
        Ok(Self {
            plan,
            weights: weights.collect::<Result<_, _>>()?,
            graph: match plan.graph() {
                Some(rule) => Some((GraphSubscriber::new(bus)?, rule)),
                None => None,
            },
            parts: Parts::new(networks),
        })
    }

    /// Takes what is newer. Returns whether there was any.
    pub(crate) fn look(&mut self) -> bool {
        let mut newer = false;
        for (number, subscriber) in self.weights.iter_mut().enumerate() {
            if let Some(weights) = subscriber.latest() {
                let weights = Weights {
                    version: weights.version,
                    structure: weights.shape_hash,
                    values: weights.values.into(),
                };
                self.parts.set_weights(number, weights);
                newer = true;
            }
        }
        if let Some((subscriber, rule)) = &mut self.graph
            && let Some(graph) = subscriber.latest(|bytes| rule.read(bytes))
        {
            self.parts.set_graph(Arc::new(graph));
            newer = true;
        }
        newer
    }

    /// Messages that were refused.
    pub(crate) fn refused(&self) -> u64 {
        let graph = self.graph.as_ref().map_or(0, |(graph, _)| graph.refused());
        let weights = self.weights.iter().map(WeightsSubscriber::refused);
        graph + weights.sum::<u64>()
    }

    /// A policy of the newest parts that fit each other, or of exactly those of `wanted`, and their
    /// versions; none until all are there.
    pub(crate) fn policy(&self, wanted: Option<&Versions>) -> Option<(Box<dyn Policy>, Versions)> {
        self.plan.policy(&self.parts, wanted)
    }
}
