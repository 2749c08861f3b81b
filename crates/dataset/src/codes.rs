//! Latents and nearest nodes of all rows, as one mapped file beside a run's prepared data: computed
//! by the process that builds the graph, before it publishes it, and read by those that learn on it.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::mapped::{self, Mapped, Values};
use crate::{Array, MappedError};

/// The file in a run's folder.
const FILE: &str = "codes.mapped";
const KIND: &str = "codes";

/// What the codes are of.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct About {
    rows: u64,
    /// Width of a latent.
    width: u64,
    /// A hash of the encoder's weights, and of the nodes' latents.
    encoder: u64,
    nodes: u64,
}

/// Codes that lie in a run's folder.
#[derive(Debug, Clone)]
pub struct Codes {
    /// Latents of all rows, `[n, width]`.
    pub latents: Array<f32>,
    nodes: Array<u32>,
    /// What these are of.
    of: u64,
}

fn file(run: &Path) -> PathBuf {
    run.join(FILE)
}

impl Codes {
    /// Writes the latents of all rows, made with the weights of an encoder, and the nearest node of
    /// each, among nodes with latents of the same width; whole or not at all.
    ///
    /// # Errors
    /// What the system refuses. Nobody needs the file: who finds none computes its own.
    pub fn save(
        run: &Path,
        [encoder, nodes]: [&[f32]; 2],
        latents: &[f32],
        nearest: &[u32],
    ) -> Result<(), MappedError> {
        let about = About {
            rows: nearest.len() as u64,
            width: (latents.len() / nearest.len().max(1)) as u64,
            encoder: hash(encoder),
            nodes: hash(nodes),
        };
        let arrays = [
            Values::new("latents", latents),
            Values::new("nodes", nearest),
        ];
        mapped::write(&file(run), KIND, &about, &arrays)
    }

    /// The codes of so many rows, in latents of a width, made with the weights of an encoder; none
    /// where there are none of these, or damaged ones.
    #[must_use]
    pub fn open(run: &Path, rows: usize, width: usize, encoder: &[f32]) -> Option<Self> {
        let file = Mapped::open(&file(run), KIND).ok()?;
        let about: About = file.about().ok()?;
        let latents: Array<f32> = file.array("latents").ok()?;
        let nodes: Array<u32> = file.array("nodes").ok()?;
        let of = about.nodes;
        let wanted = About {
            rows: rows as u64,
            width: width as u64,
            encoder: hash(encoder),
            nodes: of,
        };
        let fits = about == wanted
            && nodes.len() == rows
            && rows.checked_mul(width) == Some(latents.len());
        fits.then_some(Self { latents, nodes, of })
    }

    /// The nearest of nodes with these latents to each row; none where the codes are of other nodes.
    #[must_use]
    pub fn nodes(&self, latents: &[f32]) -> Option<Array<u32>> {
        let width = self.latents.len() / self.nodes.len().max(1);
        let count = (latents.len() / width.max(1)) as u32;
        let fits = self.of == hash(latents) && self.nodes.iter().all(|node| *node < count);
        fits.then(|| self.nodes.clone())
    }
}

/// Removes the codes from a run's folder.
pub(crate) fn remove(run: &Path) {
    // What cannot be removed is of no harm.
    let _ = fs::remove_file(file(run));
}

/// Tells weights from others (FNV-1a).
fn hash(values: &[f32]) -> u64 {
    let bytes = values.iter().flat_map(|value| value.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENCODER: [f32; 3] = [1.0, 2.0, 3.0];
    const NODES: [f32; 4] = [0.0, 0.0, 1.0, 1.0];
    const LATENTS: [f32; 6] = [0.1, 0.0, 0.9, 1.0, 0.0, 0.2];

    #[test]
    fn codes_come_back_for_the_same_encoder_and_nodes_alone() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        let open = |rows, width, encoder: &[f32]| Codes::open(run, rows, width, encoder);
        assert!(open(3, 2, &ENCODER).is_none());
        Codes::save(run, [&ENCODER, &NODES], &LATENTS, &[0, 1, 0]).unwrap();
        let codes = open(3, 2, &ENCODER).unwrap();
        assert_eq!(codes.latents, LATENTS);
        assert!(codes.latents.is_mapped());
        assert_eq!(codes.nodes(&NODES).unwrap(), [0, 1, 0]);
        assert!(codes.nodes(&NODES[..2]).is_none());
        assert!(open(3, 2, &ENCODER[..2]).is_none());
        assert!(open(2, 3, &ENCODER).is_none());
        assert!(open(6, 1, &ENCODER).is_none());
        remove(run);
        assert!(open(3, 2, &ENCODER).is_none());
        // What is mapped stays.
        assert_eq!(codes.latents, LATENTS);
    }

    #[test]
    fn damage_and_nodes_that_are_not_there_are_no_codes() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        Codes::save(run, [&ENCODER, &NODES], &LATENTS, &[0, 2, 0]).unwrap();
        let codes = Codes::open(run, 3, 2, &ENCODER).unwrap();
        assert!(codes.nodes(&NODES).is_none(), "there are nodes 0 and 1");
        let whole = fs::read(file(run)).unwrap();
        for length in 0..whole.len() {
            fs::write(file(run), &whole[..length]).unwrap();
            assert!(
                Codes::open(run, 3, 2, &ENCODER).is_none(),
                "cut at {length}"
            );
        }
    }
}
