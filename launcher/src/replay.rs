//! Simulates a trace's actions again and compares every state bit by bit.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use maze::{ACTION, AntMaze, OBSERVATION, Physics, Start};
use trace::Trace;

use crate::story;

/// What a replay found.
#[derive(Debug, PartialEq)]
enum Found {
    /// So many states are the same.
    Same(usize),
    /// The first step whose state differs, and the values that do: index, as recorded, now.
    Differs(u32, Vec<(usize, f32, f32)>),
}

/// `formica replay TRACE`.
pub(crate) fn run(path: &Path) -> anyhow::Result<ExitCode> {
    let trace = trace::read(path)?;
    if let Some(reason) = &trace.cut {
        say!("the trace is cut off: {reason}");
    }
    let version = &trace.meta.version;
    if version != env!("CARGO_PKG_VERSION") {
        say!("the trace is of formica {version}, whose physics may differ");
    }
    let found = replay(&trace).with_context(|| path.display().to_string())?;
    match found {
        Found::Same(states) => {
            say!(
                "{states} states after {} actions are the same bit for bit",
                trace.steps.len()
            );
            Ok(ExitCode::SUCCESS)
        }
        Found::Differs(step, values) => {
            let all = values.len();
            say!("step {step} is the first that differs, in {all} of {OBSERVATION} values:");
            for (index, recorded, now) in values {
                say!("  observation[{index}] {recorded:?} in the trace, {now:?} now");
            }
            say!(
                "it was recorded by another version of the physics, or on a processor of another \
                 kind"
            );
            Ok(ExitCode::FAILURE)
        }
    }
}

fn replay(trace: &Trace) -> anyhow::Result<Found> {
    let layout = story::layout(trace)?;
    let start = trace.start.as_ref().context(
        "it does not say how the ant was set at the start; traces of formica 0.1.0 and later do",
    )?;
    let observation = start.state.as_slice().try_into();
    let observation = observation.context("its start has not 29 values")?;
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
        let action = step.action.as_slice().try_into().with_context(told)?;
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
