//! The graph's file, which is also what travels between processes: little-endian, magic, counts,
//! then nodes, offsets, edges. Every length is checked before it is believed.

use std::fs;
use std::path::Path;

use crate::{Edge, Graph, MAX_OUT_DEGREE};

const MAGIC: &[u8; 8] = b"FORMICAG";
const FORMAT: u32 = 2;
const HEADER: usize = 8 + 4 + 8 + 3 * 4;
const EDGE: usize = 32;
/// Places farther out (m) are damage: lines between them are looked at step by step.
const FARTHEST: f32 = 1e5;
/// Counts beyond these are damage, not graphs.
const MOST: usize = 1 << 20;

/// Why a graph could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum GraphError {
    /// The system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not a graph file of this version.
    #[error("not a graph file of format {FORMAT}")]
    Format,
    /// Shorter or longer than its counts say.
    #[error("the graph has {got} bytes, its counts ask for {expected}")]
    Length {
        /// By the counts.
        expected: usize,
        /// As found.
        got: usize,
    },
    /// Of another encoder.
    #[error("the graph's latents are {got} wide, those of the run {expected}")]
    Width {
        /// Width wanted.
        expected: usize,
        /// Width found.
        got: usize,
    },
    /// An index or value that no graph has.
    #[error("the graph's {0} are damaged")]
    Damaged(&'static str),
}

/// Bytes that a graph of `nodes` nodes can come to need.
#[must_use]
pub fn max_bytes(nodes: usize, latent_dim: usize) -> usize {
    let row = 4 * latent_dim + 8 + 4 + 4 + EDGE * nodes.min(MAX_OUT_DEGREE);
    HEADER + nodes * row + 4
}

struct Cursor<'a>(&'a [u8]);

impl Cursor<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }
}

fn floats_of(edge: &Edge) -> [f32; 6] {
    [
        edge.mean_steps,
        edge.least_steps,
        edge.reachability,
        edge.tried,
        edge.reached,
        edge.rollout_steps,
    ]
}

