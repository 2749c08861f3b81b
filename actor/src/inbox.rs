//! The newest weights and graph that fit each other, as an actor acts with them.

use std::collections::VecDeque;

use agents::navigator::{Controller, Navigator, Patience, Planner, Settings};
use agents::{high, low, vae};
use config::Config;
use graph::{Graph, Knowledge};
use wire::{Bus, GraphSubscriber, Module, Weights, WeightsSubscriber};

use crate::walker::Walker;

/// Versions of the graph that are kept until the high level's weights for them come.
const KEPT: usize = 4;

/// What has come.
pub(crate) struct Inbox {
    encoder: WeightsSubscriber,
    low: WeightsSubscriber,
    high: WeightsSubscriber,
    graph: GraphSubscriber,
    newest_encoder: Option<Weights>,
    newest_low: Option<Weights>,
    newest_high: Option<Weights>,
    /// The newest first.
    graphs: VecDeque<Graph>,
    walker: Option<Walker>,
    latent: usize,
}

/// Versions of low, high and graph that act together.
pub(crate) type Versions = [u64; 3];

impl Inbox {
    pub(crate) fn new(config: &Config, bus: &Bus) -> anyhow::Result<Self> {
        let walker = match config.low.controller {
            config::Controller::Walker => Some(Walker::load(None)?),
            config::Controller::Learned => None,
        };
        Ok(Self {
            encoder: WeightsSubscriber::new(bus, Module::Encoder)?,
            low: WeightsSubscriber::new(bus, Module::Low)?,
            high: WeightsSubscriber::new(bus, Module::High)?,
            graph: GraphSubscriber::new(bus)?,
            newest_encoder: None,
            newest_low: None,
            newest_high: None,
            graphs: VecDeque::new(),
            walker,
            latent: config.encoder.latent,
        })
    }

    /// Looks for news; whether there was any.
    pub(crate) fn look(&mut self) -> bool {
        let mut news = false;
        for (subscriber, newest) in [
            (&mut self.encoder, &mut self.newest_encoder),
            (&mut self.low, &mut self.newest_low),
            (&mut self.high, &mut self.newest_high),
        ] {
            if let Some(weights) = subscriber.latest() {
                *newest = Some(weights);
                news = true;
            }
        }
        let latent = self.latent;
        let read = |bytes: &[u8]| Graph::from_bytes_of(bytes, latent);
        if let Some(graph) = self.graph.latest(read) {
            self.graphs.push_front(graph);
            self.graphs.truncate(KEPT);
            news = true;
        }
        news
    }

    /// What was refused at the door.
    pub(crate) fn refused(&self) -> u64 {
        let weights = [&self.encoder, &self.low, &self.high];
        self.graph.refused() + weights.map(WeightsSubscriber::refused).iter().sum::<u64>()
    }

    /// A navigator of the newest parts that fit each other, and their versions; none until all
    /// are there. Weights of the high level fit the graphs of one structure alone. Where versions
    /// are wanted, of exactly these.
    pub(crate) fn navigator(
        &self,
        config: &Config,
        wanted: Option<Versions>,
    ) -> Option<(Navigator, Versions)> {
        let asked = |graph: &&Graph| wanted.is_none_or(|[.., version]| graph.version == version);
        let (graph, planner, high_version) = match config.high.planner {
            config::Planner::Search => (self.graphs.iter().find(asked)?, Planner::Search, 0),
            config::Planner::Learned => {
                let high = self.newest_high.as_ref()?;
                let fits = |graph: &&Graph| graph.structure() == high.shape_hash && asked(graph);
                let graph = self.graphs.iter().find(fits)?;
                let latent = config.encoder.latent;
                let policy = high::Policy::new(latent, graph.len(), &config.high.hidden);
                let planner = Planner::Learned(policy, high.values.clone());
                (graph, planner, high.version)
            }
        };
        let (controller, low_version) = match &self.walker {
            Some(walker) => (walker.controller(), 0),
            None => {
                let weights = self.newest_low.as_ref()?;
                let policy = low::Policy::new(config.encoder.latent, &config.low.hidden);
                let controller = Controller::Learned(policy, weights.values.clone());
                (controller, weights.version)
            }
        };
        let versions = [low_version, high_version, graph.version];
        if wanted.is_some_and(|wanted| wanted != versions) {
            return None;
        }
        let shape = vae::Shape::new(config.encoder.latent, &config.encoder.hidden);
        let encoder = vae::Encoder::new(shape, &self.newest_encoder.as_ref()?.values)?;
        let navigator = Navigator::new(
            settings(config),
            encoder,
            graph.clone(),
            controller,
            planner,
        )?;
        Some((navigator, versions))
    }
}

fn settings(config: &Config) -> Settings {
    let e = &config.execution;
    Settings {
        reached_radius: e.reached_radius as f32,
        goal_radius: e.goal_radius as f32,
        look_ahead: e.look_ahead,
        patience: Patience {
            factor: e.timeout_factor as f32,
            most: e.max_edge_steps,
        },
        knowledge: match config.graph.knowledge {
            config::Knowledge::Nothing => Knowledge::Nothing,
            config::Knowledge::Data => Knowledge::Data,
            config::Knowledge::Rollouts => Knowledge::Rollouts,
        },
    }
}
