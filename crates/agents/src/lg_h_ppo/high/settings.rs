//! `[high]`

use config::Table;

use crate::ppo;

/// What finds the way over the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Planner {
    /// The learned high level.
    Learned,
    /// Dijkstra's search: the paper's ablation, and the oracle of stage 3b.
    Search,
}

/// `[high]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hidden layers of policy and value.
    pub hidden: Vec<usize>,
    /// Step size of Adam, falling to a tenth over the steps.
    pub learning_rate: f32,
    /// Walks on the graph side by side.
    pub environments: usize,
    /// Edges that each walk takes between updates.
    pub horizon: usize,
    /// PPO's own: `epochs`, `minibatch`, `clip`, `entropy` (falling to nothing over the steps),
    /// `discount` (an edge of mean length), `gae_lambda`.
    pub ppo: ppo::Settings,
    /// Reward on arrival at the goal's node.
    pub arrival_reward: f32,
    /// Cost of an edge of mean length.
    pub edge_cost: f32,
    /// Edges after which a walk is cut off.
    pub max_edges: usize,
    /// Choices on the graph in all.
    pub steps: usize,
    /// Largest share of a batch that comes from rollouts in the physics.
    pub physics_share: f64,
    /// `learned` or `search`.
    pub planner: Planner,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        let hidden = t.layers("hidden", &[128, 128]);
        let learning_rate = t.number("learning_rate", 1e-3, [0.0, 1.0]) as f32;
        let environments = t.count("environments", 512, [1, 65_536]);
        let horizon = t.count("horizon", 32, [1, 4096]);
        let ppo = ppo::Settings {
            epochs: t.count("epochs", 3, [1, 100]),
            minibatch: t.count("minibatch", 4096, [1, 1_000_000]),
            clip: t.number("clip", 0.2, [0.01, 1.0]) as f32,
            entropy: t.number("entropy", 0.01, [0.0, 10.0]) as f32,
            value_loss: 0.5,
            max_gradient_norm: 0.5,
            discount: t.number("discount", 0.98, [0.0, 0.9999]) as f32,
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]) as f32,
            target_kl: None,
        };
        let batch = environments * horizon;
        if ppo.minibatch > batch {
            let message = format!(
                "{} is more than a batch of environments x horizon = {batch}",
                ppo.minibatch
            );
            t.fault("minibatch", message);
        }
        Self {
            hidden,
            learning_rate,
            environments,
            horizon,
            ppo,
            arrival_reward: t.number("arrival_reward", 1.0, [0.0, 1000.0]) as f32,
            edge_cost: t.number("edge_cost", 0.02, [0.0, 1000.0]) as f32,
            max_edges: t.count("max_edges", 64, [1, 100_000]),
            steps: t.count("steps", 3_000_000, [1, 10_000_000_000]),
            physics_share: t.number("physics_share", 0.25, [0.0, 1.0]),
            planner: match t
                .word("planner", "learned", &["learned", "search"])
                .as_str()
            {
                "search" => Planner::Search,
                _ => Planner::Learned,
            },
        }
    }
}
