//! Losses, gradients and codes of the encoder.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::*;

fn settings() -> Settings {
    Settings {
        kind: Latent::Vae,
        lag: 15,
        updates: 1,
        from: None,
        latent: 4,
        hidden: vec![32, 32],
        beta: 0.01,
        prior_balance: 0.8,
        null_condition: 0.5,
        learning_rate: 2e-3,
        batch: 128,
    }
}

#[test]
fn a_training_goes_on_from_its_state_as_if_nothing_had_been() {
    let train = |vae: &mut Vae, rng: &mut Pcg64Mcg| {
        for _ in 0..3 {
            let pairs = pairs(rng, 16);
            vae.update(&pairs, rng);
        }
    };
    let fresh = |settings| {
        Vae::new(
            settings,
            [0.0; 2],
            [4.0; 2],
            &mut Pcg64Mcg::seed_from_u64(3),
        )
    };
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let mut vae = fresh(settings());
    train(&mut vae, &mut rng);
    let (state, at) = (vae.state(), rng.clone());
    train(&mut vae, &mut rng);
    let mut again = fresh(settings());
    assert!(again.restore(state.clone()));
    train(&mut again, &mut at.clone());
    assert_eq!(again.weights, vae.weights);
    let mut other = fresh(Settings {
        hidden: vec![8],
        ..settings()
    });
    assert!(!other.restore(state), "of other networks");
}

fn pairs(rng: &mut Pcg64Mcg, n: usize) -> Vec<([f32; 2], [f32; 2])> {
    (0..n)
        .map(|_| {
            let from = [rng.random_range(-8.0..8.0), rng.random_range(-8.0..8.0_f32)];
            (
                from,
                from.map(|axis| axis + rng.random_range(-2.0..2.0_f32)),
            )
        })
        .collect()
}

/// Without the KL's split between posterior and prior (kappa = 1/2 gives both half of it)
/// the gradient is that of reconstruction + beta KL.
#[test]
fn the_oracles_latents_are_places() {
    let mut encoder = Encoder::new(Shape::new(2, &[]), &[1.0, 2.0, 2.0, 4.0]).unwrap();
    assert_eq!(encoder.encode_one([3.0, 10.0]), [1.0, 2.0]);
    assert_eq!(encoder.decode(&[1.0, 2.0]), [[3.0, 10.0]]);
}

#[test]
fn gradient_matches_finite_differences() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let mut vae = Vae::new(settings(), [0.0; 2], [5.0; 2], &mut rng);
    vae.settings.prior_balance = 0.5;
    vae.settings.beta = 0.7;
    let pairs = pairs(&mut rng, 16);
    vae.scratch.null = vec![false; 16];
    vae.scratch.noise = (0..64).map(|_| rng.random_range(-1.0..1.0)).collect();
    vae.gradient.fill(0.0);
    vae.losses(&pairs);
    let gradient = vae.gradient.clone();
    let ends = vae.shape.ends();
    let objective = |vae: &mut Vae, kl: f32| {
        vae.gradient.fill(0.0);
        let losses = vae.losses(&pairs);
        f64::from(losses.reconstruction) + f64::from(kl * losses.kl)
    };
    // Posterior and prior see half of the KL, the decoder none.
    for (range, kl) in [
        (0..ends[0], 0.5 * 0.7),
        (ends[0]..ends[1], 0.0),
        (ends[1]..ends[2], 0.5 * 0.7),
    ] {
        let direction: Vec<f32> = range
            .clone()
            .map(|_| rng.random_range(-1.0..1.0_f32))
            .collect();
        let analytic: f64 = range
            .clone()
            .zip(&direction)
            .map(|(i, d)| f64::from(gradient[i]) * f64::from(*d))
            .sum();
        let step = 2e-3;
        let mut shifted = |sign: f32| {
            let before = vae.weights.clone();
            for (i, d) in range.clone().zip(&direction) {
                vae.weights[2 * PLACE + i] += sign * step * d;
            }
            let value = objective(&mut vae, kl);
            vae.weights = before;
            value
        };
        let numeric = (shifted(1.0) - shifted(-1.0)) / f64::from(2.0 * step);
        let error = (numeric - analytic).abs() / analytic.abs().max(0.05);
        assert!(error < 0.03, "{range:?}: {analytic} against {numeric}");
    }
}

#[test]
fn codes_of_places_decode_to_the_places() {
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let mut vae = Vae::new(settings(), [0.0; 2], [5.0; 2], &mut rng);
    for _ in 0..1500 {
        let batch = pairs(&mut rng, 128);
        vae.update(&batch, &mut rng);
    }
    let mut encoder = Encoder::new(vae.shape().clone(), &vae.weights).unwrap();
    let places: Vec<[f32; 2]> = pairs(&mut rng, 100).into_iter().map(|p| p.0).collect();
    let mut latents = vec![];
    encoder.encode(places.iter().copied(), &mut latents);
    let decoded = encoder.decode(&latents);
    let error = places
        .iter()
        .zip(&decoded)
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .sum::<f32>()
        / 100.0;
    assert!(error < 1.0, "mean error {error} m");
}
