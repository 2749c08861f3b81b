//! The walker: a policy of the observation alone that walks the ant in a direction, trained by PPO
//! online. It makes the offline data, in the place of D4RL's goal-reaching policy.

mod environment;
mod gaussian;
mod learner;
mod policy;
mod settings;
mod stage;

use std::sync::Arc;

use config::{Config, Document};
use dataset::Needs;
use maze::{AntBody, Layout};
use nets::Workspace;
use nets::file::Tensor;
use rand_pcg::Pcg64Mcg;
use simulator::{Body, Simulator, Values};

use crate::algorithm::{Algorithm, Checkpoint, Environments, Network, Plan};
use crate::graph_rule::GraphRule;
use crate::parts::{PARTS, Parts, Versions};
use crate::policy::{Act, Mode};
use crate::stage::{Inputs, Stage, StageError, StageSpec};
use crate::summary::{Label, Lookup, Summary};
use environment::{EPISODE_STEPS, Stroll};

#[cfg(test)]
pub(crate) use gaussian::Gaussian;
pub use policy::{Policy, WalkerError, load, shipped};
pub use settings::Settings;

/// The algorithm.
pub struct Walker;

impl Algorithm for Walker {
    fn name(&self) -> &'static str {
        "walker"
    }

    fn is_offline(&self) -> bool {
        false
    }

    fn settings(&self, d: &mut Document<'_>) -> config::Settings {
        config::Settings::new(d.table("walker", Settings::read))
    }

    fn plan(&self, config: &Config, _: &'static dyn Body) -> Option<Box<dyn Plan>> {
        let settings: &Settings = config.settings.get()?;
        Some(Box::new(Training {
            settings: settings.clone(),
            seed: config.run.seed,
        }))
    }

    fn labels(&self) -> &'static [Label] {
        const fn label(metric: &'static str, label: &'static str) -> Label {
            Label {
                metric,
                label,
                decimals: 3,
                rate: None,
            }
        }
        const LABELS: &[Label] = &[
            label("walker/speed_m_s", "speed (m/s)"),
            label("walker/falls_per_1000_steps", "falls per 1000 steps"),
            label("walker/reward", "reward"),
            label("walker/value_loss", "value loss"),
            label("walker/entropy", "entropy (nats)"),
            label("walker/kl", "KL (nats)"),
        ];
        LABELS
    }

    fn summary(&self, _: Lookup<'_, String>, metric: Lookup<'_, f64>) -> Vec<Summary> {
        let speed = metric("walker/speed_m_s").map(|speed| format!("{speed:.2} m/s"));
        vec![Summary {
            name: "walker",
            title: "walker",
            seconds: metric("time/walker_s"),
            text: speed.unwrap_or_default(),
            quality: None,
        }]
    }
}

struct Training {
    settings: Settings,
    seed: u64,
}

impl Plan for Training {
    fn networks(&self) -> Vec<Network> {
        vec![Network {
            name: "walker",
            title: "walker",
            weights: Policy::new(&self.settings.hidden).weights(),
            over_graph: false,
            grows: false,
        }]
    }

    fn needs(&self) -> Option<Needs> {
        None
    }

    fn stages(&self) -> Vec<StageSpec> {
        vec![StageSpec {
            name: "walker",
            time: "time/walker_s",
            after: vec![],
            needs_graph: false,
            online: true,
        }]
    }

    fn start(
        &self,
        _: usize,
        _: &Inputs<'_>,
        saved: Option<&[u8]>,
    ) -> Result<Box<dyn Stage>, StageError> {
        stage::start(&self.settings, self.seed, saved)
    }

    fn graph(&self) -> Option<Arc<dyn GraphRule>> {
        None
    }

    fn policy(
        &self,
        parts: &Parts,
        wanted: Option<&Versions>,
    ) -> Option<(Box<dyn crate::Policy>, Versions)> {
        let weights = parts.weights(0)?;
        let mut versions = [0; PARTS];
        versions[0] = weights.version;
        let policy = Policy::new(&self.settings.hidden);
        let fits = weights.values.len() == policy.weights()
            && wanted.is_none_or(|wanted| *wanted == versions);
        fits.then(|| {
            let walking = Walking {
                workspace: policy.mlp().workspace(1),
                policy,
                weights: Arc::clone(&weights.values),
                direction: [1.0, 0.0],
                mode: Mode::Explore,
                features: vec![],
                own: vec![],
            };
            (Box::new(walking) as Box<dyn crate::Policy>, versions)
        })
    }

    fn on_policy(&self) -> Option<usize> {
        Some(0)
    }

    fn choice_words(&self) -> usize {
        0
    }

    fn environments(&self) -> Environments {
        Environments {
            number: self.settings.environments,
            trajectory_rows: self.settings.segment + 1,
            episode_steps: Some(EPISODE_STEPS),
            renewed: true,
        }
    }

    fn simulator(&self, layout: &Layout, number: usize) -> Option<Box<dyn Simulator>> {
        let s = &self.settings;
        let in_maze = (s.maze_share * s.environments as f64).round() as usize;
        Some(Box::new(Stroll::new(layout, s, number < in_maze)))
    }

    fn checkpoint<'w>(&self, _: usize, weights: &'w [f32]) -> Checkpoint<'w> {
        let hidden = self.settings.hidden.iter().map(ToString::to_string);
        let policy = Policy::new(&self.settings.hidden);
        let parameters = policy.mlp().parameters();
        let mut tensors: Vec<Tensor<'w>> = policy.mlp().tensors("policy", &weights[..parameters]);
        let log_std = &weights[parameters..];
        tensors.push(("log_std".to_owned(), vec![log_std.len()], log_std));
        Checkpoint {
            tensors,
            metadata: vec![(
                "hidden".to_owned(),
                hidden.collect::<Vec<String>>().join(","),
            )],
            copy: Some(self.settings.output.clone()).filter(|path| !path.is_empty()),
        }
    }
}

/// The walker at work.
struct Walking {
    policy: Policy,
    weights: Arc<[f32]>,
    workspace: Workspace,
    direction: [f32; 2],
    mode: Mode,
    features: Vec<f32>,
    /// The action in the body's own frame.
    own: Vec<f32>,
}

impl crate::Policy for Walking {
    fn begin(&mut self, goal: &[f32], mode: Mode) {
        self.mode = mode;
        self.aim(goal);
    }

    fn aim(&mut self, goal: &[f32]) {
        self.direction = [0, 1].map(|axis| goal.get(axis).copied().unwrap_or(0.0));
    }

    fn act(&mut self, observation: Values<'_>, rng: &mut Pcg64Mcg, act: &mut Act) {
        let observation = observation.floats().unwrap_or_default();
        self.features.clear();
        let frame = AntBody.view(observation, self.direction, &mut self.features);
        let mean = self
            .policy
            .mean(&self.weights, &self.features, 1, &mut self.workspace);
        self.own.clear();
        self.own.extend_from_slice(mean);
        if self.mode == Mode::Explore {
            let log_std = self.policy.log_std(&self.weights);
            act.log_prob = policy::sample(mean, log_std, rng, &mut self.own);
        }
        act.action.resize(self.own.len(), 0.0);
        AntBody.to_actuators(frame, &self.own, &mut act.action);
    }
}
