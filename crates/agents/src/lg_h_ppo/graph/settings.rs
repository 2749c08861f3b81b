//! `[graph]`

use config::{OnResume, Table};
use graph::Knowledge;
use graph::kmeans::Seeding;

/// `[graph]`
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Number of nodes (K).
    pub nodes: usize,
    /// Control steps of a segment that makes an edge.
    pub lag: usize,
    /// Segments that an edge needs.
    pub min_count: usize,
    /// Trajectories that an edge needs.
    pub min_trajectories: usize,
    /// States of a 0.5 m cell that are clustered, at most.
    pub states_per_place: usize,
    /// Seconds between versions of the graph while rollouts come in.
    pub refresh_seconds: f64,
    /// `k-means++` or `random`: the paper's ablation.
    pub seeding: Seeding,
    /// Wrong edges added, as a share of the right ones: the paper's ablation.
    pub wrong_edges: f64,
    /// What of the edges' times and reachability is used: `none`, `data` or `rollouts`.
    pub knowledge: Knowledge,
    /// Whether rollouts add nodes and edges and drop edges that lead nowhere.
    pub online: bool,
    /// Nodes that an online graph may grow to.
    pub max_nodes: usize,
    /// A state this many times farther from every node than the data's states are is at a new
    /// place.
    pub growth_radius: f32,
    /// States at a new place that make a node.
    pub growth_states: usize,
    /// An online graph drops edges that rollouts reach the end of less often than this.
    pub least_success: f32,
}

impl Settings {
    /// Reads the table.
    pub fn read(t: &mut Table<'_, '_>) -> Self {
        let nodes = t.count("nodes", 200, [2, 4096]);
        let max_nodes = t.count("max_nodes", (nodes + nodes / 2).min(4096), [2, 4096]);
        if max_nodes < nodes {
            t.fault(
                "max_nodes",
                format!("less than the {nodes} nodes to begin with"),
            );
        }
        Self {
            nodes,
            lag: t.count("lag", 15, [2, 1000]),
            min_count: t.count("min_count", 3, [1, 1_000_000]),
            min_trajectories: t.count("min_trajectories", 2, [1, 1_000_000]),
            states_per_place: t.count("states_per_place", 50, [1, 1_000_000]),
            // When versions come, not what is in them.
            refresh_seconds: t.on_resume(OnResume::Free).number(
                "refresh_seconds",
                5.0,
                [0.1, 86_400.0],
            ),
            seeding: match t
                .word("seeding", "k-means++", &["k-means++", "random"])
                .as_str()
            {
                "random" => Seeding::Random,
                _ => Seeding::PlusPlus,
            },
            wrong_edges: t.number("wrong_edges", 0.0, [0.0, 10.0]),
            knowledge: match t
                .word("knowledge", "rollouts", &["none", "data", "rollouts"])
                .as_str()
            {
                "none" => Knowledge::Nothing,
                "data" => Knowledge::Data,
                _ => Knowledge::Rollouts,
            },
            online: t.flag("online", false),
            max_nodes,
            growth_radius: t.number("growth_radius", 1.0, [0.1, 100.0]) as f32,
            growth_states: t.count("growth_states", 20, [1, 1000]),
            least_success: t.number("least_success", 0.1, [0.0, 1.0]) as f32,
        }
    }

    /// Nodes that the graph can come to have.
    #[must_use]
    pub fn most_nodes(&self) -> usize {
        if self.online {
            self.max_nodes
        } else {
            self.nodes
        }
    }
}
