//! Weights and graph in, rollouts and traces out.
