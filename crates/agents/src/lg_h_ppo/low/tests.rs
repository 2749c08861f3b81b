//! The low level learns, and resumes.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use maze::AntBody;

use super::*;

#[test]
fn a_training_goes_on_from_its_state_as_if_nothing_had_been() {
    let settings = |hidden| Settings {
        hidden,
        learning_rate: 1e-3,
        batch: 8,
        expectile: 0.7,
        discount: 0.95,
        inverse_temperature: 3.0,
        weight_clip: 100.0,
        target_rate: 0.02,
        updates: 1,
        snap: 0.0,
        slack: 0,
        controller: Controller::Learned,
        from: None,
    };
    let fresh = |hidden| {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        Low::new(&AntBody, 2, 0.5, settings(hidden), &mut rng)
    };
    let train = |low: &mut Low| {
        for update in 0..3 {
            let mut observation = [0.1 * update as f32; 29];
            observation[3] = 1.0;
            let sample = Sample {
                observation: &observation,
                action: &[0.5; 8],
                next: &observation,
                latent: &[0.0; 2],
                subgoal: Subgoal {
                    place: [1.0, 2.0],
                    latent: &[0.5, -0.5],
                },
                value_goal: [3.0, 0.0],
            };
            low.update(&[sample; 8]);
        }
    };
    let mut low = fresh(vec![16, 16]);
    train(&mut low);
    let state = low.state();
    train(&mut low);
    let mut again = fresh(vec![16, 16]);
    assert!(again.restore(state.clone()));
    train(&mut again);
    assert_eq!(again.state(), low.state());
    assert!(!fresh(vec![16, 8]).restore(state), "of other networks");
}

/// A toy ant that slides: its first actuator is its speed along x. Rows where it goes towards
/// the goal and away from it are equally many; the policy must take after the former.
#[test]
fn the_policy_prefers_actions_that_approach_the_subgoal() {
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let settings = Settings {
        hidden: vec![32, 32],
        learning_rate: 1e-3,
        batch: 64,
        expectile: 0.7,
        discount: 0.95,
        inverse_temperature: 3.0,
        weight_clip: 100.0,
        target_rate: 0.02,
        updates: 1,
        snap: 0.0,
        slack: 0,
        controller: Controller::Learned,
        from: None,
    };
    let mut low = Low::new(&AntBody, 2, 0.5, settings, &mut rng);
    let mut policy_error = (0.0, 0.0);
    for update in 0..3000 {
        let rows: Vec<_> = (0..64)
            .map(|_| {
                let mut observation = [0.0_f32; 29];
                observation[3] = 1.0;
                observation[0] = rng.random_range(-3.0..3.0);
                let speed = if rng.random::<bool>() { 1.0 } else { -1.0_f32 };
                let mut next = observation;
                next[0] += 0.4 * speed;
                let mut action = [0.0; 8];
                action[0] = speed;
                let goal = [observation[0] + rng.random_range(1.0..3.0), 0.0];
                (observation, action, next, goal)
            })
            .collect();
        let samples: Vec<Sample<'_>> = rows
            .iter()
            .map(|(observation, action, next, goal)| Sample {
                observation,
                action,
                next,
                latent: &[0.0, 0.0],
                subgoal: Subgoal {
                    place: *goal,
                    latent: &[1.0, 0.0],
                },
                value_goal: *goal,
            })
            .collect();
        low.update(&samples);
        if update >= 2900 {
            let policy = low.policy().clone();
            let mut workspace = policy.mlp().workspace(1);
            let mut input = vec![];
            let s = &samples[0];
            let frame = policy.input(s.observation, s.latent, s.subgoal, &mut input);
            let mean = policy.act(&low.weights, &input, 1, &mut workspace);
            let mut action = [0.0; 8];
            AntBody.to_actuators(frame, mean, &mut action);
            policy_error.0 += action[0];
            policy_error.1 += 1.0;
        }
    }
    let speed = policy_error.0 / policy_error.1;
    assert!(
        speed > 0.3,
        "the mean speed towards the goal is {speed}; the data's is 0"
    );
}

/// Gradients of policy and value against central differences of the reported losses. With steps and
/// rates of 0 an update changes nothing.
#[test]
fn gradients_are_finite_differences() {
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let settings = Settings {
        hidden: vec![6],
        learning_rate: 0.0,
        batch: 5,
        expectile: 0.7,
        discount: 0.95,
        inverse_temperature: 3.0,
        weight_clip: 100.0,
        target_rate: 0.0,
        updates: 1,
        snap: 0.0,
        slack: 0,
        controller: Controller::Learned,
        from: None,
    };
    let mut low = Low::new(&AntBody, 2, 0.5, settings, &mut rng);
    for weight in &mut low.weights {
        *weight += 0.2 * rng.random_range(-1.0..1.0_f32);
    }
    let mut random =
        |n: usize| -> Vec<f32> { (0..n).map(|_| rng.random_range(-1.0..1.0)).collect() };
    let rows: Vec<[Vec<f32>; 4]> = (0..5)
        .map(|_| {
            let mut observation = random(29);
            observation[3] = 1.0;
            let mut next = observation.clone();
            next[0] += 0.2;
            [observation, next, random(8), random(6)]
        })
        .collect();
    let samples: Vec<Sample<'_>> = rows
        .iter()
        .map(|[observation, next, action, goals]| Sample {
            observation,
            action,
            next,
            latent: &goals[..2],
            subgoal: Subgoal {
                place: [2.0 + goals[2], goals[3]],
                latent: &goals[2..4],
            },
            value_goal: [3.0 * goals[4], goals[5]],
        })
        .collect();
    low.update(&samples);
    let (policy, value) = (
        low.scratch.policy_gradient.clone(),
        low.scratch.value_gradient.clone(),
    );
    let close = |numeric: f32, gradient: f32, what: &str| {
        let limit = 4e-3 * (1.0 + gradient.abs());
        assert!(
            (numeric - gradient).abs() < limit,
            "{what}: {numeric} {gradient}"
        );
    };
    let step = 1e-2;
    for at in (0..policy.len()).step_by(5) {
        let mut loss = |offset: f32| {
            let before = low.weights[at];
            low.weights[at] += offset;
            let loss = low.update(&samples).policy_loss;
            low.weights[at] = before;
            loss
        };
        let numeric = (loss(step) - loss(-step)) / (2.0 * step);
        close(numeric, policy[at], "policy");
    }
    for at in (0..value.len()).step_by(3) {
        let mut loss = |offset: f32| {
            let before = low.values[1][at];
            low.values[1][at] += offset;
            // The mean of both values' losses is reported, their sum is descended.
            let loss = 2.0 * low.update(&samples).value_loss;
            low.values[1][at] = before;
            loss
        };
        let numeric = (loss(step) - loss(-step)) / (2.0 * step);
        close(numeric, value[at], "value");
    }
}
