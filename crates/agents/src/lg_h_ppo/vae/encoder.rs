//! The encoder at work.

use nets::Workspace;

use super::shape::{CONDITION, PLACE, Shape};

/// A trained encoder at work: places to latents and back.
#[derive(Clone)]
pub struct Encoder {
    shape: Shape,
    weights: Vec<f32>,
    encoder_workspace: Workspace,
    decoder_workspace: Workspace,
    input: Vec<f32>,
    output: Vec<f32>,
}

/// Rows handled at once.
const CHUNK: usize = 512;

impl Encoder {
    /// An encoder from flat weights; none when their number is wrong.
    #[must_use]
    pub fn new(shape: Shape, weights: &[f32]) -> Option<Self> {
        (weights.len() == shape.weights()).then(|| Self {
            encoder_workspace: shape.encoder.workspace(CHUNK),
            decoder_workspace: shape.decoder.workspace(CHUNK),
            input: vec![],
            output: vec![],
            weights: weights.to_vec(),
            shape,
        })
    }

    /// Width of a latent.
    #[must_use]
    pub fn latent(&self) -> usize {
        self.shape.latent
    }

    /// Codes of places, appended to `latents` (`[n, latent]`): the mean of q(z | null, s).
    pub fn encode(&mut self, places: impl Iterator<Item = [f32; 2]>, latents: &mut Vec<f32>) {
        let (norm, networks) = self.weights.split_at(2 * PLACE);
        if self.shape.is_oracle() {
            let standard = |place: [f32; 2], k: usize| (place[k] - norm[k]) / norm[PLACE + k];
            latents.extend(places.flat_map(|place| [0, 1].map(|k| standard(place, k))));
            return;
        }
        let parameters = &networks[..self.shape.ends()[0]];
        let mut places = places.peekable();
        while places.peek().is_some() {
            self.input.clear();
            for place in places.by_ref().take(CHUNK) {
                self.input.extend([0.0, 0.0, 1.0]);
                self.input
                    .extend((0..PLACE).map(|k| (place[k] - norm[k]) / norm[PLACE + k]));
            }
            let rows = self.input.len() / (CONDITION + PLACE);
            let workspace = &mut self.encoder_workspace;
            let out = self
                .shape
                .encoder
                .infer(parameters, &self.input, rows, workspace);
            for row in out.chunks_exact(2 * self.shape.latent).take(rows) {
                latents.extend_from_slice(&row[..self.shape.latent]);
            }
        }
    }

    /// The code of one place.
    pub fn encode_one(&mut self, place: [f32; 2]) -> &[f32] {
        let mut latent = std::mem::take(&mut self.output);
        latent.clear();
        self.encode(std::iter::once(place), &mut latent);
        self.output = latent;
        &self.output
    }

    /// Places (m) of latents `[n, latent]`, without a condition.
    pub fn decode(&mut self, latents: &[f32]) -> Vec<[f32; 2]> {
        let (norm, networks) = self.weights.split_at(2 * PLACE);
        if self.shape.is_oracle() {
            let place = |z: &[f32]| [0, 1].map(|k| z[k] * norm[PLACE + k] + norm[k]);
            return latents.chunks_exact(PLACE).map(place).collect();
        }
        let ends = self.shape.ends();
        let parameters = &networks[ends[0]..ends[1]];
        let mut places = vec![];
        for chunk in latents.chunks(CHUNK * self.shape.latent) {
            self.input.clear();
            for latent in chunk.chunks_exact(self.shape.latent) {
                self.input.extend([0.0, 0.0, 1.0]);
                self.input.extend_from_slice(latent);
            }
            let rows = chunk.len() / self.shape.latent;
            let workspace = &mut self.decoder_workspace;
            let out = self
                .shape
                .decoder
                .infer(parameters, &self.input, rows, workspace);
            for row in out.chunks_exact(PLACE).take(rows) {
                places.push(std::array::from_fn(|k| row[k] * norm[PLACE + k] + norm[k]));
            }
        }
        places
    }
}