impl Graph {
    /// The graph as bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(max_bytes(self.len(), self.latent_dim));
        bytes.extend_from_slice(MAGIC);
        bytes.extend(FORMAT.to_le_bytes());
        bytes.extend(self.version.to_le_bytes());
        for count in [self.latent_dim, self.len(), self.edges.len()] {
            bytes.extend((count as u32).to_le_bytes());
        }
        bytes.extend(self.ids.iter().flat_map(|id| id.to_le_bytes()));
        let floats = self.latents.iter().chain(self.places.iter().flatten());
        bytes.extend(floats.flat_map(|value| value.to_le_bytes()));
        bytes.extend(self.offsets.iter().flat_map(|offset| offset.to_le_bytes()));
        for edge in &self.edges {
            bytes.extend(edge.to.to_le_bytes());
            bytes.extend(edge.count.to_le_bytes());
            for value in floats_of(edge) {
                bytes.extend(value.to_le_bytes());
            }
        }
        bytes
    }

    /// Reads [`to_bytes`](Self::to_bytes).
    ///
    /// # Errors
    /// Another format, wrong lengths, damaged values.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, GraphError> {
        let mut cursor = Cursor(bytes);
        if cursor.take() != Some(*MAGIC) || cursor.u32() != Some(FORMAT) {
            return Err(GraphError::Format);
        }
        let short = GraphError::Length {
            expected: HEADER,
            got: bytes.len(),
        };
        let counts = (cursor.take(), cursor.u32(), cursor.u32(), cursor.u32());
        let (Some(version), Some(dim), Some(nodes), Some(edges)) = counts else {
            return Err(short);
        };
        let [dim, nodes, edges] = [dim, nodes, edges].map(|count| count as usize);
        if dim == 0 || dim > 4096 || nodes > MOST || edges > MOST {
            return Err(GraphError::Damaged("counts"));
        }
        let expected = HEADER + nodes * (4 + 4 * dim + 8) + 4 * (nodes + 1) + EDGE * edges;
        if bytes.len() != expected {
            return Err(GraphError::Length {
                expected,
                got: bytes.len(),
            });
        }
        let read = |cursor: &mut Cursor<'_>| -> Option<Self> {
            let ids = (0..nodes)
                .map(|_| cursor.u32())
                .collect::<Option<Vec<_>>>()?;
            let latents = (0..nodes * dim)
                .map(|_| cursor.f32())
                .collect::<Option<Vec<_>>>()?;
            let places = (0..nodes)
                .map(|_| Some([cursor.f32()?, cursor.f32()?]))
                .collect::<Option<_>>()?;
            let offsets = (0..=nodes)
                .map(|_| cursor.u32())
                .collect::<Option<Vec<_>>>()?;
            let edge = |_| {
                Some(Edge {
                    to: cursor.u32()?,
                    count: cursor.u32()?,
                    mean_steps: cursor.f32()?,
                    least_steps: cursor.f32()?,
                    reachability: cursor.f32()?,
                    tried: cursor.f32()?,
                    reached: cursor.f32()?,
                    rollout_steps: cursor.f32()?,
                })
            };
            let edges = (0..edges).map(edge).collect::<Option<Vec<_>>>()?;
            let version = u64::from_le_bytes(version);
            Some(Self {
                version,
                latent_dim: dim,
                ids,
                latents,
                places,
                offsets,
                mean_edge_steps: crate::mean_steps(&edges),
                edges,
            })
        };
        let graph = read(&mut cursor).ok_or(short)?;
        graph.check()?;
        Ok(graph)
    }

    /// The same, of latents of a known width.
    ///
    /// # Errors
    /// As [`from_bytes`](Self::from_bytes), or latents of another width.
    pub fn from_bytes_of(bytes: &[u8], latent_dim: usize) -> Result<Self, GraphError> {
        let graph = Self::from_bytes(bytes)?;
        if graph.latent_dim == latent_dim {
            Ok(graph)
        } else {
            Err(GraphError::Width {
                expected: latent_dim,
                got: graph.latent_dim,
            })
        }
    }

    fn check(&self) -> Result<(), GraphError> {
        let mut ids = self.ids.clone();
        ids.sort_unstable();
        if ids.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(GraphError::Damaged("ids"));
        }
        let floats = self.latents.iter().chain(self.places.iter().flatten());
        if !floats.copied().all(f32::is_finite) {
            return Err(GraphError::Damaged("nodes"));
        }
        if self
            .places
            .iter()
            .flatten()
            .any(|axis| axis.abs() > FARTHEST)
        {
            return Err(GraphError::Damaged("places"));
        }
        let ordered = self.offsets.windows(2).all(|pair| pair[0] <= pair[1]);
        let last = self.offsets.last().map(|last| *last as usize);
        if !ordered || self.offsets.first() != Some(&0) || last != Some(self.edges.len()) {
            return Err(GraphError::Damaged("offsets"));
        }
        let good = |edge: &Edge| {
            (edge.to as usize) < self.len()
                && floats_of(edge).iter().all(|v| v.is_finite() && *v >= 0.0)
                && edge.reachability <= 1.0
                && edge.reached <= edge.tried
        };
        // Rows ascend, so that an edge is there once.
        let sorted = (0..self.len() as u32).all(|node| {
            let row = self.neighbours(node);
            row.len() <= MAX_OUT_DEGREE
                && row.windows(2).all(|pair| pair[0].to < pair[1].to)
                && row.iter().all(|edge| edge.to != node)
        });
        if sorted && self.edges.iter().all(good) {
            Ok(())
        } else {
            Err(GraphError::Damaged("edges"))
        }
    }

    /// Writes the graph's file beside, syncs and renames.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn save(&self, path: &Path) -> Result<(), GraphError> {
        durable::write(path, &self.to_bytes()).map_err(|source| GraphError::Io {
            path: path.display().to_string(),
            source,
        })
    }

    /// Reads a graph's file.
    ///
    /// # Errors
    /// What the system refuses, or damage.
    pub fn load(path: &Path) -> Result<Self, GraphError> {
        let bytes = fs::read(path).map_err(|source| GraphError::Io {
            path: path.display().to_string(),
            source,
        })?;
        Self::from_bytes(&bytes)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::paths::tests::ring;

    #[test]
    fn a_graph_survives_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.bin");
        let mut graph = ring(7);
        graph.version = 9;
        graph.edges[0].tried = 2.5;
        graph.save(&path).unwrap();
        assert_eq!(Graph::load(&path).unwrap(), graph);
        assert!(graph.to_bytes().len() <= max_bytes(7, 2));
    }

    #[test]
    fn latents_of_another_width_are_refused() {
        let bytes = ring(5).to_bytes();
        assert!(Graph::from_bytes_of(&bytes, 2).is_ok());
        let other = Graph::from_bytes_of(&bytes, 3);
        assert!(matches!(
            other,
            Err(GraphError::Width {
                expected: 3,
                got: 2
            })
        ));
    }

    #[test]
    fn every_cut_is_refused() {
        let bytes = ring(5).to_bytes();
        for length in 0..bytes.len() {
            assert!(Graph::from_bytes(&bytes[..length]).is_err());
        }
    }

    proptest! {
        #[test]
        fn any_bytes_after_the_magic_are_refused_or_read(
            tail in proptest::collection::vec(any::<u8>(), 0..300)
        ) {
            let mut bytes = ring(5).to_bytes();
            bytes.truncate(12);
            bytes.extend(tail);
            if let Ok(graph) = Graph::from_bytes(&bytes) {
                prop_assert_eq!(graph.to_bytes(), bytes);
            }
        }

        #[test]
        fn damage_never_panics_and_what_is_read_is_sound(
            flips in proptest::collection::vec((0..500_usize, any::<u8>()), 1..6)
        ) {
            let mut bytes = ring(5).to_bytes();
            for (at, value) in flips {
                let at = at % bytes.len();
                bytes[at] = value;
            }
            if let Ok(graph) = Graph::from_bytes(&bytes) {
                for node in 0..graph.len() as u32 {
                    for edge in graph.neighbours(node) {
                        prop_assert!((edge.to as usize) < graph.len());
                    }
                }
            }
        }
    }
}
