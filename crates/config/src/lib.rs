//! The run file: parsed, checked as a whole, resolved.
