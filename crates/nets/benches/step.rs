//! Time of a training step (forward, backward, Adam) of 64-256-256-256-8 with GELU and layer norm
//! at 256 samples, one thread: `cargo bench -p nets`.

use std::time::Instant;

use nets::{Activation, Adam, Mlp};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const BATCH: usize = 256;
const STEPS: usize = 500;

fn main() {
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let mlp = Mlp::new(&[64, 256, 256, 256, 8], Activation::Gelu, true);
    let mut parameters = mlp.init(&mut rng, 1.0);
    let mut adam = Adam::new(mlp.parameters(), 3e-4);
    let mut workspace = mlp.workspace(BATCH);
    let input: Vec<f32> = (0..BATCH * 64)
        .map(|_| rng.random_range(-1.0..1.0))
        .collect();
    let target: Vec<f32> = (0..BATCH * 8)
        .map(|_| rng.random_range(-1.0..1.0))
        .collect();
    let mut slope = vec![0.0; BATCH * 8];
    let mut gradient = vec![0.0; mlp.parameters()];
    let mut milliseconds = Vec::with_capacity(STEPS);
    for _ in 0..STEPS {
        let start = Instant::now();
        let out = mlp.forward(&parameters, &input, BATCH, &mut workspace);
        for ((slope, out), target) in slope.iter_mut().zip(out).zip(&target) {
            *slope = (out - target) / BATCH as f32;
        }
        gradient.fill(0.0);
        mlp.backward(
            &parameters,
            &input,
            BATCH,
            &mut workspace,
            &slope,
            &mut gradient,
            None,
        );
        adam.step(&mut parameters, &gradient);
        milliseconds.push(start.elapsed().as_secs_f64() * 1e3);
    }
    milliseconds.sort_by(f64::total_cmp);
    println!(
        "64-256x3-8 layer norm, batch {BATCH}: {:.3} ms a step (median), {:.3} ms least, of {STEPS}",
        milliseconds[STEPS / 2],
        milliseconds[0]
    );
}
