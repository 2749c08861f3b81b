//! Simulates a trace's actions again and compares every state bit by bit.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use maze::{AntSimulator, OBSERVATION, Start};
use simulator::{Simulator, Values};
use trace::Trace;

use crate::{story, traces};

/// What a replay found.
#[derive(Debug, PartialEq)]
enum Found {
    /// So many states are the same.
    Same(usize),
    /// The first step whose state differs, how many values a state has, and those that differ: index,
    /// as recorded, now.
    Differs(u32, usize, Vec<(usize, f32, f32)>),
}

/// `formica replay TRACE`: exit code 1 where a state differs or a trace cannot be simulated, 3 where
/// all of a trace that is there is the same, and the rest of it cut off or damaged.
pub(crate) fn run(given: &Path) -> anyhow::Result<ExitCode> {
    let paths = traces::all(&[given.to_path_buf()])?;
    let [path] = &*paths else {
        return Ok(several(&paths));
    };
    let trace = trace::read(path)?;
    let code = one(trace).with_context(|| path.display().to_string())?;
    Ok(ExitCode::from(code))
}

/// Each by itself: one that cannot be simulated does not keep the others from it.
fn several(paths: &[PathBuf]) -> ExitCode {
    let codes = paths.iter().map(|path| {
        say!("{}", path.display());
        let code = trace::read(path).map_err(Into::into).and_then(one);
        code.unwrap_or_else(|error: anyhow::Error| {
            say!("it cannot be simulated: {error:#}");
            1
        })
    });
    ExitCode::from(worst(codes))
}

/// Failure before what is cut off, and that before success.
pub(crate) fn worst(codes: impl IntoIterator<Item = u8>) -> u8 {
    let worse = |a: u8, b: u8| if a == 1 || b == 1 { 1 } else { a.max(b) };
    codes.into_iter().fold(0, worse)
}

/// Simulates a trace and tells what was found; the exit code.
fn one(mut trace: Trace) -> anyhow::Result<u8> {
    if let Some(reason) = &trace.cut {
        say!("the trace is cut off: {reason}");
    }
    for reason in &trace.damage {
        say!("the trace is damaged: {reason}");
    }
    let version = &*trace.meta.version;
    match version {
        env!("CARGO_PKG_VERSION") => {}
        "" => say!("the trace does not say which version of formica wrote it"),
        _ => say!("the trace is of formica {version}, whose physics may differ"),
    }
    let lost = leave_out(&mut trace);
    let partial = !trace.is_whole() || lost.is_some();
    if trace.steps.is_empty() && trace.end.is_none() {
        ensure!(partial, "it holds no step to compare");
        say!("no step is left to compare");
        return Ok(3);
    }
    match replay(&trace)? {
        Found::Same(states) => {
            let actions = trace.steps.len();
            say!("{states} states after {actions} actions are the same bit for bit");
            if let Some(lost) = lost {
                say!("{lost}");
            }
            Ok(if partial { 3 } else { 0 })
        }
        Found::Differs(step, width, values) => {
            let all = values.len();
            say!("step {step} is the first that differs, in {all} of {width} values:");
            for (index, recorded, now) in values {
                say!(
                    "  observation[{index}]: {}, {} now",
                    told(recorded),
                    told(now)
                );
            }
            say!(
                "it was recorded by another version of the physics, or on a processor of another \
                 kind, or its values were changed"
            );
            Ok(1)
        }
    }
}

/// A value of a trace, whatever it is.
fn told(value: f32) -> String {
    let bits = value.to_bits();
    match value {
        // Told apart from a zero without a sign, which has other bits.
        0.0 if value.is_sign_negative() => format!("0.0 (bits {bits:08x})"),
        _ if value.is_finite() => format!("{value:?}"),
        _ => format!("no number (bits {bits:08x})"),
    }
}

/// Of a trace that lost steps, leaves out what comes behind them: nothing is known of how the ant
/// got there. What is left out.
fn leave_out(trace: &mut Trace) -> Option<String> {
    if trace.is_whole() && trace.recovered.is_none() {
        return None;
    }
    let in_order = (0..).zip(&trace.steps);
    let kept = in_order.take_while(|(i, step)| *i == step.step).count();
    let rest = trace.steps.len() > kept;
    // The end is that of all steps.
    let ends = |end: &trace::End| end.steps as usize == kept;
    if !rest && trace.end.as_ref().is_none_or(ends) {
        return None;
    }
    trace.steps.truncate(kept);
    trace.end = None;
    Some(format!(
        "step {kept} is missing, and what comes after it is not compared"
    ))
}

