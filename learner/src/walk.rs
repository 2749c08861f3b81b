//! Online PPO of the walker.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use agents::ppo::{End, Settings};
use agents::walker::{Batch, Learner};
use anyhow::Context;
use config::Config;
use maze::Egocentric;
use nets::file;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use wire::{
    Bus, DirectiveSubscriber, Metric, Module, Phase, Reader, Reporter, Role, State, Status,
    TrajectoryReceiver, Transition, WeightsPublisher, flags,
};

use crate::save::Keeper;

/// Adds a record of steps and its final row to the batch; a record without one is not whole and
/// is left out.
fn add(batch: &mut Batch, record: &[Transition]) {
    let Some((last, steps)) = record.split_last() else {
        return;
    };
    if !last.has(flags::FINAL) || steps.is_empty() {
        return;
    }
    for step in steps {
        let frame = Egocentric::new(&step.observation, step.goal);
        batch.features.extend_from_slice(&frame.features);
        batch
            .actions
            .extend_from_slice(&frame.from_actuators(&step.action));
        batch.log_probs.push(step.log_prob);
        batch.rewards.push(step.reward);
        batch.ends.push(if step.has(flags::TERMINAL) {
            End::Terminal
        } else if step.has(flags::TRUNCATED) {
            End::Truncated
        } else {
            End::Not
        });
    }
    // Where the record ends for no other reason, the state after it stands for what follows.
    if let Some(end) = batch.ends.last_mut().filter(|end| **end == End::Not) {
        *end = End::Truncated;
    }
    let frame = Egocentric::new(&last.observation, last.goal);
    batch.final_features.extend_from_slice(&frame.features);
    batch.records.push(steps.len());
}

/// Metres a second towards the direction, from a record's first to its last step.
fn speed(record: &[Transition]) -> (f64, usize) {
    let steps = record.windows(2).map(|pair| {
        let (a, b) = (&pair[0].observation, &pair[1].observation);
        let goal = pair[0].goal;
        f64::from((b[0] - a[0]) * goal[0] + (b[1] - a[1]) * goal[1])
    });
    (
        steps.sum::<f64>() / f64::from(maze::CONTROL_SECONDS),
        record.len().saturating_sub(1),
    )
}

fn save(learner: &Learner, config: &Config, path: &Path) -> anyhow::Result<()> {
    let mlp = learner.policy().mlp();
    let hidden: Vec<String> = config
        .walker
        .hidden
        .iter()
        .map(ToString::to_string)
        .collect();
    let metadata = BTreeMap::from([
        ("kind".to_owned(), "formica walker".to_owned()),
        ("hidden".to_owned(), hidden.join(",")),
        ("config".to_owned(), config.hash()),
    ]);
    let mut tensors = mlp.tensors("policy", &learner.weights()[..mlp.parameters()]);
    let log_std = learner.policy().log_std(learner.weights());
    tensors.push(("log_std".to_owned(), vec![log_std.len()], log_std));
    file::save(path, &tensors, &metadata)?;
    Ok(())
}

/// Where the training is.
#[derive(Serialize, Deserialize)]
struct Kept {
    version: u64,
    steps: u64,
    rng: Pcg64Mcg,
    learner: agents::actor_critic::State,
}

fn keep(keeper: &mut Keeper, version: u64, steps: u64, rng: &Pcg64Mcg, learner: &Learner) {
    let kept = Kept {
        version,
        steps,
        rng: rng.clone(),
        learner: learner.state(),
    };
    keeper.keep(version, 0, &kept);
}

