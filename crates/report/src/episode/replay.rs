//! Simulates the actions of a trace again and compares every state bit by bit, for `formica replay`.

use std::fmt::Write;

use anyhow::{Context, ensure};
use maze::{AntSimulator, OBSERVATION, Start};
use simulator::{Simulator, Values};
use trace::Trace;

use super::layout::layout;

/// The result of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// All states are the same.
    Same,
    /// All states that are there are the same; the rest is truncated or damaged.
    Partial,
    /// A state differs.
    Differs,
}

/// What a comparison found.
#[derive(Debug, PartialEq)]
enum Found {
    /// Number of states, all the same.
    Same(usize),
    /// The first step with a different state, the number of values, and the different ones: index,
    /// recorded, simulated.
    Differs(u32, usize, Vec<(usize, f32, f32)>),
}

/// Replays a trace and appends what was found to `text`.
///
/// # Errors
/// The trace cannot be simulated.
pub fn replay(mut trace: Trace, text: &mut String) -> anyhow::Result<Verdict> {
    let mut line = |line: String| {
        let _ = writeln!(text, "{line}");
    };
    if let Some(reason) = &trace.cut {
        line(format!("the trace is cut off: {reason}"));
    }
    for reason in &trace.damage {
        line(format!("the trace is damaged: {reason}"));
    }
    let version = &*trace.meta.version;
    match version {
        env!("CARGO_PKG_VERSION") => {}
        "" => line("the trace does not say which version of formica wrote it".to_owned()),
        _ => line(format!(
            "the trace is of formica {version}, whose physics may differ"
        )),
    }
    let lost = leave_out(&mut trace);
    let partial = !trace.is_whole() || lost.is_some();
    if trace.steps.is_empty() && trace.end.is_none() {
        ensure!(partial, "it holds no step to compare");
        line("no step is left to compare".to_owned());
        return Ok(Verdict::Partial);
    }
    match simulate(&trace)? {
        Found::Same(states) => {
            let actions = trace.steps.len();
            line(format!(
                "{states} states after {actions} actions are the same bit for bit"
            ));
            lost.into_iter().for_each(line);
            Ok(match partial {
                true => Verdict::Partial,
                false => Verdict::Same,
            })
        }
        Found::Differs(step, width, values) => {
            let all = values.len();
            line(format!(
                "step {step} is the first that differs, in {all} of {width} values:"
            ));
            for (index, recorded, now) in values {
                line(format!(
                    "  observation[{index}]: {}, {} now",
                    shown(recorded),
                    shown(now)
                ));
            }
            line(
                "it was recorded by another version of the physics, or on a processor of another \
                 kind, or its values were changed"
                    .to_owned(),
            );
            Ok(Verdict::Differs)
        }
    }
}

/// A value of a trace; its bits if they are not visible in the number.
fn shown(value: f32) -> String {
    let bits = value.to_bits();
    match value {
        // Differs from 0.0 in its bits.
        0.0 if value.is_sign_negative() => format!("0.0 (bits {bits:08x})"),
        _ if value.is_finite() => format!("{value:?}"),
        _ => format!("no number (bits {bits:08x})"),
    }
}

