//! Both levels at work on small graphs, with a point that goes where it is told to.

use maze::PointBody;
use rand::SeedableRng;

use super::*;
use crate::lg_h_ppo::high::{Edges, High};
use crate::lg_h_ppo::made::{graph, ring};
use crate::lg_h_ppo::vae::Shape;
use crate::rollout::Rollout;

const SETTINGS: execution::Settings = execution::Settings {
    reached_radius: 0.75,
    goal_radius: 1.0,
    look_ahead: 2,
    timeout: graph::EdgeTimeout {
        factor: 2.0,
        most: 20,
    },
};

/// Latents are places; the low level stands still.
fn navigator(graph: Graph, planner: Planner) -> Navigator {
    let encoder = Encoder::new(Shape::new(2, &[]), &[0.0, 0.0, 1.0, 1.0]).unwrap();
    let low = low::Policy::new(&PointBody, 2, &[4]);
    let still = vec![0.0; low.mlp().parameters()];
    let controller = Controller::Learned(low, still.into());
    Navigator::new(
        &PointBody,
        (SETTINGS, Knowledge::Data),
        (encoder, Arc::new(graph)),
        controller,
        planner,
    )
    .unwrap()
}

fn at([x, y]: [f32; 2]) -> [f32; 4] {
    [x, y, 0.0, 0.0]
}

/// The choices of an episode, read back.
fn choices(words: &[u32]) -> Vec<Choice> {
    let layout = simulator::RowLayout::new(&PointBody.spaces());
    let rollout = Rollout {
        rows: layout.rows(&[]),
        choices: words,
        graph_version: 1,
        structure: 0,
        episode: 0,
    };
    Choice::of(&rollout).collect()
}

/// An episode of a point that jumps to wherever it is sent, from a start to a goal (m): its choices, and
/// its number of steps.
fn walk(navigator: &mut Navigator, start: [f32; 2], goal: [f32; 2]) -> (Vec<Choice>, usize) {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (mut act, mut words, mut place) = (Act::default(), vec![], start);
    navigator.begin(&goal, Mode::Exploit);
    for step in 0..200 {
        act.clear();
        navigator.act(Values::F32(&at(place)), &mut rng, &mut act);
        words.extend_from_slice(&act.choices);
        place = act.target.unwrap();
        if place == goal {
            let mut last = vec![];
            navigator.end(true, &mut last);
            words.extend(last);
            return (choices(&words), step + 1);
        }
    }
    panic!("it never arrived");
}

#[test]
fn a_search_goes_the_short_way_round() {
    let ring = ring(12);
    let (start, goal) = (ring.places[0], ring.places[4]);
    let mut navigator = navigator(ring, Planner::Search);
    let (choices, steps) = walk(&mut navigator, start, goal);
    // Without edges over two nodes there is nothing to look ahead to.
    let way: Vec<(u32, u32)> = choices.iter().map(|c| (c.node, c.subgoal)).collect();
    assert_eq!(way, [(0, 1), (1, 2), (2, 3), (3, 4)]);
    assert!(choices.iter().all(|c| c.goal == 4 && c.excluded.is_empty()));
    assert_eq!(choices[2].ending, Ending::Reached);
    assert_eq!(choices[3].ending, Ending::Arrived);
    assert_eq!(steps, 4);
}

#[test]
fn the_subgoal_lies_ahead_where_the_data_went_in_one_segment() {
    let places = [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [12.0, 0.0]];
    let pairs = [(0, 1), (1, 2), (2, 3), (0, 2), (1, 0), (2, 1), (3, 2)];
    let mut navigator = navigator(graph(&places, &pairs), Planner::Search);
    let (choices, _) = walk(&mut navigator, places[0], places[3]);
    assert_eq!((choices[0].node, choices[0].subgoal), (0, 2));
}

