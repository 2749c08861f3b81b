//! Latents and nearest nodes of all rows, as a mapped file next to a run's prepared data. The
//! graph-builder writes the file before it publishes the graph; the learner maps it.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::mapped::{self, Mapped, Values};
use crate::{Array, MappedError};

/// Name of the file in a run's folder.
const FILE: &str = "codes.mapped";
const KIND: &str = "codes";

/// Metadata of the file: what the codes were computed from.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct About {
    rows: u64,
    /// Width of a latent.
    width: u64,
    /// Hash of the encoder's weights.
    encoder: u64,
    /// Hash of the nodes' latents.
    nodes: u64,
}

/// Codes from a run's folder.
#[derive(Debug, Clone)]
pub struct Codes {
    /// Latents of all rows, `[n, width]`.
    pub latents: Array<f32>,
    nodes: Array<u32>,
    /// Hash of the latents of the graph's nodes.
    of: u64,
}

fn file(run: &Path) -> PathBuf {
    run.join(FILE)
}

impl Codes {
    /// Atomically writes the latents and the nearest node of each row. The pair is the encoder's
    /// weights and the latents of the graph's nodes.
    ///
    /// # Errors
    /// The file cannot be written. It is an optimization: readers compute the codes without it.
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

    /// Opens the codes of `rows` rows with latents of `width` values, computed with these weights of
    /// the encoder. Returns `None` if the file is missing, corrupt, or of another encoder.
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

    /// Returns the nearest node of each row, or `None` if the nodes have other latents than these.
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
    // A file that stays does no harm.
    let _ = fs::remove_file(file(run));
}

/// FNV-1a hash.
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
    fn codes_are_opened_for_the_same_encoder_and_nodes_only() {
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
        // A mapping outlives its file.
        assert_eq!(codes.latents, LATENTS);
    }

    #[test]
    fn corrupt_files_and_invalid_nodes_are_refused() {
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