pub(crate) fn run(
    config: &Config,
    folder: &Path,
    bus: &Bus,
    stopped: &dyn Fn() -> bool,
) -> anyhow::Result<()> {
    let w = &config.walker;
    let settings = Settings {
        epochs: w.epochs,
        minibatch: w.minibatch,
        clip: w.clip as f32,
        entropy: w.entropy as f32,
        value_loss: 0.5,
        max_gradient_norm: 0.5,
        discount: w.discount as f32,
        gae_lambda: w.gae_lambda as f32,
        target_kl: Some(w.target_kl as f32),
    };
    let mut rng = Pcg64Mcg::seed_from_u64(config.run.seed);
    let rate = w.learning_rate as f32;
    let mut learner = Learner::new(
        &w.hidden,
        w.initial_log_std as f32,
        rate,
        settings,
        &mut rng,
    );

    if !w.start.is_empty() {
        let file = file::ParameterFile::load(Path::new(&w.start))?;
        let mut start = learner.policy().mlp().from_tensors("policy", &file)?;
        start.extend(file.tensor("log_std", &[maze::ACTION])?);
        anyhow::ensure!(
            learner.set_weights(start),
            "{} holds another policy",
            w.start
        );
    }

    let reporter = Reporter::new(bus)?;
    let mut directives = DirectiveSubscriber::new(bus)?;
    let mut receiver = TrajectoryReceiver::new(bus, Reader::Learner, folder)?;
    let publisher = WeightsPublisher::new(bus, Module::Walker)?;
    let shape = learner.policy().mlp().shape_hash();
    let mut status = Status {
        role: Role::Learner as u32,
        ..Status::default()
    };
    status.state = State::Working as u32;
    status.set_text("PPO of the walker");
    let (mut keeper, kept) = Keeper::open::<Kept>(folder, "walker", config, u32::MAX);
    let mut version = 1;
    let mut steps = 0_u64;
    if let Some(kept) = kept
        && learner.restore(kept.learner)
    {
        (version, steps, rng) = (kept.version, kept.steps, kept.rng);
    }
    publisher.publish(version, shape, learner.weights())?;

    let checkpoint = folder.join("checkpoints").join("walker.safetensors");
    let mut batch = Batch::default();
    let (mut metres, mut seconds, mut falls, mut lag) = (0.0, 0_usize, 0_u64, 0.0);
    let mut stale = 0_u64;
    let total = w.steps as u64;
    let mut pulse = Instant::now();
    while !stopped() {
        let phase = directives.latest().phase();
        receiver.receive(64, |header, record| {
            let age = version.saturating_sub(header.weights_version);
            if age > config.topology.max_policy_lag as u64 {
                stale += 1;
                return;
            }
            lag += age as f64;
            add(&mut batch, record);
            let (distance, count) = speed(record);
            metres += distance;
            seconds += count;
            falls += record.iter().filter(|step| step.has(flags::FELL)).count() as u64;
        });
        receiver.acknowledge();
        publisher.keep_alive();
        if batch.len() >= w.batch && steps < total {
            steps += batch.len() as u64;
            let left = 1.0 - steps as f32 / total as f32;
            learner.set_learning_rate(rate * left.max(0.1));
            let report = learner.update(&batch, &mut rng);
            version += 1;
            publisher.publish(version, shape, learner.weights())?;
            let per_thousand = 1000.0 * falls as f64 / batch.len() as f64;
            let speed = metres / seconds.max(1) as f64;
            for (name, value) in [
                ("walker/speed_m_s", speed),
                ("walker/falls_per_1000_steps", per_thousand),
                (
                    "walker/reward",
                    f64::from(batch.rewards.iter().sum::<f32>()) / batch.len() as f64,
                ),
                ("walker/kl", f64::from(report.kl)),
                ("walker/clip_fraction", f64::from(report.clip_fraction)),
                ("walker/entropy", f64::from(report.entropy)),
                ("walker/value_loss", f64::from(report.value_loss)),
                (
                    "rollout/policy_lag",
                    lag / batch.records.len().max(1) as f64,
                ),
                ("rollout/stale_trajectories", stale as f64),
            ] {
                reporter.metric(&Metric::new(Role::Learner, 0, name, steps, value));
            }
            status.set_text(&format!(
                "walker {speed:.2} m/s, {per_thousand:.2} falls/1000"
            ));
            (metres, seconds, falls, lag) = (0.0, 0, 0, 0.0);
            batch.clear();
            if keeper.is_due() || steps >= total {
                keep(&mut keeper, version, steps, &rng, &learner);
                save(&learner, config, &checkpoint)?;
            }
        } else {
            receiver.wait(Duration::from_millis(50));
        }
        if batch.len() >= w.batch {
            batch.clear(); // Trained: what still comes is only counted.
        }
        if phase == Phase::Finish && receiver.all_left() {
            break;
        }
        if pulse.elapsed() > Duration::from_millis(500) {
            status.state = if steps >= total {
                State::Trained
            } else {
                State::Working
            } as u32;
            receiver.report(&mut status);
            status.updates = version - 1;
            status.versions[0] = version;
            status.progress = [steps, total];
            reporter.status(&status);
            pulse = Instant::now();
        }
    }
    keep(&mut keeper, version, steps, &rng, &learner);
    save(&learner, config, &checkpoint)?;
    if steps >= total && !w.output.is_empty() {
        let output = Path::new(&w.output);
        save(&learner, config, output).with_context(|| format!("writing {}", output.display()))?;
    }
    status.state = State::Finished as u32;
    receiver.report(&mut status);
    reporter.status(&status);
    Ok(())
}
