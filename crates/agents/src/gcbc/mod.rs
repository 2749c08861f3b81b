//! Goal-conditioned behavioural cloning with hindsight goals: one policy, no hierarchy, no graph.
//!
//! A state later in the same episode, a geometric number of steps ahead, stands for the goal of the
//! action that was taken; the policy is regressed on it (Lynch et al., "Learning latent plans from
//! play", 2019; Ghosh et al., "Learning to reach goals via iterated supervised learning", 2021). It is
//! the GCBC of OGBench (Park et al. 2024).

mod network;
mod settings;
mod stage;

use std::sync::Arc;

use config::{Config, Document};
use dataset::Needs;
use nets::Workspace;
use rand_pcg::Pcg64Mcg;
use simulator::{Body, Values};

use crate::algorithm::{Algorithm, Network, Plan};
use crate::graph_rule::GraphRule;
use crate::parts::{PARTS, Parts, Versions};
use crate::policy::{Act, Mode, Policy};
use crate::stage::{Inputs, Stage, StageError, StageSpec};
use crate::summary::{Label, Lookup, Rate, Summary};
use network::Shape;

pub use settings::Settings;

/// The algorithm.
pub struct Gcbc;

const LABELS: &[Label] = &[Label {
    metric: "gcbc/policy_loss",
    label: "policy loss",
    decimals: 4,
    rate: Some(Rate {
        metric: "throughput/gcbc_updates_per_s",
        unit: "updates",
    }),
}];

impl Algorithm for Gcbc {
    fn name(&self) -> &'static str {
        "gcbc"
    }

    fn settings(&self, d: &mut Document<'_>) -> config::Settings {
        config::Settings::new(d.table("gcbc", Settings::read))
    }

    fn plan(&self, config: &Config, body: &'static dyn Body) -> Option<Box<dyn Plan>> {
        let settings: &Settings = config.settings.get()?;
        Some(Box::new(Cloning {
            settings: settings.clone(),
            seed: config.run.seed,
            body,
        }))
    }

    fn labels(&self) -> &'static [Label] {
        LABELS
    }

    fn summary(&self, _: Lookup<'_, String>, metric: Lookup<'_, f64>) -> Vec<Summary> {
        let loss = metric("gcbc/policy_loss").filter(|loss| loss.is_finite());
        vec![Summary {
            name: "gcbc",
            title: "policy",
            seconds: metric("time/gcbc_s"),
            text: loss.map_or_else(String::new, |loss| format!("policy loss {loss:.4}")),
            quality: None,
        }]
    }
}

struct Cloning {
    settings: Settings,
    seed: u64,
    body: &'static dyn Body,
}

impl Plan for Cloning {
    fn networks(&self) -> Vec<Network> {
        let shape = Shape::new(self.body, &self.settings.hidden);
        vec![Network {
            name: "policy",
            title: "policy",
            weights: shape.mlp().parameters(),
            over_graph: false,
            grows: false,
        }]
    }

    fn needs(&self) -> Option<Needs> {
        Some(Needs {
            lags: vec![],
            nodes: 1,
        })
    }

    fn stages(&self) -> Vec<StageSpec> {
        vec![StageSpec {
            name: "gcbc",
            time: "time/gcbc_s",
            after: vec![],
            needs_graph: false,
            online: false,
        }]
    }

    fn start(
        &self,
        _: usize,
        inputs: &Inputs<'_>,
        saved: Option<&[u8]>,
    ) -> Result<Box<dyn Stage>, StageError> {
        stage::start(self.body, &self.settings, self.seed, inputs, saved)
    }

    fn graph(&self) -> Option<Arc<dyn GraphRule>> {
        None
    }

    fn policy(
        &self,
        parts: &Parts,
        wanted: Option<&Versions>,
    ) -> Option<(Box<dyn Policy>, Versions)> {
        let weights = parts.weights(0)?;
        let mut versions = [0; PARTS];
        versions[0] = weights.version;
        let shape = Shape::new(self.body, &self.settings.hidden);
        let fits = weights.values.len() == shape.mlp().parameters()
            && wanted.is_none_or(|wanted| *wanted == versions);
        fits.then(|| {
            let policy = Cloned {
                workspace: shape.mlp().workspace(1),
                shape,
                weights: Arc::clone(&weights.values),
                goal: [0.0; 2],
                input: vec![],
            };
            (Box::new(policy) as Box<dyn Policy>, versions)
        })
    }

    fn on_policy(&self) -> Option<usize> {
        None
    }

    fn choice_words(&self) -> usize {
        0
    }
}

/// The policy at work. It is deterministic: nothing learns from its rollouts.
struct Cloned {
    shape: Shape,
    weights: Arc<[f32]>,
    workspace: Workspace,
    goal: [f32; 2],
    input: Vec<f32>,
}

impl Policy for Cloned {
    fn begin(&mut self, goal: &[f32], _: Mode) {
        self.goal = [goal[0], goal[1]];
    }

    fn act(&mut self, observation: Values<'_>, _: &mut Pcg64Mcg, act: &mut Act) {
        let observation = observation.floats().unwrap_or_default();
        self.input.clear();
        let frame = self.shape.input(observation, self.goal, &mut self.input);
        let mlp = self.shape.mlp();
        let own = mlp.infer(&self.weights, &self.input, 1, &mut self.workspace);
        act.action.resize(own.len(), 0.0);
        self.shape.body().to_actuators(frame, own, &mut act.action);
        act.target = Some(self.goal);
    }
}
