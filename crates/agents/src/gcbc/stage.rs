//! The policy in training.

use std::sync::Arc;

use dataset::{Dataset, Starts};
use nets::{Adam, Workspace};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use simulator::Body;

use super::network;
use super::settings::Settings;
use crate::same_shape;
use crate::stage::{Inputs, Metrics, Progress, Publication, Stage, StageError};
use crate::stream;

/// Updates between two reports and publications.
const REPORT: usize = 500;

/// What the training goes on from.
#[derive(Serialize, Deserialize)]
struct Saved {
    update: usize,
    rng: Pcg64Mcg,
    weights: Vec<f32>,
    adam: Adam,
    sum: f32,
}

struct Training {
    settings: Settings,
    shape: network::Shape,
    data: Arc<Dataset>,
    starts: Starts,
    weights: Vec<f32>,
    adam: Adam,
    rng: Pcg64Mcg,
    update: usize,
    /// Sum of the losses since the last report.
    sum: f32,
    workspace: Workspace,
    inputs: Vec<f32>,
    actions: Vec<f32>,
    error: Vec<f32>,
    gradient: Vec<f32>,
}

/// Begins the stage of a run with a seed.
pub(super) fn start(
    body: &'static dyn Body,
    settings: &Settings,
    seed: u64,
    inputs: &Inputs<'_>,
    saved: Option<&[u8]>,
) -> Result<Box<dyn Stage>, StageError> {
    let data = Arc::clone(inputs.data);
    let Some(starts) = Starts::new(&data.episodes, 1) else {
        return Err(StageError::TooShort {
            key: "a goal's least distance, which",
            steps: 1,
        });
    };
    let mut rng = stream(seed, "gcbc", 0);
    let shape = network::Shape::new(body, &settings.hidden);
    let weights = shape.mlp().init(&mut rng, 0.01);
    let mut training = Training {
        settings: settings.clone(),
        data,
        starts,
        adam: Adam::new(weights.len(), settings.learning_rate),
        gradient: vec![0.0; weights.len()],
        weights,
        rng,
        update: 0,
        sum: 0.0,
        workspace: shape.mlp().workspace(settings.batch),
        shape,
        inputs: vec![],
        actions: vec![],
        error: vec![],
    };
    let saved = saved.and_then(|saved| postcard::from_bytes::<Saved>(saved).ok());
    if let Some(saved) = saved
        && same_shape(&[(&saved.weights, &training.weights)])
        && saved.adam.fits(training.weights.len())
    {
        training.update = saved.update;
        training.rng = saved.rng;
        training.weights = saved.weights;
        training.adam = saved.adam;
        training.sum = saved.sum;
    }
    Ok(Box::new(training))
}

impl Training {
    /// Draws transitions with hindsight goals into `inputs` and `actions`.
    fn draw(&mut self) {
        self.inputs.clear();
        self.actions.clear();
        let body = self.shape.body();
        for _ in 0..self.settings.batch {
            let (row, end) = self.starts.draw(&mut self.rng);
            let ahead = geometric(self.settings.discount, self.rng.random());
            let goal = self.data.place((row + ahead).min(end - 1));
            let observation = self.data.observation(row);
            let frame = self.shape.input(observation, goal, &mut self.inputs);
            let (start, action) = (self.actions.len(), self.data.action(row));
            self.actions.resize(start + action.len(), 0.0);
            body.from_actuators(frame, action, &mut self.actions[start..]);
        }
    }

    /// Mean squared error of the drawn transitions; its gradient is left in `gradient`.
    fn loss(&mut self) -> f32 {
        let mlp = self.shape.mlp();
        let n = self.settings.batch;
        let scale = 1.0 / n as f32;
        let means = mlp.forward(&self.weights, &self.inputs, n, &mut self.workspace);
        self.error.clear();
        let errors = means
            .iter()
            .zip(&self.actions)
            .map(|(mean, action)| mean - action);
        self.error.extend(errors.map(|error| scale * error));
        let squares = self.error.iter().map(|error| error * error);
        let loss = 0.5 * squares.sum::<f32>() / scale;
        self.gradient.fill(0.0);
        mlp.backward(
            &self.weights,
            &self.inputs,
            n,
            &mut self.workspace,
            &self.error,
            &mut self.gradient,
            None,
        );
        loss
    }
}

/// Steps ahead, at least one, of a draw in [0, 1).
fn geometric(discount: f32, draw: f32) -> usize {
    if discount <= 0.0 {
        return 1;
    }
    let steps = (1.0 - draw).ln() / discount.ln();
    1 + steps.clamp(0.0, 1e6) as usize
}

impl Stage for Training {
    fn update(&mut self, metrics: &mut Metrics) -> bool {
        self.draw();
        self.sum += self.loss();
        self.adam.step(&mut self.weights, &self.gradient);
        self.update += 1;
        let due = self.update.is_multiple_of(REPORT) || self.is_done();
        if due {
            let n = ((self.update - 1) % REPORT + 1) as f32;
            metrics.add("gcbc/policy_loss", self.updates(), self.sum / n);
            self.sum = 0.0;
        }
        due
    }

    fn updates(&self) -> u64 {
        self.update as u64
    }

    fn progress(&self) -> Progress {
        Progress {
            done: self.update as u64,
            total: self.settings.updates as u64,
        }
    }

