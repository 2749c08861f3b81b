//! Edges, counts and growth of a pool, on rows along a line.

use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::*;

const RULE: EdgeRule = EdgeRule {
    lag: 5,
    min_count: 1,
    min_trajectories: 1,
    least_success: 0.0,
};

/// Rows on a line, one latent per metre.
fn add(pool: &mut Pool, xs: &[f32], episodes: &[Range<usize>]) {
    let places: Vec<[f32; 2]> = xs.iter().map(|x| [*x, 0.0]).collect();
    let data = Segments {
        latents: xs,
        places: &places,
        episodes,
        names: &|number| number as u64,
        usable: &|_| true,
    };
    pool.begin(&data);
}

/// From 0 to `end` metres and back, 0.1 m a step.
fn there_and_back(end: usize) -> Vec<f32> {
    (0..=10 * end)
        .chain((0..10 * end).rev())
        .map(|i| i as f32 * 0.1)
        .collect()
}

#[test]
fn a_walk_there_and_back_links_its_nodes() {
    let mut pool = Pool::new(1, vec![0.0, 1.0, 2.0], RULE);
    let xs = there_and_back(2);
    add(&mut pool, &xs, &[0..xs.len()]);
    let (graph, share, added) = pool.renew();
    assert_eq!((graph.len(), share, added), (3, 1.0, 0));
    assert!(graph.edge(0, 1).is_some() && graph.edge(1, 0).is_some());
    assert!(graph.edge(0, 2).is_none(), "too far for a segment");
    let edge = graph.edge(0, 1).unwrap();
    // In node 0 at rows 0 to 5, in node 1 from row 6 on.
    assert_eq!((edge.mean_steps, edge.least_steps), (6.0, 6.0));
    assert_eq!(edge.reachability, 1.0);
    assert!((graph.places[1][0] - 1.0).abs() < 0.1);
}

#[test]
fn segments_never_cross_an_episodes_end() {
    let xs = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
    let edges = |episodes: &[Range<usize>]| {
        let mut pool = Pool::new(1, vec![0.0, 1.0], EdgeRule { lag: 1, ..RULE });
        add(&mut pool, &xs, episodes);
        pool.renew().0.edges.len()
    };
    assert_eq!(edges(&[0..6]), 2);
    assert_eq!(edges(&[0..2, 2..4, 4..6]), 0);
}

#[test]
fn tries_count_and_old_ones_are_forgotten() {
    let mut pool = Pool::new(1, vec![0.0, 1.0], RULE);
    let xs = there_and_back(1);
    add(&mut pool, &xs, &[0..xs.len()]);
    assert!(pool.record(0, 1, true, 4) && pool.record(0, 1, true, 6));
    assert!(!pool.record(0, 7, true, 4), "no such way");
    let edge = *pool.renew().0.edge(0, 1).unwrap();
    assert_eq!(
        (edge.tried, edge.reached, edge.rollout_steps),
        (2.0, 2.0, 5.0)
    );
    for _ in 0..200 {
        pool.record(0, 1, false, 40);
    }
    let edge = *pool.renew().0.edge(0, 1).unwrap();
    assert!(edge.tried <= MEMORY && edge.reached < 0.01, "{edge:?}");
}

#[test]
fn an_edge_that_fails_is_dropped_where_the_rule_says_so() {
    for (least_success, nodes) in [(0.0, 3), (0.1, 2)] {
        let mut pool = Pool::new(
            1,
            vec![0.0, 1.0, 2.0],
            EdgeRule {
                least_success,
                ..RULE
            },
        );
        let xs = there_and_back(2);
        add(&mut pool, &xs, &[0..xs.len()]);
        (0..9).for_each(|_| assert!(pool.record(1, 2, false, 40)));
        let (graph, ..) = pool.renew();
        assert_eq!(graph.len(), nodes, "node 2 cannot be reached any more");
    }
}

#[test]
fn states_at_new_places_become_nodes_and_old_ids_stay() {
    let mut pool = Pool::new(1, vec![0.0, 1.0], RULE);
    let xs = there_and_back(1);
    add(&mut pool, &xs, &[0..xs.len()]);
    let before = pool.renew().0;
    pool.let_grow(Growth {
        radius: 0.6,
        min_states: 3,
        min_trajectories: 2,
        max_nodes: 4,
    });
    let xs = there_and_back(6);
    add(&mut pool, &xs, &[0..xs.len()]);
    assert_eq!(pool.renew().2, 0, "one trajectory is not enough");
    let twice = [xs.clone(), xs.clone()].concat();
    let episodes = [0..xs.len(), xs.len()..2 * xs.len()];
    add(&mut pool, &twice, &episodes);
    let (_, _, added) = pool.renew();
    assert_eq!(added, 2, "up to max_nodes");
    add(&mut pool, &twice, &episodes);
    let (graph, share, _) = pool.renew();
    assert_eq!((graph.len(), share), (4, 1.0));
    assert_eq!(graph.ids[..2], before.ids[..]);
    assert_ne!(graph.structure(), before.structure());
    assert_eq!(graph.version, 4);
}

#[test]
fn wrong_edges_are_as_many_as_asked_for() {
    let mut pool = Pool::new(1, (0..10).map(|i| i as f32).collect(), RULE);
    let xs = there_and_back(9);
    add(&mut pool, &xs, &[0..xs.len()]);
    let right = pool.renew().0.edges.len();
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let added = pool.add_wrong_edges(0.5, &mut rng);
    assert_eq!(added, right.div_ceil(2));
    assert_eq!(pool.renew().0.edges.len(), right + added);
}

proptest! {
    #[test]
    fn every_node_of_a_graph_reaches_every_other(
        xs in proptest::collection::vec(0.0_f32..6.0, 30..120), cut in 5..25_usize,
    ) {
        let centroids = vec![0.5, 1.5, 2.5, 3.5, 4.5, 5.5];
        let mut pool = Pool::new(1, centroids, EdgeRule { lag: 2, ..RULE });
        add(&mut pool, &xs, &[0..cut, cut..xs.len()]);
        let (graph, ..) = pool.renew();
        prop_assert_eq!(graph.offsets.len(), graph.len() + 1);
        prop_assert_eq!(graph.offsets[graph.len()] as usize, graph.edges.len());
        for edge in &graph.edges {
            prop_assert!((0.0..=1.0).contains(&edge.reachability));
            prop_assert!(edge.least_steps <= edge.mean_steps);
        }
        for goal in 0..graph.len() as u32 {
            let distances = graph.distances_to(goal, |_| 1.0);
            prop_assert!(distances.iter().all(|d| d.is_finite()));
        }
    }
}
