//! Every algorithm, and nothing about processes.
//!
//! An [`Algorithm`] is a folder: its settings beside the losses that they steer, stages, networks,
//! graph rule, policy, labels; and a line in [`ALGORITHMS`].
//!
//! | folder | algorithm |
//! |---|---|
//! | `lg_h_ppo/` | LG-H-PPO (Han 2026) |
//! | `gcbc/` | goal-conditioned behavioural cloning |
//! | `walker/` | PPO of a walking policy, which makes the offline data |
//!
//! What several share: `actor_critic.rs` (one PPO update, of any distribution), `ppo.rs` (advantages,
//! surrogate, epochs), `rollout.rs`, `stream.rs` (random streams).

pub mod actor_critic;
mod algorithm;
pub mod gcbc;
mod graph_rule;
pub mod lg_h_ppo;
mod parts;
mod policy;
pub mod ppo;
mod registry;
mod rollout;
mod stage;
pub mod stream;
mod summary;
pub mod walker;

pub use algorithm::{Algorithm, Checkpoint, Environments, Network, Plan};
pub use graph_rule::{BuildError, GraphRule, GraphWork};
pub use parts::{GRAPH, PARTS, Parts, Versions, Weights};
pub use policy::{Act, Choosing, Mode, Outcome, Policy};
pub use registry::{ALGORITHMS, CONFIGS, body, find, plan};
pub use rollout::{Rollout, push_record};
pub use stage::{Inputs, Metrics, Progress, Publication, Stage, StageError, StageSpec};
pub use stream::stream;
pub use summary::{Label, Lookup, Rate, Summary};

/// Whether what a state holds is as long as what it replaces, and finite.
fn same_shape(pairs: &[(&Vec<f32>, &Vec<f32>)]) -> bool {
    pairs
        .iter()
        .all(|(new, old)| new.len() == old.len() && new.iter().all(|value| value.is_finite()))
}
