//! `formica replay`: simulates the actions of traces again.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::report::episode::replay::{self, Verdict};
use anyhow::Context;
use runs::traces;
use trace::Trace;

use crate::{exit, output};

/// Exit code 1 if a state differs or a trace cannot be simulated, 3 if all states of a truncated or
/// damaged trace are the same.
pub(crate) fn run(given: &Path) -> anyhow::Result<ExitCode> {
    let paths = traces::all(&[given.to_path_buf()])?;
    let [path] = &*paths else {
        return Ok(several(&paths));
    };
    let trace = trace::read(path)?;
    let code = one(trace).with_context(|| path.display().to_string())?;
    Ok(ExitCode::from(code))
}

/// Replays each trace, also after one that cannot be simulated.
fn several(paths: &[PathBuf]) -> ExitCode {
    let codes = paths.iter().map(|path| {
        outln!("{}", path.display());
        let code = trace::read(path).map_err(Into::into).and_then(one);
        code.unwrap_or_else(|error: anyhow::Error| {
            outln!("it cannot be simulated: {error:#}");
            exit::FAILED
        })
    });
    ExitCode::from(exit::worst(codes))
}

fn one(trace: Trace) -> anyhow::Result<u8> {
    let mut text = String::new();
    let verdict = replay::replay(trace, &mut text);
    output::text(text);
    Ok(match verdict? {
        Verdict::Same => 0,
        Verdict::Partial => exit::DAMAGED,
        Verdict::Differs => exit::FAILED,
    })
}
