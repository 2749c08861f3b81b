//! What is trained: `[encoder]`, `[graph]`, `[low]`, `[high]`.

use crate::read::data::file;
use crate::read::optional_table;
use crate::reader::{Document, Table};
use crate::sections::{Controller, Encoder, Graph, High, Knowledge, Latent, Low, Planner, Seeding};

pub(super) fn encoder(d: &mut Document<'_>, wanted: bool) -> Encoder {
    optional_table(d, wanted, "encoder", |t| {
        let places = t.word("kind", "vae", &["vae", "place"]) == "place";
        let mut encoder = vae(t, places);
        if places {
            if encoder.latent != 2 {
                t.fault("latent", "kind = \"place\" goes with latent = 2");
            }
            encoder.hidden.clear();
        } else if encoder.null_condition == 0.0 {
            // The graph is made of codes that are taken with the null token.
            let message = "0 leaves the null token untrained, and all codes are taken with it; set \
                           it above 0, as to the default 0.5";
            t.fault("null_condition", message);
        }
        encoder
    })
}

fn vae(t: &mut Table<'_, '_>, places: bool) -> Encoder {
    Encoder {
        kind: if places { Latent::Place } else { Latent::Vae },
        latent: t.count("latent", if places { 2 } else { 8 }, [1, 64]),
        lag: t.count("lag", 15, [1, 1000]),
        beta: t.number("beta", 0.01, [0.0, 100.0]),
        prior_balance: t.number("prior_balance", 0.8, [0.0, 1.0]),
        null_condition: t.number("null_condition", 0.5, [0.0, 1.0]),
        hidden: t.layers("hidden", &[128, 128]),
        learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
        batch: t.count("batch", 256, [1, 65_536]),
        updates: t.count("updates", 10_000, [1, 100_000_000]),
        from: file(t, "from"),
    }
}

pub(super) fn graph(d: &mut Document<'_>, wanted: bool) -> Graph {
    optional_table(d, wanted, "graph", |t| {
        let nodes = t.count("nodes", 200, [2, 4096]);
        let max_nodes = t.count("max_nodes", (nodes + nodes / 2).min(4096), [2, 4096]);
        if max_nodes < nodes {
            t.fault(
                "max_nodes",
                format!("less than the {nodes} nodes to begin with"),
            );
        }
        Graph {
            nodes,
            lag: t.count("lag", 15, [2, 1000]),
            min_count: t.count("min_count", 3, [1, 1_000_000]),
            min_trajectories: t.count("min_trajectories", 2, [1, 1_000_000]),
            states_per_place: t.count("states_per_place", 50, [1, 1_000_000]),
            refresh_seconds: t.number("refresh_seconds", 5.0, [0.1, 86_400.0]),
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
            growth_radius: t.number("growth_radius", 1.0, [0.1, 100.0]),
            growth_states: t.count("growth_states", 20, [1, 1000]),
            least_success: t.number("least_success", 0.1, [0.0, 1.0]),
        }
    })
}

pub(super) fn low(d: &mut Document<'_>, wanted: bool) -> Low {
    optional_table(d, wanted, "low", |t| Low {
        hidden: t.layers("hidden", &[256, 256]),
        learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
        batch: t.count("batch", 256, [1, 65_536]),
        updates: t.count("updates", 10_000, [1, 100_000_000]),
        expectile: t.number("expectile", 0.7, [0.5, 0.999]),
        discount: t.number("discount", 0.98, [0.0, 0.9999]),
        inverse_temperature: t.number("inverse_temperature", 3.0, [0.0, 100.0]),
        weight_clip: t.number("weight_clip", 100.0, [1.0, 1e6]),
        target_rate: t.number("target_rate", 0.005, [0.0, 1.0]),
        snap: t.number("snap", 0.5, [0.0, 1.0]),
        slack: t.count("slack", 5, [0, 1000]),
        controller: match t
            .word("controller", "learned", &["learned", "walker"])
            .as_str()
        {
            "walker" => Controller::Walker,
            _ => Controller::Learned,
        },
        from: file(t, "from"),
    })
}

pub(super) fn high(d: &mut Document<'_>, wanted: bool) -> High {
    optional_table(d, wanted, "high", |t| {
        let high = High {
            hidden: t.layers("hidden", &[128, 128]),
            learning_rate: t.number("learning_rate", 1e-3, [0.0, 1.0]),
            environments: t.count("environments", 512, [1, 65_536]),
            horizon: t.count("horizon", 32, [1, 4096]),
            epochs: t.count("epochs", 3, [1, 100]),
            minibatch: t.count("minibatch", 4096, [1, 1_000_000]),
            clip: t.number("clip", 0.2, [0.01, 1.0]),
            entropy: t.number("entropy", 0.01, [0.0, 10.0]),
            discount: t.number("discount", 0.98, [0.0, 0.9999]),
            gae_lambda: t.number("gae_lambda", 0.95, [0.0, 1.0]),
            arrival_reward: t.number("arrival_reward", 1.0, [0.0, 1000.0]),
            edge_cost: t.number("edge_cost", 0.02, [0.0, 1000.0]),
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
        };
        let batch = high.environments * high.horizon;
        if high.minibatch > batch {
            let message = format!(
                "{} is more than a batch of environments x horizon = {batch}",
                high.minibatch
            );
            t.fault("minibatch", message);
        }
        high
    })
}
