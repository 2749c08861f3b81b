//! Stage 3a in training: the low level, on hindsight subgoals of the data.

use std::sync::Arc;

use dataset::{Dataset, Starts};
use graph::Graph;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use simulator::Body;

use super::checkpoint::{self, Given};
use super::codes::{self, Codes};
use super::low::{self, Low, Policy, Sample, Subgoal};
use super::vae::{self, Encoder, Shape};
use crate::stage::{Inputs, Metrics, Progress, Publication, Stage, StageError};
use crate::stream;

/// Updates between two reports.
const REPORT: usize = 500;
/// Updates between two publications.
const PUBLISH: usize = 500;
/// The value's goals: the policy's subgoal, a later state, any node; the rest is the state's own
/// place.
const VALUE_GOALS: [f32; 3] = [0.5, 0.2, 0.2];

/// What the training goes on from.
#[derive(Serialize, Deserialize)]
struct Saved {
    update: usize,
    rng: Pcg64Mcg,
    low: low::State,
    sums: [f32; 3],
    /// The graph that it began with.
    graph: Vec<u8>,
}

/// What the stage is made of.
#[derive(Clone)]
pub(super) struct Setup {
    pub(super) body: &'static dyn Body,
    pub(super) settings: low::Settings,
    pub(super) encoder: vae::Settings,
    /// Steps of a segment of the graph.
    pub(super) lag: usize,
    /// See [`Low::new`] (m).
    pub(super) arrival_radius: f32,
    pub(super) seed: u64,
    /// Numbers of the encoder's and the own network.
    pub(super) networks: [usize; 2],
}

struct LowStage {
    setup: Setup,
    data: Arc<Dataset>,
    graph: Arc<Graph>,
    codes: Codes,
    starts: Starts,
    low: Low,
    rng: Pcg64Mcg,
    update: usize,
    /// Sums of the losses since the last report.
    sums: [f32; 3],
    drawn: Vec<Drawn>,
}

/// Begins the stage.
pub(super) fn start(
    setup: Setup,
    inputs: &Inputs<'_>,
    saved: Option<&[u8]>,
) -> Result<Box<dyn Stage>, StageError> {
    let (l, dz) = (&setup.settings, setup.encoder.latent);
    if let Some(path) = &l.from {
        let policy = Policy::new(setup.body, dz, &l.hidden);
        let weights = checkpoint::load(path, policy.mlp().parameters())?;
        let network = setup.networks[1];
        return Ok(Box::new(Given { network, weights }));
    }
    let shape = Shape::new(dz, &setup.encoder.hidden);
    let weights = inputs.parts.weights(setup.networks[0]);
    let weights = weights.map_or(&[][..], |weights| &weights.values);
    let mut encoder = Encoder::new(shape, weights).ok_or(StageError::Shape("encoder"))?;
    let saved = saved.and_then(|saved| postcard::from_bytes::<Saved>(saved).ok());
    let first = saved.as_ref().and_then(|saved| {
        let graph = Graph::from_bytes_of(&saved.graph, dz).ok()?;
        Some(Arc::new(graph))
    });
    let saved = saved.filter(|_| first.is_some());
    let newest = inputs.parts.graph().cloned();
    let graph = first.or(newest).ok_or(StageError::TooSmall(0))?;
    let data = Arc::clone(inputs.data);
    let Some(starts) = Starts::new(&data.episodes, 1) else {
        return Err(StageError::TooShort {
            key: "a step, which",
            steps: 1,
        });
    };
    let codes = codes::of(inputs.folder, &data, weights, &mut encoder, &graph);
    let mut rng = stream(setup.seed, "low", 0);
    let low = Low::new(setup.body, dz, setup.arrival_radius, l.clone(), &mut rng);
    let mut stage = LowStage {
        setup,
        data,
        graph,
        codes,
        starts,
        low,
        rng,
        update: 0,
        sums: [0.0; 3],
        drawn: vec![],
    };
    if let Some(saved) = saved
        && stage.low.restore(saved.low)
    {
        (stage.update, stage.rng, stage.sums) = (saved.update, saved.rng, saved.sums);
    }
    Ok(Box::new(stage))
}