/// The simulator of a trace, at its start.
fn simulator_of(trace: &Trace) -> anyhow::Result<Box<dyn Simulator>> {
    let layout = story::layout(trace)?;
    let name = trace.meta.simulator();
    let simulator = simulators::create(name, &layout, trace.meta.success_radius);
    let mut simulator = simulator.with_context(|| {
        let name = name.escape_debug();
        format!("this version of formica has no simulator '{name}'")
    })?;
    let start = trace.start.as_ref().context(
        "it does not say how the ant was set at the start; traces of formica 0.1.0 and later do",
    )?;
    let state = match start.simulator_state.is_empty() {
        false => start.simulator_state.clone(),
        // As the ant was recorded before there were other simulators.
        true if !start.state.is_empty() => {
            let observation: [f32; OBSERVATION] = (start.state.as_slice().try_into())
                .context("its start has not the 29 values of an ant")?;
            let exits = start.exits;
            AntSimulator::state_of(&Start { observation, exits }, trace.meta.goal)
        }
        true => anyhow::bail!("its simulator could not save its state at the start"),
    };
    simulator.restore(&state).context("its start")?;
    Ok(simulator)
}

fn replay(trace: &Trace) -> anyhow::Result<Found> {
    let mut simulator = simulator_of(trace)?;
    let spaces = simulator.body().spaces();
    let (observation, action) = (spaces.observation.len(), spaces.action.len());
    for (expected, step) in (0..).zip(&trace.steps) {
        ensure!(
            step.step == expected,
            "it has step {} where {expected} belongs",
            step.step
        );
        let told = || format!("its step {expected} has not {observation} values and {action}");
        let recorded = (&*step.observation, &*step.observation_bytes);
        let found = compare(expected, recorded, &*simulator).with_context(told)?;
        if let Some(found) = found {
            return Ok(found);
        }
        ensure!(step.action.len() == action, told());
        ensure!(
            step.action.iter().all(|value| value.is_finite()),
            "its step {expected} has an action that is no number"
        );
        simulator.step(&step.action);
    }
    let steps = trace.steps.len();
    let Some(end) = &trace.end else {
        return Ok(Found::Same(steps));
    };
    let told = || format!("its end has not {observation} values");
    let recorded = (&*end.observation, &*end.observation_bytes);
    let found = compare(steps as u32, recorded, &*simulator).with_context(told)?;
    Ok(found.unwrap_or(Found::Same(steps + 1)))
}

/// `Some(None)` where all bits are the same; none where the shape is not the simulator's.
fn compare(
    step: u32,
    (floats, bytes): (&[f32], &[u8]),
    simulator: &dyn Simulator,
) -> Option<Option<Found>> {
    let (width, values) = match simulator.observation() {
        Values::F32(now) => {
            let pairs = floats.iter().zip(now).enumerate();
            let differ = pairs.filter(|(_, (a, b))| a.to_bits() != b.to_bits());
            let values: Vec<_> = differ.map(|(i, (a, b))| (i, *a, *b)).collect();
            ((floats.len() == now.len()).then_some(now.len())?, values)
        }
        Values::U8(now) => {
            let differ = bytes
                .iter()
                .zip(now)
                .enumerate()
                .filter(|(_, (a, b))| a != b);
            let values = differ.map(|(i, (a, b))| (i, f32::from(*a), f32::from(*b)));
            (
                (bytes.len() == now.len()).then_some(now.len())?,
                values.collect(),
            )
        }
    };
    Some((!values.is_empty()).then_some(Found::Differs(step, width, values)))
}

#[cfg(test)]
mod tests {
    use maze::{AntMaze, Layout, Physics};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use trace::{End, Step};

    use super::*;

    /// An episode of random actions, as an actor would record it.
    fn recorded(name: &str) -> Trace {
        let layout = Layout::named(name).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut ant = AntMaze::new(&layout, Physics::MAZE);
        let place = match layout.inlets().first() {
            Some(inlet) => {
                let [x, y] = layout.centre(*inlet);
                [x + 1.6, y]
            }
            None => [0.0, 0.0],
        };
        let start = ant.reset(place, &mut rng);
        let mut trace = Trace::default();
        trace.meta.config_toml = format!("[maze]\nlayout = \"{name}\"\n");
        trace.start = Some(trace::Start {
            state: start.observation.to_vec(),
            exits: start.exits,
            ..trace::Start::default()
        });
        for step in 0..60 {
            // Beyond what actuators take, as noisy actions are.
            let action: [f32; 8] = std::array::from_fn(|_| rng.random_range(-1.5..=1.5));
            trace.steps.push(Step {
                step,
                observation: ant.observation().to_vec(),
                action: action.to_vec(),
                ..Step::default()
            });
            ant.step(&action);
        }
        trace.end = Some(End {
            steps: 60,
            observation: ant.observation().to_vec(),
            ..End::default()
        });
        trace
    }

