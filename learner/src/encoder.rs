//! Stage 1 on a thread: the latent encoder.

use std::path::Path;
use std::time::Instant;

use agents::vae::{self, Encoder, Settings, Shape, Vae};
use config::{Config, Latent};
use dataset::{Dataset, Starts};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::offline::{News, Post};
use crate::save;

/// Updates between two reports.
const REPORT: usize = 500;

/// Where the stage is.
#[derive(Serialize, Deserialize)]
struct State {
    update: usize,
    rng: Pcg64Mcg,
    vae: vae::State,
    sums: [f32; 2],
    seconds: f32,
}

pub(crate) fn train(config: &Config, data: &Dataset, post: &Post<'_>) -> anyhow::Result<()> {
    let start = Instant::now();
    let e = &config.encoder;
    if e.kind == Latent::Place {
        let (mean, std) = moments(data);
        post.send(News::Encoder([mean, std].concat()));
        return Ok(());
    }
    if let Some(path) = &e.from {
        let shape = Shape::new(e.latent, &e.hidden);
        let weights = save::load(Path::new(path), shape.weights())?;
        post.send(News::Encoder(weights));
        return Ok(());
    }
    let settings = Settings {
        latent: e.latent,
        hidden: e.hidden.clone(),
        beta: e.beta as f32,
        prior_balance: e.prior_balance as f32,
        null_condition: e.null_condition as f32,
        learning_rate: e.learning_rate as f32,
        batch: e.batch,
    };
    let mut rng = Pcg64Mcg::seed_from_u64(config.run.seed + 11);
    let Some(starts) = Starts::new(&data.episodes, e.lag) else {
        anyhow::bail!(
            "no episode of the data set is longer than encoder.lag = {} steps",
            e.lag
        );
    };
    let (mean, std) = moments(data);
    let mut vae = Vae::new(settings, mean, std, &mut rng);
    let mut pairs = Vec::with_capacity(e.batch);
    let (mut reconstruction, mut kl) = (0.0, 0.0);
    let (mut keeper, state) = post.keeper::<State>("encoder", config);
    let (mut first, mut earlier) = (1, 0.0);
    if let Some(state) = state
        && vae.restore(state.vae)
    {
        (first, rng, earlier) = (state.update + 1, state.rng, state.seconds);
        [reconstruction, kl] = state.sums;
    }
    let state = |update, rng: &Pcg64Mcg, vae: &Vae, sums| State {
        update,
        rng: rng.clone(),
        vae: vae.state(),
        sums,
        seconds: earlier + start.elapsed().as_secs_f32(),
    };
    for update in first..=e.updates {
        if post.stopped() || keeper.is_due() {
            let done = update - 1;
            let state = state(done, &rng, &vae, [reconstruction, kl]);
            keeper.keep(done as u64, 0, &state);
        }
        if post.stopped() {
            return Ok(());
        }
        pairs.clear();
        for _ in 0..e.batch {
            let (row, _) = starts.draw(&mut rng);
            pairs.push((data.place(row), data.place(row + e.lag)));
        }
        let losses = vae.update(&pairs, &mut rng);
        reconstruction += losses.reconstruction;
        kl += losses.kl;
        if update % REPORT == 0 || update == e.updates {
            let step = update as u64;
            let n = ((update - 1) % REPORT + 1) as f32;
            post.metric("encoder/reconstruction", step, reconstruction / n);
            post.metric("encoder/kl_nats", step, kl / n);
            post.progress("encoder", step, e.updates as u64);
            (reconstruction, kl) = (0.0, 0.0);
        }
    }
    if first <= e.updates {
        let state = state(e.updates, &rng, &vae, [reconstruction, kl]);
        keeper.keep(e.updates as u64, 0, &state);
    }
    // How well places come back from their own codes.
    let shape = vae.shape().clone();
    if let Some(mut encoder) = Encoder::new(shape, &vae.weights) {
        let stride = (data.len() / 2000).max(1);
        let places: Vec<[f32; 2]> = (0..data.len())
            .step_by(stride)
            .map(|row| data.place(row))
            .collect();
        let mut latents = vec![];
        encoder.encode(places.iter().copied(), &mut latents);
        let error: f32 = places
            .iter()
            .zip(encoder.decode(&latents))
            .map(|(place, back)| (place[0] - back[0]).hypot(place[1] - back[1]))
            .sum();
        let step = e.updates as u64;
        post.metric(
            "encoder/place_error_m",
            step,
            error / places.len().max(1) as f32,
        );
    }
    post.metric(
        "time/encoder_s",
        e.updates as u64,
        earlier + start.elapsed().as_secs_f32(),
    );
    post.send(News::Encoder(vae.weights));
    Ok(())
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
