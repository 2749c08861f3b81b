//! The walker in training: PPO on what actors walk.

use maze::{AntBody, CONTROL_SECONDS};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use simulator::{Body, Rows, flags};

use super::learner::{Batch, Learner};
use super::policy::load;
use super::settings::Settings;
use crate::actor_critic;
use crate::ppo::End;
use crate::rollout::Rollout;
use crate::stage::{Metrics, Progress, Publication, Stage, StageError};
use crate::stream;

/// What the training goes on from.
#[derive(Serialize, Deserialize)]
struct Saved {
    updates: u64,
    steps: u64,
    rng: Pcg64Mcg,
    learner: actor_critic::State,
}

/// What was walked since the last update.
#[derive(Default)]
struct Walked {
    /// Towards the direction (m).
    metres: f64,
    steps: usize,
    falls: usize,
}

struct WalkerStage {
    settings: Settings,
    learner: Learner,
    rng: Pcg64Mcg,
    batch: Batch,
    walked: Walked,
    updates: u64,
    steps: u64,
    features: Vec<f32>,
}

/// Begins the stage of a run with a seed.
pub(super) fn start(
    settings: &Settings,
    seed: u64,
    saved: Option<&[u8]>,
) -> Result<Box<dyn Stage>, StageError> {
    let mut rng = stream(seed, "walker", 0);
    let mut learner = Learner::new(
        &settings.hidden,
        settings.initial_log_std,
        settings.learning_rate,
        settings.ppo.clone(),
        &mut rng,
    );
    if let Some(path) = &settings.start {
        let (_, weights) = load(Some(path.as_ref()))?;
        if !learner.set_weights(weights) {
            return Err(StageError::Shape("walker"));
        }
    }
    let mut stage = WalkerStage {
        settings: settings.clone(),
        learner,
        rng,
        batch: Batch::default(),
        walked: Walked::default(),
        updates: 0,
        steps: 0,
        features: vec![],
    };
    let saved = saved.and_then(|saved| postcard::from_bytes::<Saved>(saved).ok());
    if let Some(saved) = saved
        && stage.learner.restore(saved.learner)
    {
        (stage.updates, stage.steps, stage.rng) = (saved.updates, saved.steps, saved.rng);
    }
    Ok(Box::new(stage))
}

impl WalkerStage {
    /// Adds steps and their final row to the batch; rows without one are not whole and are left
    /// out.
    fn add(&mut self, rows: Rows<'_>) {
        let Some(last) = rows.iter().next_back() else {
            return;
        };
        if !last.has(flags::FINAL) || rows.len() < 2 {
            return;
        }
        let batch = &mut self.batch;
        for step in rows.iter().take(rows.len() - 1) {
            let observation = step.observation().floats().unwrap_or_default();
            let frame = AntBody.view(observation, direction(step.goal()), &mut batch.features);
            let start = batch.actions.len();
            batch.actions.resize(start + step.action().len(), 0.0);
            AntBody.from_actuators(frame, step.action(), &mut batch.actions[start..]);
            batch.log_probs.push(step.log_prob());
            batch.rewards.push(step.reward());
            batch.ends.push(if step.has(flags::TERMINAL) {
                End::Terminal
            } else if step.has(flags::TRUNCATED) {
                End::Truncated
            } else {
                End::Not
            });
        }
        // Where the rows end for no other reason, the state after them stands for what follows.
        if let Some(end) = batch.ends.last_mut().filter(|end| **end == End::Not) {
            *end = End::Truncated;
        }
        let observation = last.observation().floats().unwrap_or_default();
        self.features.clear();
        AntBody.view(observation, direction(last.goal()), &mut self.features);
        batch.final_features.extend_from_slice(&self.features);
        batch.records.push(rows.len() - 1);
    }

    /// Adds up how far the steps led towards their directions.
    fn measure_speed(&mut self, rows: Rows<'_>) {
        let place = |row: usize| {
            let values = rows.row(row).observation().floats().unwrap_or_default();
            AntBody.place(values)
        };
        for row in 1..rows.len() {
            let ([x, y], [u, v]) = (place(row - 1), place(row));
            let [a, b] = direction(rows.row(row - 1).goal());
            self.walked.metres += f64::from((u - x) * a + (v - y) * b);
        }
        self.walked.steps += rows.len().saturating_sub(1);
        self.walked.falls += rows.iter().filter(|row| row.has(flags::FELL)).count();
    }
}

fn direction(goal: &[f32]) -> [f32; 2] {
    [0, 1].map(|axis| goal.get(axis).copied().unwrap_or(0.0))
}

impl Stage for WalkerStage {
    fn update(&mut self, metrics: &mut Metrics) -> bool {
        let s = &self.settings;
        self.steps += self.batch.len() as u64;
        let left = 1.0 - self.steps as f32 / s.steps as f32;
        self.learner
            .set_learning_rate(s.learning_rate * left.max(0.1));
        let report = self.learner.update(&self.batch, &mut self.rng);
        self.updates += 1;
        let (step, n) = (self.steps, self.batch.len().max(1) as f32);
        let Walked {
            metres,
            steps,
            falls,
        } = std::mem::take(&mut self.walked);
        let seconds = f64::from(CONTROL_SECONDS) * steps.max(1) as f64;
        for (name, value) in [
            ("walker/speed_m_s", (metres / seconds) as f32),
            ("walker/falls_per_1000_steps", 1000.0 * falls as f32 / n),
            ("walker/reward", self.batch.rewards.iter().sum::<f32>() / n),
            ("walker/kl", report.kl),
            ("walker/clip_fraction", report.clip_fraction),
            ("walker/entropy", report.entropy),
            ("walker/value_loss", report.value_loss),
        ] {
            metrics.add(name, step, value);
        }
        self.batch.clear();
        true
    }

    fn updates(&self) -> u64 {
        self.updates
    }

    fn progress(&self) -> Progress {
        let total = self.settings.steps as u64;
        Progress {
            done: self.steps.min(total),
            total,
        }
    }

    fn is_done(&self) -> bool {
        self.steps >= self.settings.steps as u64
    }

    fn is_idle(&self) -> bool {
        self.is_done() || self.batch.len() < self.settings.batch
    }

    fn publications(&self) -> Vec<Publication> {
        vec![Publication {
            network: 0,
            version: self.updates + 1,
            weights: self.learner.weights().to_vec(),
            graph: None,
        }]
    }

    fn learn(&mut self, rollout: &Rollout<'_>) {
        if !self.is_done() {
            self.add(rollout.rows);
            self.measure_speed(rollout.rows);
        }
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            updates: self.updates,
            steps: self.steps,
            rng: self.rng.clone(),
            learner: self.learner.state(),
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }
}
