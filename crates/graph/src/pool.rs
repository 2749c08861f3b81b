//! All nodes and ways that were ever seen: what the versions of a graph are made from.
//!
//! Edges come from segments of trajectories, of the data first and of rollouts later. A node
//! keeps its id for good, so that what is known of it outlives each version of the graph.

#[cfg(test)]
mod tests;

use std::collections::{HashMap, VecDeque};
use std::ops::Range;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::assign::squared;
use crate::{Edge, Graph, Nearest, kmeans};

/// When segments make an edge, and when rollouts unmake it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EdgeRule {
    /// Control steps of a segment (c).
    pub lag: usize,
    /// Segments needed.
    pub min_count: usize,
    /// Trajectories needed.
    pub min_trajectories: usize,
    /// Rollouts reach its end less often than this share of its tries: the edge is dropped. Zero
    /// keeps every edge.
    pub least_success: f32,
}

/// Tries before an edge can be dropped.
const DROP_TRIES: f32 = 8.0;
/// Newest tries that count: what an earlier low level could not do is forgotten.
const MEMORY: f32 = 32.0;
/// Control steps over which a heading is taken.
const HEADING: usize = 3;
/// Cosine of the angle within which a walk goes towards a node: 30 degrees.
const TOWARDS: f32 = 0.866;
/// Walks that came to the end, granted to every edge.
const GRANTED: f32 = 2.0;

/// Trajectories that ways come from.
pub struct Segments<'a> {
    /// Latent of each row, `[n, dim]`.
    pub latents: &'a [f32],
    /// Place of each row (m).
    pub places: &'a [[f32; 2]],
    /// Rows of each trajectory.
    pub episodes: &'a [Range<usize>],
    /// Names each of them: pieces of one trajectory have one name.
    pub names: &'a dyn Fn(usize) -> u64,
    /// Rows that count: where the ant is upright.
    pub usable: &'a dyn Fn(usize) -> bool,
}

/// When nodes are added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    /// A state farther from every node than this latent distance is at a new place.
    pub radius: f32,
    /// Such states within that distance of each other that make a node.
    pub min_states: usize,
    /// Trajectories that they come from.
    pub min_trajectories: usize,
    /// Nodes at most.
    pub max_nodes: usize,
}

/// States at new places that are kept, the newest.
const FAR_KEPT: usize = 2048;

/// A state at a new place.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Far {
    latent: Vec<f32>,
    place: [f32; 2],
    trajectory: u64,
}

/// What is known of the way between two nodes.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Way {
    /// Segments that begin in the one node and end in the other.
    count: u32,
    last_trajectory: Option<u64>,
    trajectories: usize,
    /// Walks from entering the one node to entering the other, and their control steps.
    walks: u32,
    steps: u64,
    least_steps: Option<u64>,
    /// Walks from the one node towards the other, and those that came to it.
    aimed: u32,
    hit: u32,
    tried: f32,
    reached: f32,
    rollout_steps: f32,
}

/// Nodes, by id, and the ways between them.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Pool {
    dim: usize,
    rule: EdgeRule,
    latents: Vec<f32>,
    /// Sum of places of a node's states, and their number.
    places: Vec<[f64; 2]>,
    members: Vec<u32>,
    ways: HashMap<(u32, u32), Way>,
    growth: Option<Growth>,
    far: VecDeque<Far>,
    version: u64,
}

impl Pool {
    /// Nodes at `centroids` (`[k, dim]`), without any way.
    #[must_use]
    pub fn new(dim: usize, centroids: Vec<f32>, rule: EdgeRule) -> Self {
        let nodes = centroids.len() / dim.max(1);
        Self {
            dim,
            rule,
            latents: centroids,
            places: vec![[0.0; 2]; nodes],
            members: vec![0; nodes],
            ways: HashMap::new(),
            growth: None,
            far: VecDeque::new(),
            version: 0,
        }
    }