/// Leaves out what comes after missing steps, since the states there cannot be simulated. Returns a
/// sentence about it.
fn leave_out(trace: &mut Trace) -> Option<String> {
    if trace.is_whole() && trace.recovered.is_none() {
        return None;
    }
    let in_order = (0..).zip(&trace.steps);
    let kept = in_order.take_while(|(i, step)| *i == step.step).count();
    let rest = trace.steps.len() > kept;
    // The end belongs to all steps.
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
    let layout = layout(trace)?;
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

/// Simulates the actions from the start, and compares the states.
fn simulate(trace: &Trace) -> anyhow::Result<Found> {
    let mut simulator = simulator_of(trace)?;
    let spaces = simulator.body().spaces();
    let (observation, action) = (spaces.observation.len(), spaces.action.len());
    for (expected, step) in (0..).zip(&trace.steps) {
        ensure!(
            step.step == expected,
            "it has step {} where {expected} belongs",
            step.step
        );
        let context = || format!("its step {expected} has not {observation} values and {action}");
        let recorded = (&*step.observation, &*step.observation_bytes);
        let found = compare(expected, recorded, &*simulator).with_context(context)?;
        if let Some(found) = found {
            return Ok(found);
        }
        ensure!(step.action.len() == action, context());
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
    let context = || format!("its end has not {observation} values");
    let recorded = (&*end.observation, &*end.observation_bytes);
    let found = compare(steps as u32, recorded, &*simulator).with_context(context)?;
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
            // Beyond the actuator limits, as noisy actions are.
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
    fn a_replay_is_the_same_and_any_changed_bit_is_found() {
        for maze in ["medium", "teleport"] {
            let mut trace = recorded(maze);
            assert_eq!(simulate(&trace).unwrap(), Found::Same(61));
            let value = trace.steps[40].observation[3];
            trace.steps[40].observation[3] = f32::from_bits(value.to_bits() ^ 1);
            let Found::Differs(40, 29, values) = simulate(&trace).unwrap() else {
                panic!("the bit at step 40 was not seen");
            };
            assert_eq!(values.len(), 1);
            // Another action changes the state of the next step.
            trace.steps[10].action[0] = 0.0;
            assert!(matches!(simulate(&trace).unwrap(), Found::Differs(11, ..)));
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
            assert_eq!(simulate(&trace).unwrap(), Found::Same(50), "{name}");
            trace.steps[0].action[0] = 0.0;
            assert!(matches!(simulate(&trace).unwrap(), Found::Differs(1, ..)));
            trace.start = Some(trace::Start::default());
            assert!(simulate(&trace).is_err(), "no state was saved");
            trace.meta.simulator = "flea".to_owned();
            assert!(simulate(&trace).is_err());
        }
    }

    #[test]
    fn a_damaged_trace_is_compared_up_to_the_gap() {
        let mut trace = recorded("umaze");
        trace.damage = vec!["bytes 1 to 2 are lost".to_owned()];
        trace.steps.drain(20..25);
        let text = leave_out(&mut trace).unwrap();
        assert!(text.contains("step 20 is missing"), "{text}");
        assert_eq!(simulate(&trace).unwrap(), Found::Same(20));
        // The last steps are lost, but not the end.
        let mut trace = recorded("umaze");
        trace.damage = vec!["bytes 1 to 2 are lost".to_owned()];
        trace.steps.truncate(50);
        assert!(leave_out(&mut trace).is_some());
        assert_eq!(simulate(&trace).unwrap(), Found::Same(50));
    }

    #[test]
    fn impossible_values_are_errors() {
        let whole = recorded("umaze");
        for value in [f32::NAN, f32::INFINITY, 1e30] {
            let mut trace = whole.clone();
            if let Some(start) = &mut trace.start {
                start.state[3] = value;
            }
            assert!(simulate(&trace).is_err(), "{value}");
        }
        let mut trace = whole.clone();
        trace.steps[3].action[1] = f32::NAN;
        assert!(simulate(&trace).is_err());
        // Beyond all actuator limits: changed values.
        trace.steps[3].action[1] = 1e30;
        assert!(matches!(simulate(&trace).unwrap(), Found::Differs(..)));
        let empty = Trace {
            steps: vec![],
            end: None,
            ..whole
        };
        assert!(replay(empty, &mut String::new()).is_err());
    }

    #[test]
    fn incomplete_traces_are_errors() {
        let mut trace = recorded("umaze");
        trace.steps.remove(5);
        assert!(simulate(&trace).is_err(), "a step is missing");
        trace.steps.truncate(5);
        trace.steps[2].action.pop();
        assert!(simulate(&trace).is_err(), "an action is short");
        trace.start = None;
        assert!(simulate(&trace).is_err(), "no start");
    }
}
