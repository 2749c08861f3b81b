//! Whole-process tests of formica.
