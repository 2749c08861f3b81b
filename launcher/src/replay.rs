//! Simulates a trace's actions again and compares every state bit by bit.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use maze::{ACTION, AntMaze, OBSERVATION, Physics, Start};
use trace::Trace;

use crate::{story, traces};

/// No value of a state that can be simulated is larger.
const LARGEST: f32 = 1e6;

/// What a replay found.
#[derive(Debug, PartialEq)]
enum Found {
    /// So many states are the same.
    Same(usize),
    /// The first step whose state differs, and the values that do: index, as recorded, now.
    Differs(u32, Vec<(usize, f32, f32)>),
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
        Found::Differs(step, values) => {
            let all = values.len();
            say!("step {step} is the first that differs, in {all} of {OBSERVATION} values:");
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

fn replay(trace: &Trace) -> anyhow::Result<Found> {
    let layout = story::layout(trace)?;
    let start = trace.start.as_ref().context(
        "it does not say how the ant was set at the start; traces of formica 0.1.0 and later do",
    )?;
    let observation = start.state.as_slice().try_into();
    let observation: [f32; OBSERVATION] =
        observation.context("its start has not the 29 values of an ant")?;
    ensure!(
        observation.iter().all(|value| value.abs() <= LARGEST),
        "its start has a value that no ant has: it is no number, or over {LARGEST}"
    );
    let mut ant = AntMaze::new(&layout, Physics::MAZE);
    ant.begin(&Start {
        observation,
        exits: start.exits,
    });
    for (expected, step) in (0..).zip(&trace.steps) {
        ensure!(
            step.step == expected,
            "it has step {} where {expected} belongs",
            step.step
        );
        let told = || format!("its step {expected} has not {OBSERVATION} values and {ACTION}");
        if let Some(found) = compare(expected, &step.observation, &ant).with_context(told)? {
            return Ok(found);
        }
        let action: [f32; ACTION] = step.action.as_slice().try_into().with_context(told)?;
        ensure!(
            action.iter().all(|value| value.is_finite()),
            "its step {expected} has an action that is no number"
        );
        ant.step(&action);
    }
    let steps = trace.steps.len();
    let Some(end) = &trace.end else {
        return Ok(Found::Same(steps));
    };
    let told = || format!("its end has not {OBSERVATION} values");
    let found = compare(steps as u32, &end.observation, &ant).with_context(told)?;
    Ok(found.unwrap_or(Found::Same(steps + 1)))
}

/// None where all bits are the same.
fn compare(step: u32, recorded: &[f32], ant: &AntMaze) -> anyhow::Result<Option<Found>> {
    let recorded: &[f32; OBSERVATION] = recorded.try_into()?;
    let now = ant.observation();
    let values: Vec<(usize, f32, f32)> = (0..OBSERVATION)
        .filter(|i| recorded[*i].to_bits() != now[*i].to_bits())
        .map(|i| (i, recorded[i], now[i]))
        .collect();
    Ok((!values.is_empty()).then_some(Found::Differs(step, values)))
}

#[cfg(test)]
mod tests {
    use maze::Layout;
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
            let Found::Differs(40, values) = replay(&trace).unwrap() else {
                panic!("the bit at step 40 was not seen");
            };
            assert_eq!(values.len(), 1);
            // Another action shows at the step after it.
            trace.steps[10].action[0] = 0.0;
            assert!(matches!(replay(&trace).unwrap(), Found::Differs(11, _)));
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
