//! LG-H-PPO: offline hierarchical reinforcement learning on a latent graph (Han 2026).
//!
//! | file | stage |
//! |---|---|
//! | `vae/`, `encoder_stage.rs` | 1: latent encoder |
//! | `graph/` | 2: graph of the latents |
//! | `low/`, `low_stage.rs` | 3a: goal-conditioned advantage-weighted regression |
//! | `high/`, `high_stage.rs` | 3b: PPO with masked logits on the graph |
//! | `navigator.rs`, `choice.rs` | execution: both levels at work |

pub mod checkpoint;
pub mod choice;
mod codes;
mod encoder_stage;
pub mod execution;
pub mod graph;
pub mod high;
mod high_stage;
pub mod low;
mod low_stage;
#[cfg(test)]
mod made;
pub mod navigator;
mod summary;
pub mod vae;

use std::sync::Arc;

use config::{Config, Document};
use dataset::Needs;
use simulator::Body;

use crate::algorithm::{Algorithm, Network, Plan};
use crate::graph_rule::GraphRule;
use crate::parts::{GRAPH, PARTS, Parts, Versions};
use crate::policy::Policy;
use crate::stage::{Inputs, Stage, StageError, StageSpec};
use crate::summary::{Label, Lookup, Summary};
use crate::walker;
use navigator::{Controller, Navigator, Planner};

/// The algorithm.
pub struct LgHPpo;

/// Its tables of the run file.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// `[encoder]`
    pub encoder: vae::Settings,
    /// `[graph]`
    pub graph: graph::Settings,
    /// `[low]`
    pub low: low::Settings,
    /// `[high]`
    pub high: high::Settings,
    /// `[execution]`
    pub execution: execution::Settings,
}

impl Algorithm for LgHPpo {
    fn name(&self) -> &'static str {
        "lg-h-ppo"
    }

    fn settings(&self, d: &mut Document<'_>) -> config::Settings {
        config::Settings::new(Settings {
            encoder: d.table("encoder", vae::Settings::read),
            graph: d.table("graph", graph::Settings::read),
            low: d.table("low", low::Settings::read),
            high: d.table("high", high::Settings::read),
            execution: d.table("execution", execution::Settings::read),
        })
    }

    fn plan(&self, config: &Config, body: &'static dyn Body) -> Option<Box<dyn Plan>> {
        let settings: &Settings = config.settings.get()?;
        Some(Box::new(Hierarchy {
            settings: settings.clone(),
            seed: config.run.seed,
            arrival_radius: config.evaluation.success_radius as f32,
            body,
        }))
    }

    fn labels(&self) -> &'static [Label] {
        summary::LABELS
    }

    fn summary(&self, setting: Lookup<'_, String>, metric: Lookup<'_, f64>) -> Vec<Summary> {
        summary::summary(setting, metric)
    }
}

/// The encoder's place among the networks.
const ENCODER: usize = 0;

/// What a run trains.
struct Hierarchy {
    settings: Settings,
    seed: u64,
    /// Within this distance a goal is reached (m).
    arrival_radius: f32,
    body: &'static dyn Body,
}

impl Hierarchy {
    fn learns_low(&self) -> bool {
        self.settings.low.controller == low::Controller::Learned
    }

    fn learns_high(&self) -> bool {
        self.settings.high.planner == high::Planner::Learned
    }

    /// A network's number, of those that there are.
    fn number(&self, name: &str) -> Option<usize> {
        self.networks()
            .iter()
            .position(|network| network.name == name)
    }

    fn controller(&self, parts: &Parts) -> Option<(Controller, u64)> {
        if !self.learns_low() {
            let (policy, weights) = walker::shipped();
            return Some((Controller::Walker(policy, weights), 0));
        }
        let weights = parts.weights(self.number("low")?)?;
        let latent = self.settings.encoder.latent;
        let policy = low::Policy::new(self.body, latent, &self.settings.low.hidden);
        let controller = Controller::Learned(policy, Arc::clone(&weights.values));
        Some((controller, weights.version))
    }

    /// The newest graph that the high level's weights fit, and what plans on it.
    fn planner(
        &self,
        parts: &Parts,
        wanted: Option<&Versions>,
    ) -> Option<(Arc<::graph::Graph>, Planner, u64)> {
        let asked = |graph: &&Arc<::graph::Graph>| {
            wanted.is_none_or(|wanted| wanted[GRAPH] == graph.version)
        };
        if !self.learns_high() {
            let graph = parts.graphs().find(asked)?;
            return Some((Arc::clone(graph), Planner::Search, 0));
        }
        let weights = parts.weights(self.number("high")?)?;
        let mut graphs = parts.graphs().filter(asked);
        let graph = graphs.find(|graph| graph.structure() == weights.structure)?;
        let latent = self.settings.encoder.latent;
        let policy = high::Policy::new(latent, graph.len(), &self.settings.high.hidden);
        let planner = Planner::Learned(policy, Arc::clone(&weights.values));
        Some((Arc::clone(graph), planner, weights.version))
    }
}

