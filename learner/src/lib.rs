//! Data set and rollouts in, weights and checkpoints out.
