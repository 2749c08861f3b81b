//! Stage 1 in training: the latent encoder.

use std::sync::Arc;

use dataset::{Dataset, Starts};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::checkpoint::{self, Given};
use super::vae::{self, Encoder, Latent, Settings, Shape, Vae};
use crate::stage::{Inputs, Metrics, Progress, Publication, Stage, StageError};
use crate::stream;

/// Updates between two reports.
const REPORT: usize = 500;
/// Places that the decoder's error is measured at.
const PLACES: usize = 2000;

/// What the training goes on from.
#[derive(Serialize, Deserialize)]
struct Saved {
    update: usize,
    rng: Pcg64Mcg,
    vae: vae::State,
    sums: [f32; 2],
}

struct EncoderStage {
    settings: Settings,
    network: usize,
    data: Arc<Dataset>,
    starts: Starts,
    vae: Vae,
    rng: Pcg64Mcg,
    update: usize,
    /// Sums of the losses since the last report.
    sums: [f32; 2],
    pairs: Vec<([f32; 2], [f32; 2])>,
}

/// Begins the stage of a run with a seed; its weights are those of `network`.
pub(super) fn start(
    settings: &Settings,
    seed: u64,
    network: usize,
    inputs: &Inputs<'_>,
    saved: Option<&[u8]>,
) -> Result<Box<dyn Stage>, StageError> {
    let given = |weights| Ok(Box::new(Given { network, weights }) as Box<dyn Stage>);
    let (mean, std) = moments(inputs.data);
    if settings.kind == Latent::Place {
        return given([mean, std].concat());
    }
    if let Some(path) = &settings.from {
        let shape = Shape::new(settings.latent, &settings.hidden);
        return given(checkpoint::load(path, shape.weights())?);
    }
    let Some(starts) = Starts::new(&inputs.data.episodes, settings.lag) else {
        return Err(StageError::TooShort {
            key: "encoder.lag",
            steps: settings.lag,
        });
    };
    let mut rng = stream(seed, "encoder", 0);
    let vae = Vae::new(settings.clone(), mean, std, &mut rng);
    let mut stage = EncoderStage {
        pairs: Vec::with_capacity(settings.batch),
        settings: settings.clone(),
        network,
        data: Arc::clone(inputs.data),
        starts,
        vae,
        rng,
        update: 0,
        sums: [0.0; 2],
    };
    let saved = saved.and_then(|saved| postcard::from_bytes::<Saved>(saved).ok());
    if let Some(saved) = saved
        && stage.vae.restore(saved.vae)
    {
        (stage.update, stage.rng, stage.sums) = (saved.update, saved.rng, saved.sums);
    }
    Ok(Box::new(stage))
}

impl Stage for EncoderStage {
    fn update(&mut self, metrics: &mut Metrics) -> bool {
        let lag = self.settings.lag;
        self.pairs.clear();
        for _ in 0..self.settings.batch {
            let (row, _) = self.starts.draw(&mut self.rng);
            self.pairs
                .push((self.data.place(row), self.data.place(row + lag)));
        }
        let losses = self.vae.update(&self.pairs, &mut self.rng);
        self.sums[0] += losses.reconstruction;
        self.sums[1] += losses.kl;
        self.update += 1;
        if self.update.is_multiple_of(REPORT) || self.is_done() {
            let (step, n) = (self.updates(), ((self.update - 1) % REPORT + 1) as f32);
            metrics.add("encoder/reconstruction", step, self.sums[0] / n);
            metrics.add("encoder/kl_nats", step, self.sums[1] / n);
            self.sums = [0.0; 2];
        }
        // A graph is of one encoder: only the last weights are published.
        self.is_done()
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
        let published = self.is_done().then(|| Publication {
            network: self.network,
            version: 1,
            weights: self.vae.weights.clone(),
            graph: None,
        });
        published.into_iter().collect()
    }

    /// How well places come back from their own codes.
    fn measure(&mut self, metrics: &mut Metrics) {
        let shape = self.vae.shape().clone();
        let Some(mut encoder) = Encoder::new(shape, &self.vae.weights) else {
            return;
        };
        let stride = (self.data.len() / PLACES).max(1);
        let rows = (0..self.data.len()).step_by(stride);
        let places: Vec<[f32; 2]> = rows.map(|row| self.data.place(row)).collect();
        let mut latents = vec![];
        encoder.encode(places.iter().copied(), &mut latents);
        let error: f32 = places
            .iter()
            .zip(encoder.decode(&latents))
            .map(|(place, back)| (place[0] - back[0]).hypot(place[1] - back[1]))
            .sum();
        let mean = error / places.len().max(1) as f32;
        metrics.add("encoder/place_error_m", self.updates(), mean);
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            update: self.update,
            rng: self.rng.clone(),
            vae: self.vae.state(),
            sums: self.sums,
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }
}

/// Mean and standard deviation of the places (m).
fn moments(data: &Dataset) -> ([f32; 2], [f32; 2]) {
    let n = data.len().max(1) as f64;
    let (mut sum, mut squares) = ([0.0_f64; 2], [0.0_f64; 2]);
    for row in 0..data.len() {
        for (axis, value) in data.place(row).into_iter().enumerate() {
            sum[axis] += f64::from(value);
            squares[axis] += f64::from(value) * f64::from(value);
        }
    }
    let mean = sum.map(|sum| sum / n);
    let std = [0, 1].map(|axis| {
        (squares[axis] / n - mean[axis] * mean[axis])
            .max(0.0)
            .sqrt()
            // Data on a line have no spread across it.
            .max(1e-3)
    });
    (
        mean.map(|value| value as f32),
        std.map(|value| value as f32),
    )
}