impl Plan for Hierarchy {
    fn networks(&self) -> Vec<Network> {
        let s = &self.settings;
        let network = |name, title, weights| Network {
            name,
            title,
            weights,
            over_graph: false,
            grows: false,
        };
        let latent = s.encoder.latent;
        let encoder = vae::Shape::new(latent, &s.encoder.hidden).weights();
        let mut networks = vec![network("encoder", "encoder", encoder)];
        if self.learns_low() {
            let policy = low::Policy::new(self.body, latent, &s.low.hidden);
            networks.push(network("low", "low level", policy.mlp().parameters()));
        }
        if self.learns_high() {
            let policy = high::Policy::new(latent, s.graph.most_nodes(), &s.high.hidden);
            networks.push(Network {
                over_graph: true,
                // Parts of the graph that are not connected to the rest are left out.
                grows: true,
                ..network("high", "high level", policy.weights())
            });
        }
        networks
    }

    fn needs(&self) -> Option<Needs> {
        let encoder = &self.settings.encoder;
        // An encoder that is not trained here needs no pairs.
        let lag = if encoder.is_trained() { encoder.lag } else { 0 };
        Some(Needs {
            lags: vec![("graph.lag", self.settings.graph.lag), ("encoder.lag", lag)],
            nodes: self.settings.graph.nodes,
        })
    }

    fn stages(&self) -> Vec<StageSpec> {
        let mut stages = vec![StageSpec {
            name: "encoder",
            time: "time/encoder_s",
            after: vec![],
            needs_graph: false,
            online: false,
        }];
        if self.learns_low() {
            stages.push(StageSpec {
                name: "low",
                time: "time/low_s",
                after: vec![ENCODER],
                needs_graph: true,
                online: false,
            });
        }
        if self.learns_high() {
            stages.push(StageSpec {
                name: "high",
                time: "time/high_s",
                after: vec![ENCODER],
                needs_graph: true,
                online: true,
            });
        }
        stages
    }

    fn start(
        &self,
        stage: usize,
        inputs: &Inputs<'_>,
        saved: Option<&[u8]>,
    ) -> Result<Box<dyn Stage>, StageError> {
        let s = &self.settings;
        let network = |name| self.number(name).unwrap_or(PARTS);
        match self.stages().get(stage).map(|stage| stage.name) {
            Some("low") => {
                let setup = low_stage::Setup {
                    body: self.body,
                    settings: s.low.clone(),
                    encoder: s.encoder.clone(),
                    lag: s.graph.lag,
                    arrival_radius: self.arrival_radius,
                    seed: self.seed,
                    networks: [ENCODER, network("low")],
                };
                low_stage::start(setup, inputs, saved)
            }
            Some("high") => {
                let setup = high_stage::Setup {
                    settings: s.high.clone(),
                    edges: high::Edges {
                        knowledge: s.graph.knowledge,
                        timeout: s.execution.timeout,
                    },
                    seed: self.seed,
                    network: network("high"),
                };
                high_stage::start(setup, inputs, saved)
            }
            _ => encoder_stage::start(&s.encoder, self.seed, ENCODER, inputs, saved),
        }
    }

    fn graph(&self) -> Option<Arc<dyn GraphRule>> {
        let Settings { graph, encoder, .. } = &self.settings;
        let rule = graph::Rule::new(self.body, graph, encoder, self.seed, ENCODER);
        Some(Arc::new(rule))
    }

    fn policy(
        &self,
        parts: &Parts,
        wanted: Option<&Versions>,
    ) -> Option<(Box<dyn Policy>, Versions)> {
        let s = &self.settings;
        let (graph, planner, high) = self.planner(parts, wanted)?;
        let (controller, low) = self.controller(parts)?;
        let encoder = parts.weights(ENCODER)?;
        let mut versions = [0; PARTS];
        versions[ENCODER] = encoder.version;
        versions[GRAPH] = graph.version;
        for (name, version) in [("low", low), ("high", high)] {
            if let Some(number) = self.number(name) {
                versions[number] = version;
            }
        }
        if wanted.is_some_and(|wanted| *wanted != versions) {
            return None;
        }
        let shape = vae::Shape::new(s.encoder.latent, &s.encoder.hidden);
        let encoder = vae::Encoder::new(shape, &encoder.values)?;
        let execution = (s.execution.clone(), s.graph.knowledge);
        let navigator =
            Navigator::new(self.body, execution, (encoder, graph), controller, planner)?;
        Some((Box::new(navigator), versions))
    }

    fn on_policy(&self) -> Option<usize> {
        self.number("high")
    }

    fn choice_words(&self) -> usize {
        2048
    }
}
