//! Exit codes.

/// Shown by `formica --help`.
pub(crate) const EXIT_CODES: &str = "\
Exit codes:
  0    done
  1    failed; doctor: a run may not start or not last
  2    a fault in what was given: arguments, config, data
  3    done, but a trace is cut off or damaged (inspect, replay, recover)
  130  ended by Ctrl-C, SIGTERM or SIGHUP

A signal that was ignored from the start, as by nohup, stays ignored. A reader of the output that is
gone changes neither work nor exit code; output that cannot be written for another reason, such as a
full disk, makes 1 of 0, but not of launch and collect.";

/// The work failed, or a trace cannot be read.
pub(crate) const FAILED: u8 = 1;
/// A fault in what the user gave.
pub(crate) const INPUT: u8 = 2;
/// Done, but a trace is truncated or damaged.
pub(crate) const DAMAGED: u8 = 3;
/// Ended by a signal.
pub(crate) const SIGNAL: u8 = 130;

/// The code of several traces: failure before damage before success.
pub(crate) fn worst(codes: impl IntoIterator<Item = u8>) -> u8 {
    let worse = |a: u8, b: u8| match a == FAILED || b == FAILED {
        true => FAILED,
        false => a.max(b),
    };
    codes.into_iter().fold(0, worse)
}
