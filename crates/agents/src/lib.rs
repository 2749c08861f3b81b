//! One file an algorithm: losses, update, act. Knows no processes.
//!
//! | file | algorithm | stage |
//! |---|---|---|
//! | `vae.rs` | latent encoder | 1 |
//! | `low.rs` | goal-conditioned advantage-weighted regression | 3a |
//! | `high.rs` | PPO with masked logits on the latent graph | 3b |
//! | `navigator.rs` | both levels at work | execution |
//! | `walker.rs` | PPO of a walking policy, which makes the offline data | - |
//! | `actor_critic.rs` | one PPO update, of any distribution | - |
//! | `ppo.rs` | advantages, surrogate, epochs | - |

pub mod actor_critic;
pub mod high;
pub mod low;
pub mod navigator;
pub mod ppo;
pub mod vae;
pub mod walker;

/// Whether what a state holds is as long as what it replaces, and finite.
fn same_shape(pairs: &[(&Vec<f32>, &Vec<f32>)]) -> bool {
    pairs
        .iter()
        .all(|(new, old)| new.len() == old.len() && new.iter().all(|value| value.is_finite()))
}