    fn is_done(&self) -> bool {
        self.update >= self.settings.updates
    }

    fn publications(&self) -> Vec<Publication> {
        vec![Publication {
            network: 0,
            version: self.updates(),
            weights: self.weights.clone(),
            graph: None,
        }]
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            update: self.update,
            rng: self.rng.clone(),
            weights: self.weights.clone(),
            adam: self.adam.clone(),
            sum: self.sum,
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dataset::Shape;
    use maze::PointBody;

    use super::*;
    use crate::parts::Parts;

    /// A point that goes from left to right and from right to left, by turns.
    fn data() -> Arc<Dataset> {
        let mut data = Dataset::new(Shape::vectors(4, 2));
        for episode in 0..20 {
            let start = data.len();
            let way = if episode % 2 == 0 { 1.0 } else { -1.0 };
            for step in 0..30 {
                let x = way * 0.2 * (step as f32 - 15.0);
                data.observations
                    .extend([x, 0.1 * episode as f32, 0.0, 0.0]);
                data.actions.extend([way, 0.0]);
                data.rewards.push(0.0);
                data.terminals.push(false);
            }
            data.episodes.push(start..data.len());
        }
        Arc::new(data)
    }

    fn training(updates: usize) -> Training {
        let settings = Settings {
            hidden: vec![16],
            learning_rate: 1e-3,
            batch: 32,
            updates,
            discount: 0.9,
        };
        let data = data();
        let parts = Parts::new(1);
        let inputs = Inputs {
            data: &data,
            folder: Path::new(""),
            parts: &parts,
            in_rounds: false,
        };
        let mut training = started(&settings, &inputs);
        training.draw();
        training
    }

    fn started(settings: &Settings, inputs: &Inputs<'_>) -> Training {
        let shape = network::Shape::new(&PointBody, &settings.hidden);
        let mut rng = stream(1, "gcbc", 0);
        let weights = shape.mlp().init(&mut rng, 0.5);
        Training {
            settings: settings.clone(),
            data: Arc::clone(inputs.data),
            starts: Starts::new(&inputs.data.episodes, 1).unwrap(),
            adam: Adam::new(weights.len(), settings.learning_rate),
            gradient: vec![0.0; weights.len()],
            weights,
            rng,
            update: 0,
            sum: 0.0,
            workspace: shape.mlp().workspace(settings.batch),
            shape,
            inputs: vec![],
            actions: vec![],
            error: vec![],
        }
    }

    #[test]
    fn the_gradient_is_its_finite_difference() {
        let mut training = training(1);
        training.loss();
        let gradient = training.gradient.clone();
        for at in (0..gradient.len()).step_by(7) {
            let mut at_offset = |offset: f32| {
                let before = training.weights[at];
                training.weights[at] += offset;
                let loss = training.loss();
                training.weights[at] = before;
                loss
            };
            let numeric = (at_offset(1e-2) - at_offset(-1e-2)) / 2e-2;
            assert!(
                (numeric - gradient[at]).abs() < 2e-3 * (1.0 + gradient[at].abs()),
                "{at}: {numeric} {}",
                gradient[at]
            );
        }
    }

    #[test]
    fn the_policy_comes_to_do_what_led_to_the_goal() {
        let mut training = training(600);
        let mut metrics = Metrics::default();
        while !training.is_done() {
            training.update(&mut metrics);
        }
        let last = metrics.0.last().unwrap();
        assert!(last.2 < 0.05, "the loss is {}", last.2);
        let body = training.shape.body();
        let mut input = vec![];
        let state = [0.0, 0.5, 0.0, 0.0];
        let frame = training.shape.input(&state, [1.5, 0.5], &mut input);
        let mlp = training.shape.mlp();
        let own = mlp.infer(&training.weights, &input, 1, &mut training.workspace);
        let mut action = [0.0; 2];
        body.to_actuators(frame, own, &mut action);
        assert!(action[0] > 0.7, "{action:?}");
    }

    #[test]
    fn steps_ahead_are_at_least_one_and_follow_the_discount() {
        assert_eq!(geometric(0.0, 0.9), 1);
        assert_eq!(geometric(0.9, 0.0), 1);
        let draws = 10_000;
        let sum: usize = (0..draws)
            .map(|i| geometric(0.9, (i as f32 + 0.5) / draws as f32))
            .sum();
        let mean = sum as f32 / draws as f32;
        assert!((mean - 10.0).abs() < 0.2, "mean {mean}");
    }

    #[test]
    fn a_training_goes_on_from_its_state_as_if_nothing_had_been() {
        let settings = training(40).settings;
        let data = data();
        let parts = Parts::new(1);
        let inputs = Inputs {
            data: &data,
            folder: Path::new(""),
            parts: &parts,
            in_rounds: false,
        };
        let fresh = |saved: Option<&[u8]>| start(&PointBody, &settings, 5, &inputs, saved).unwrap();
        let mut metrics = Metrics::default();
        let mut whole = fresh(None);
        (0..20).for_each(|_| {
            whole.update(&mut metrics);
        });
        let saved = whole.save();
        let mut resumed = fresh(Some(&saved));
        for stage in [&mut whole, &mut resumed] {
            (0..20).for_each(|_| {
                stage.update(&mut metrics);
            });
        }
        assert_eq!(whole.save(), resumed.save());
        assert!(resumed.is_done());
    }
}
