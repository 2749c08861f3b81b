//! The high level learns to plan, and takes rollouts for what they were.

use graph::EdgeTimeout;
use nets::categorical::Masked;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::lg_h_ppo::choice::Ending;
use crate::lg_h_ppo::made::{graph, ring};

const EDGES: Edges = Edges {
    knowledge: Knowledge::Data,
    timeout: EdgeTimeout {
        factor: 2.0,
        most: 40,
    },
};

pub(crate) fn settings(environments: usize, horizon: usize) -> Settings {
    Settings {
        hidden: vec![32, 32],
        learning_rate: 3e-3,
        environments,
        horizon,
        ppo: ppo::Settings {
            epochs: 3,
            minibatch: 256,
            clip: 0.2,
            entropy: 0.01,
            value_loss: 0.5,
            max_gradient_norm: 0.5,
            discount: 0.98,
            gae_lambda: 0.95,
            target_kl: None,
        },
        arrival_reward: 1.0,
        edge_cost: 0.02,
        max_edges: 32,
        steps: 100_000,
        physics_share: 0.25,
        planner: Planner::Learned,
    }
}

#[test]
fn the_most_likely_choices_come_to_lead_to_the_goal() {
    let ring = ring(10);
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut high = High::new(&ring, settings(64, 16), EDGES, &mut rng);
    for update in 0..60 {
        high.anneal(1.0, 1.0 - update as f32 / 60.0);
        high.update(&ring, &mut rng);
    }
    let (arrived, ratio) = high.quality(&ring, 200, &mut rng);
    assert!(arrived > 0.95, "{arrived} of the paths arrive");
    assert!(ratio < 1.1, "they cost {ratio} times the cheapest");
    assert_eq!(high.steps, 60 * 64 * 16);
}

/// A star: node 0 in the middle of three others.
fn star() -> Graph {
    let places = [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [-4.0, 0.0]];
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0)];
    graph(&places, &pairs)
}

/// A choice at the middle among the nodes that are not excluded, with its true log-probability.
fn choice(high: &High, star: &Graph, subgoal: u32, excluded: Vec<u32>) -> Choice {
    let policy = high.policy();
    let mut input = vec![];
    policy.input(star.latent(0), star.latent(3), &mut input);
    let weights = high.weights();
    let mut workspaces = policy.workspaces();
    let logits = policy.logits(&weights, &input, &mut workspaces);
    let open: Vec<usize> = (1..4)
        .filter(|n| !excluded.contains(&(*n as u32)))
        .collect();
    let masked = Masked::new(logits, &open).unwrap();
    let picked = open.iter().position(|n| *n as u32 == subgoal).unwrap();
    Choice {
        node: 0,
        goal: 3,
        subgoal,
        log_prob: masked.log_prob(picked),
        steps: 9,
        ending: Ending::Reached,
        next: subgoal,
        excluded,
    }
}

/// What was given up cannot be chosen again, so the learner must not count it either: before the
/// first step the policy is the one that acted, and every ratio is 1.
#[test]
fn choices_among_what_was_left_have_the_ratio_one() {
    let star = star();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let mut one_step = settings(1, 1);
    one_step.ppo.epochs = 1;
    let mut high = High::new(&star, one_step, EDGES, &mut rng);
    high.shake(&mut rng);
    for (subgoal, excluded) in [(1, vec![2]), (3, vec![1, 2]), (2, vec![]), (2, vec![3])] {
        let choice = choice(&high, &star, subgoal, excluded);
        high.add_rollout(&star, &[choice]);
    }
    assert_eq!(high.pending(), 4);
    let report = high.update(&star, &mut rng);
    assert!(report.kl.abs() < 1e-6, "KL {}", report.kl);
    assert_eq!(report.clip_fraction, 0.0);
}

#[test]
fn rollouts_end_at_the_goal_and_those_that_do_not_fit_are_left_out() {
    let star = star();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut high = High::new(&star, settings(4, 4), EDGES, &mut rng);
    let fits = choice(&high, &star, 1, vec![]);
    let arrived = choice(&high, &star, 3, vec![]);
    for wrong in [
        Choice {
            node: 9,
            ..fits.clone()
        },
        Choice {
            goal: 9,
            ..fits.clone()
        },
        Choice {
            next: 9,
            ..fits.clone()
        },
        Choice {
            node: 1,
            subgoal: 2,
            ..fits.clone()
        },
        Choice {
            excluded: vec![1],
            ..fits.clone()
        },
    ] {
        high.add_rollout(&star, &[fits.clone(), wrong.clone()]);
        assert_eq!(high.pending(), 0, "{wrong:?}");
    }
    high.add_rollout(&star, &[fits.clone(), arrived, fits]);
    assert_eq!(high.pending(), 2, "what follows the goal is no part of it");
}

#[test]
fn new_nodes_begin_with_the_logits_of_the_nearest_old_one() {
    let old = star();
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let mut high = High::new(&old, settings(4, 4), EDGES, &mut rng);
    let logits = |high: &High, graph: &Graph| {
        let policy = high.policy().clone();
        let mut input = vec![];
        policy.input(graph.latent(0), graph.latent(3), &mut input);
        let weights = high.weights();
        policy
            .logits(&weights, &input, &mut policy.workspaces())
            .to_vec()
    };
    let before = logits(&high, &old);
    let mut new = graph(
        &[[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [-4.0, 0.0], [0.5, 4.5]],
        &[(0, 1), (0, 4), (1, 0), (4, 0)],
    );
    new.version = 2;
    high.adopt(&old, &new, &mut rng);
    let after = logits(&high, &new);
    assert_eq!(after[..4], before[..]);
    assert_eq!(after[4], before[2]);
    let mut other = High::new(&old, settings(4, 4), EDGES, &mut rng);
    assert!(!other.restore(high.state()), "of another graph");
}