/// Rows of a sample: the state, the subgoal's node where it is snapped to one, else its row, and
/// the value's goal.
struct Drawn {
    row: usize,
    later: usize,
    node: Option<u32>,
    value_goal: [f32; 2],
}

impl LowStage {
    /// Draws a transition with its two hindsight goals.
    fn draw(&mut self) -> Drawn {
        let l = &self.setup.settings;
        let reach = self.setup.lag + l.slack;
        let rng = &mut self.rng;
        let (row, end) = self.starts.draw(rng);
        let later = (row + rng.random_range(1..=reach)).min(end - 1);
        let snapped = rng.random::<f64>() < l.snap;
        let node = snapped.then(|| self.codes.nodes[later]);
        let mut pick: f32 = rng.random();
        let mut value_goal = self.data.place(row);
        for (goal, share) in VALUE_GOALS.into_iter().enumerate() {
            if (0.0..share).contains(&pick) {
                value_goal = match goal {
                    0 => match node {
                        Some(node) => self.graph.places[node as usize],
                        None => self.data.place(later),
                    },
                    1 => {
                        let ahead = rng.random_range(1..=4 * reach);
                        self.data.place((row + ahead).min(end - 1))
                    }
                    _ => self.graph.places[rng.random_range(0..self.graph.len())],
                };
            }
            pick -= share;
        }
        Drawn {
            row,
            later,
            node,
            value_goal,
        }
    }

    fn report(&mut self, metrics: &mut Metrics) {
        let (step, n) = (self.updates(), ((self.update - 1) % REPORT + 1) as f32);
        let [value_loss, policy_loss, weight] = self.sums;
        metrics.add("low/value_loss", step, value_loss / n);
        metrics.add("low/policy_loss", step, policy_loss / n);
        metrics.add("low/mean_weight", step, weight / n);
        self.sums = [0.0; 3];
    }
}

impl Stage for LowStage {
    fn update(&mut self, metrics: &mut Metrics) -> bool {
        let (batch, updates) = (self.setup.settings.batch, self.setup.settings.updates);
        let left = 1.0 - (self.update + 1) as f32 / updates as f32;
        let rate = self.setup.settings.learning_rate;
        self.low.set_learning_rate(rate * left.max(0.1));
        let mut drawn = std::mem::take(&mut self.drawn);
        drawn.clear();
        drawn.extend((0..batch).map(|_| self.draw()));
        let (data, graph, dz) = (&self.data, &self.graph, self.setup.encoder.latent);
        let latent = |row: usize| &self.codes.latents[row * dz..(row + 1) * dz];
        let sample = |drawn: &Drawn| Sample {
            observation: data.observation(drawn.row),
            action: data.action(drawn.row),
            next: data.observation(drawn.row + 1),
            latent: latent(drawn.row),
            subgoal: match drawn.node {
                Some(node) => Subgoal {
                    place: graph.places[node as usize],
                    latent: graph.latent(node),
                },
                None => Subgoal {
                    place: data.place(drawn.later),
                    latent: latent(drawn.later),
                },
            },
            value_goal: drawn.value_goal,
        };
        let samples: Vec<Sample<'_>> = drawn.iter().map(sample).collect();
        let losses = self.low.update(&samples);
        self.drawn = drawn;
        self.sums[0] += losses.value_loss;
        self.sums[1] += losses.policy_loss;
        self.sums[2] += losses.weight;
        self.update += 1;
        if self.update.is_multiple_of(REPORT) || self.is_done() {
            self.report(metrics);
        }
        self.update.is_multiple_of(PUBLISH) || self.is_done()
    }

    fn updates(&self) -> u64 {
        self.update as u64
    }

    fn progress(&self) -> Progress {
        Progress {
            done: self.update as u64,
            total: self.setup.settings.updates as u64,
        }
    }

    fn is_done(&self) -> bool {
        self.update >= self.setup.settings.updates
    }

    fn publications(&self) -> Vec<Publication> {
        vec![Publication {
            network: self.setup.networks[1],
            version: self.updates(),
            weights: self.low.weights.clone(),
            graph: None,
        }]
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            update: self.update,
            rng: self.rng.clone(),
            low: self.low.state(),
            sums: self.sums,
            graph: self.graph.to_bytes(),
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }
}