    /// From now on, states at new places are remembered, and [`renew`](Self::renew) makes nodes
    /// of them.
    pub fn let_grow(&mut self, growth: Growth) {
        self.growth = Some(growth);
    }

    /// Whether it is whole and one that [`renew`](Self::renew) can work on, wherever it was read.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let nodes = self.members.len();
        let inside = |(from, to): &(u32, u32)| (*from as usize) < nodes && (*to as usize) < nodes;
        self.dim > 0
            && self.latents.len() == nodes * self.dim
            && self.places.len() == nodes
            && self.latents.iter().all(|value| value.is_finite())
            && self.ways.keys().all(inside)
            && self.far.iter().all(|far| far.latent.len() == self.dim)
    }

    /// Number of nodes, those that no version holds among them.
    #[must_use]
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Adds the data set that the graph is built from, as [`add`](Self::add) does, and counts how often
    /// a walk that leaves a node towards another one reaches it within twice the lag. Returns the
    /// nearest node of each row.
    pub fn begin(&mut self, data: &Segments<'_>) -> Nearest {
        let nearest = Nearest::of(data.latents, self.dim, &self.latents);
        if !self.is_empty() {
            self.take(data, &nearest);
            self.aim(data, &nearest.nodes);
        }
        nearest
    }

    /// Takes in trajectories: every segment (s_t .. s_{t+lag}) of one whose ends lie in different
    /// nodes is a way between these.
    pub fn add(&mut self, data: &Segments<'_>) {
        if !self.is_empty() {
            let nearest = Nearest::of(data.latents, self.dim, &self.latents);
            self.take(data, &nearest);
        }
    }

    fn take(
        &mut self,
        data: &Segments<'_>,
        Nearest {
            nodes, distances, ..
        }: &Nearest,
    ) {
        let n = nodes.len().min(data.places.len());
        for (number, episode) in data.episodes.iter().enumerate() {
            // An episode that says it is longer than the data ends with them.
            let episode = episode.start.min(n)..episode.end.min(n);
            let name = (data.names)(number);
            for t in episode.clone().filter(|&t| (data.usable)(t)) {
                self.member(nodes[t], distances[t], data, t, name);
            }
            for t in episode.start..episode.end.saturating_sub(self.rule.lag) {
                let end = t + self.rule.lag;
                if nodes[t] != nodes[end] && (data.usable)(t) && (data.usable)(end) {
                    self.segment(nodes[t], nodes[end], name);
                }
            }
            self.visits(nodes, episode, data.usable);
        }
    }

    /// Times from entering one node to entering another one that is at most a lag away.
    fn visits(&mut self, nodes: &[u32], episode: Range<usize>, usable: &dyn Fn(usize) -> bool) {
        // Node, first and last row of each visit that is not long over.
        let mut visits: VecDeque<(u32, usize, usize)> = VecDeque::new();
        for t in episode {
            let node = nodes[t];
            match visits.back_mut() {
                Some((here, _, last)) if *here == node => *last = t,
                _ => {
                    let lag = self.rule.lag;
                    visits.retain(|(_, _, last)| t - last <= lag);
                    for &(from, start, last) in visits.iter().filter(|(from, ..)| *from != node) {
                        if usable(last) && usable(t) {
                            let way = self.ways.entry((from, node)).or_default();
                            let steps = (t - start) as u64;
                            way.walks += 1;
                            way.steps += steps;
                            way.least_steps =
                                Some(way.least_steps.map_or(steps, |least| least.min(steps)));
                        }
                    }
                    visits.push_back((node, t, t));
                }
            }
        }
    }

    fn member(&mut self, node: u32, distance: f32, data: &Segments<'_>, t: usize, name: u64) {
        let far = self
            .growth
            .as_ref()
            .is_some_and(|growth| distance > growth.radius * growth.radius);
        if far {
            if self.far.len() == FAR_KEPT {
                self.far.pop_front();
            }
            self.far.push_back(Far {
                latent: data.latents[t * self.dim..(t + 1) * self.dim].to_vec(),
                place: data.places[t],
                trajectory: name,
            });
            return;
        }
        let node = node as usize;
        self.members[node] = self.members[node].saturating_add(1);
        for axis in 0..2 {
            self.places[node][axis] += f64::from(data.places[t][axis]);
        }
    }

    fn segment(&mut self, from: u32, to: u32, name: u64) {
        let way = self.ways.entry((from, to)).or_default();
        way.count = way.count.saturating_add(1);
        if way.last_trajectory != Some(name) {
            way.last_trajectory = Some(name);
            way.trajectories += 1;
        }
    }

    /// Counts how often a walk that leaves a node towards another one reaches it within twice the lag.
    /// The trajectories' ways must have been added.
    fn aim(&mut self, data: &Segments<'_>, nodes: &[u32]) {
        let n = nodes.len().min(data.places.len());
        let mut ends: Vec<Vec<u32>> = vec![vec![]; self.len()];
        for (&(from, to), way) in &self.ways {
            if self.is_edge(way) {
                ends[from as usize].push(to);
            }
        }
        for episode in data.episodes {
            let episode = episode.start.min(n)..episode.end.min(n);
            for t in episode.start..episode.end.saturating_sub(2 * self.rule.lag) {
                let node = nodes[t];
                if nodes[t + 1] == node || !(data.usable)(t) {
                    continue;
                }
                let ahead = &nodes[t + 1..=t + 2 * self.rule.lag];
                let heading = between(
                    data.places[t],
                    data.places[t + HEADING.min(2 * self.rule.lag)],
                );
                for &to in &ends[node as usize] {
                    let way = between(self.place(node), self.place(to));
                    if cosine(heading, way) < TOWARDS {
                        continue;
                    }
                    if let Some(way) = self.ways.get_mut(&(node, to)) {
                        way.aimed = way.aimed.saturating_add(1);
                        way.hit = way.hit.saturating_add(u32::from(ahead.contains(&to)));
                    }
                }
            }
        }
    }

    /// Adds wrong edges between random nodes, `share` of the right ones' number, that look like
    /// edges of the data. Returns how many.
    pub fn add_wrong_edges(&mut self, share: f64, rng: &mut impl Rng) -> usize {
        let edges = || self.ways.values().filter(|way| self.is_edge(way));
        let wanted = (share * edges().count() as f64).round() as usize;
        let walks: u64 = edges().map(|way| u64::from(way.walks)).sum();
        let steps: u64 = edges().map(|way| way.steps).sum();
        let steps = (steps / walks.max(1)).max(1);
        let nodes = self.len() as u32;
        let mut added = 0;
        // A graph that is all but complete has no room for more.
        for _ in 0..100 * wanted {
            if added == wanted {
                break;
            }
            let (from, to) = (rng.random_range(0..nodes), rng.random_range(0..nodes));
            let known = self.ways.get(&(from, to));
            if from == to || known.is_some_and(|way| self.is_edge(way)) {
                continue;
            }
            let way = Way {
                count: self.rule.min_count as u32,
                walks: 1,
                steps,
                least_steps: Some(steps),
                trajectories: self.rule.min_trajectories,
                ..Way::default()
            };
            self.ways.insert((from, to), way);
            added += 1;
        }
        added
    }

    /// Books what became of an edge that a rollout tried, by the ids of its nodes; false for a
    /// way that is not known.
    pub fn record(&mut self, from: u32, to: u32, reached: bool, steps: usize) -> bool {
        let Some(way) = self.ways.get_mut(&(from, to)) else {
            return false;
        };
        if way.tried >= MEMORY {
            let kept = (MEMORY - 1.0) / way.tried;
            way.tried *= kept;
            way.reached *= kept;
        }
        way.tried += 1.0;
        if reached {
            way.reached += 1.0;
            way.rollout_steps += (steps as f32 - way.rollout_steps) / way.reached;
        }
        true
    }

    /// Makes nodes of the states at new places where enough of them lie together. Returns how
    /// many.
    fn grow(&mut self) -> usize {
        let Some(growth) = self.growth.clone() else {
            return 0;
        };
        let mut added = 0;
        let reach = growth.radius * growth.radius;
        while self.len() < growth.max_nodes {
            // Nodes that are new make some of the states near.
            let latents = &self.latents;
            let dim = self.dim;
            self.far
                .retain(|far| kmeans::nearest(latents, dim, &far.latent).1 > reach);
            let near = |centre: &Far| -> Vec<usize> {
                (0..self.far.len())
                    .filter(|&i| squared(&self.far[i].latent, &centre.latent) <= reach)
                    .collect()
            };
            let fullest = self
                .far
                .iter()
                .map(near)
                .max_by_key(Vec::len)
                .filter(|near| near.len() >= growth.min_states);
            let Some(near) = fullest else { break };
            let mut from: Vec<u64> = near.iter().map(|&i| self.far[i].trajectory).collect();
            from.sort_unstable();
            from.dedup();
            if from.len() < growth.min_trajectories {
                break;
            }
            let mut centroid = vec![0.0; dim];
            let mut place = [0.0; 2];
            for &i in &near {
                let far = &self.far[i];
                for (sum, value) in centroid.iter_mut().zip(&far.latent) {
                    *sum += value / near.len() as f32;
                }
                for axis in 0..2 {
                    place[axis] += f64::from(far.place[axis]);
                }
            }
            self.latents.extend(centroid);
            self.places.push(place);
            self.members.push(near.len() as u32);
            added += 1;
        }
        added
    }

    fn is_edge(&self, way: &Way) -> bool {
        let seen = way.count as usize >= self.rule.min_count
            && way.trajectories >= self.rule.min_trajectories;
        let bad = way.tried >= DROP_TRIES && way.reached < self.rule.least_success * way.tried;
        seen && !bad
    }

    fn place(&self, node: u32) -> [f32; 2] {
        let node = node as usize;
        let count = f64::from(self.members[node].max(1));
        self.places[node].map(|axis| (axis / count) as f32)
    }

    /// The next version of the graph: grown by the new places, the largest strongly connected
    /// part of it, so that every node can be left and every other one reached. With it the share
    /// of all nodes that it holds, and how many are new.
    pub fn renew(&mut self) -> (Graph, f32, usize) {
        let added = self.grow();
        let nodes = self.len() as u32;
        let mut rows = vec![vec![]; self.len()];
        for (&(from, to), way) in &self.ways {
            if self.is_edge(way) {
                let mean = way.steps as f32 / way.walks.max(1) as f32;
                rows[from as usize].push(Edge {
                    to,
                    count: way.count,
                    mean_steps: mean,
                    least_steps: way.least_steps.map_or(mean, |least| least as f32),
                    reachability: (way.hit as f32 + GRANTED) / (way.aimed as f32 + GRANTED),
                    tried: way.tried,
                    reached: way.reached,
                    rollout_steps: way.rollout_steps,
                });
            }
        }
        let whole = Graph::assemble(
            self.dim,
            (0..nodes).collect(),
            self.latents.clone(),
            (0..nodes).map(|node| self.place(node)).collect(),
            rows,
        );
        let mut graph = whole.largest_component();
        self.version += 1;
        graph.version = self.version;
        let share = graph.len() as f32 / whole.len().max(1) as f32;
        (graph, share, added)
    }
}

fn between(from: [f32; 2], to: [f32; 2]) -> [f32; 2] {
    [to[0] - from[0], to[1] - from[1]]
}

fn cosine(a: [f32; 2], b: [f32; 2]) -> f32 {
    let lengths = a[0].hypot(a[1]) * b[0].hypot(b[1]);
    (a[0] * b[0] + a[1] * b[1]) / lengths.max(1e-6)
}