#[test]
fn a_choice_that_the_goal_interrupts_ends_with_the_episode() {
    let places = [[0.0, 0.0], [9.0, 0.0]];
    let mut navigator = navigator(graph(&places, &[(0, 1), (1, 0)]), Planner::Search);
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut act = Act::default();
    // The goal lies by the way to its node.
    navigator.begin(&[5.0, 0.0], Mode::Explore);
    for x in [0.0, 2.0, 4.3] {
        act.clear();
        navigator.act(Values::F32(&at([x, 0.0])), &mut rng, &mut act);
        assert!(act.choices.is_empty());
    }
    assert_eq!((act.subgoal, act.target), (None, Some([5.0, 0.0])));
    let mut words = vec![];
    navigator.end(true, &mut words);
    let ended = choices(&words);
    assert_eq!(ended.len(), 1);
    assert_eq!((ended[0].ending, ended[0].steps), (Ending::Arrived, 3));
    navigator.begin(&[5.0, 0.0], Mode::Explore);
    let mut words = vec![];
    navigator.end(true, &mut words);
    assert!(words.is_empty(), "nothing was chosen");
}

/// A point that stays where it is gives up one neighbour after the other. What it gave up travels
/// with each choice, and the learner's first ratios are 1.
#[test]
fn what_was_given_up_travels_with_the_choice() {
    let places = [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [-4.0, 0.0], [0.0, -9.0]];
    let pairs = [
        (0, 1),
        (0, 2),
        (0, 3),
        (1, 0),
        (2, 0),
        (3, 0),
        (3, 4),
        (4, 3),
    ];
    let star = graph(&places, &pairs);
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let mut settings = high::made(1, 1);
    settings.ppo.epochs = 1;
    let edges = Edges {
        knowledge: Knowledge::Data,
        timeout: SETTINGS.timeout,
    };
    let mut high = High::new(&star, settings, edges, &mut rng);
    high.shake(&mut rng);
    let planner = Planner::Learned(high.policy().clone(), high.weights().into());
    let mut navigator = navigator(star.clone(), planner);
    navigator.begin(&places[4], Mode::Explore);
    let (mut act, mut words, mut outcomes) = (Act::default(), vec![], vec![]);
    for _ in 0..90 {
        act.clear();
        navigator.act(Values::F32(&at(places[0])), &mut rng, &mut act);
        words.extend_from_slice(&act.choices);
        outcomes.extend(act.outcome);
        if act.chosen {
            let sum: f32 = navigator.choosing().probabilities.iter().map(|p| p.1).sum();
            assert!((sum - 1.0).abs() < 1e-5);
        }
    }
    let given_up = choices(&words);
    assert_eq!(given_up.len(), 4, "{given_up:?}");
    assert!(outcomes.iter().all(|outcome| !outcome.reached));
    let mut tried: Vec<u32> = vec![];
    for choice in &given_up[..3] {
        let mut excluded = choice.excluded.clone();
        excluded.sort_unstable();
        tried.sort_unstable();
        assert_eq!(excluded, tried);
        assert!(!tried.contains(&choice.subgoal));
        assert_eq!((choice.ending, choice.steps), (Ending::GivenUp, 21));
        tried.push(choice.subgoal);
    }
    assert_eq!(given_up[3].excluded, [0; 0], "all are worth another try");
    for choice in given_up {
        high.add_rollout(&star, &[choice]);
    }
    let report = high.update(&star, &mut rng);
    assert!(report.kl.abs() < 1e-6, "KL {}", report.kl);
}

#[test]
fn parts_that_do_not_fit_make_no_navigator() {
    let ring = Arc::new(ring(4));
    let encoder = |latent: usize, hidden: &[usize]| {
        let shape = Shape::new(latent, hidden);
        let weights = vec![1.0; shape.weights()];
        Encoder::new(shape, &weights).unwrap()
    };
    let low = |latent: usize| {
        let low = low::Policy::new(&PointBody, latent, &[4]);
        let weights = vec![0.0; low.mlp().parameters()];
        Controller::Learned(low, weights.into())
    };
    let make = |encoder, controller, planner| {
        let settings = (SETTINGS, Knowledge::Data);
        Navigator::new(
            &PointBody,
            settings,
            (encoder, Arc::clone(&ring)),
            controller,
            planner,
        )
    };
    assert!(make(encoder(2, &[]), low(2), Planner::Search).is_some());
    assert!(make(encoder(3, &[4]), low(3), Planner::Search).is_none());
    assert!(make(encoder(2, &[]), low(3), Planner::Search).is_none());
    let five = high::Policy::new(2, 5, &[4]);
    let weights = vec![0.0; five.weights()];
    let planner = Planner::Learned(five, weights.into());
    assert!(make(encoder(2, &[]), low(2), planner).is_none());
}