    #[test]
    fn a_recorded_episode_is_the_same_again_and_any_other_bit_is_seen() {
        for maze in ["medium", "teleport"] {
            let mut trace = recorded(maze);
            assert_eq!(replay(&trace).unwrap(), Found::Same(61));
            let value = trace.steps[40].observation[3];
            trace.steps[40].observation[3] = f32::from_bits(value.to_bits() ^ 1);
            let Found::Differs(40, 29, values) = replay(&trace).unwrap() else {
                panic!("the bit at step 40 was not seen");
            };
            assert_eq!(values.len(), 1);
            // Another action shows at the step after it.
            trace.steps[10].action[0] = 0.0;
            assert!(matches!(replay(&trace).unwrap(), Found::Differs(11, ..)));
        }
    }

    #[test]
    fn an_episode_of_any_simulator_is_the_same_again() {
        let layout = Layout::named("teleport").unwrap();
        for name in simulators::names() {
            let mut simulator = simulators::create(name, &layout, 0.5).unwrap();
            let mut rng = Pcg64Mcg::seed_from_u64(5);
            let task = simulator.draw(simulator::Tasks::Training, &mut rng);
            simulator.reset(&task, &mut rng);
            let mut trace = Trace::default();
            trace.meta.simulator = name.to_owned();
            trace.meta.config_toml = "[maze]\nlayout = \"teleport\"\n".to_owned();
            trace.start = Some(trace::Start {
                simulator_state: simulator.state().unwrap(),
                ..trace::Start::default()
            });
            let width = simulator.body().spaces().action.len();
            for step in 0..50 {
                let action: Vec<f32> = (0..width).map(|_| rng.random_range(-1.5..=1.5)).collect();
                trace.steps.push(Step {
                    step,
                    observation: simulator.observation().floats().unwrap().to_vec(),
                    action: action.clone(),
                    ..Step::default()
                });
                simulator.step(&action);
            }
            assert_eq!(replay(&trace).unwrap(), Found::Same(50), "{name}");
            trace.steps[0].action[0] = 0.0;
            assert!(matches!(replay(&trace).unwrap(), Found::Differs(1, ..)));
            trace.start = Some(trace::Start::default());
            assert!(replay(&trace).is_err(), "no state was saved");
            trace.meta.simulator = "flea".to_owned();
            assert!(replay(&trace).is_err());
        }
    }

    #[test]
    fn of_a_damaged_trace_what_is_before_the_gap_is_compared() {
        let mut trace = recorded("umaze");
        trace.damage = vec!["bytes 1 to 2 are lost".to_owned()];
        trace.steps.drain(20..25);
        let told = leave_out(&mut trace).unwrap();
        assert!(told.contains("step 20 is missing"), "{told}");
        assert_eq!(replay(&trace).unwrap(), Found::Same(20));
        // The last steps are lost, and the end is not.
        let mut trace = recorded("umaze");
        trace.damage = vec!["bytes 1 to 2 are lost".to_owned()];
        trace.steps.truncate(50);
        assert!(leave_out(&mut trace).is_some());
        assert_eq!(replay(&trace).unwrap(), Found::Same(50));
    }

    #[test]
    fn values_that_no_ant_has_are_refused() {
        let whole = recorded("umaze");
        for value in [f32::NAN, f32::INFINITY, 1e30] {
            let mut trace = whole.clone();
            if let Some(start) = &mut trace.start {
                start.state[3] = value;
            }
            assert!(replay(&trace).is_err(), "{value}");
        }
        let mut trace = whole.clone();
        trace.steps[3].action[1] = f32::NAN;
        assert!(replay(&trace).is_err());
        // No actuator takes so much; the values were changed.
        trace.steps[3].action[1] = 1e30;
        assert!(matches!(replay(&trace).unwrap(), Found::Differs(..)));
        let empty = Trace {
            steps: vec![],
            end: None,
            ..whole
        };
        assert!(one(empty).is_err());
    }

    #[test]
    fn what_cannot_be_simulated_is_said_so() {
        let mut trace = recorded("umaze");
        trace.steps.remove(5);
        assert!(replay(&trace).is_err(), "a step is missing");
        trace.steps.truncate(5);
        trace.steps[2].action.pop();
        assert!(replay(&trace).is_err(), "an action is short");
        trace.start = None;
        assert!(replay(&trace).is_err(), "no start");
    }
}
