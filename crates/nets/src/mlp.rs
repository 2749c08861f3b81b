//! Multi-layer perceptrons with an explicit backward pass.

mod passes;
mod tensors;

use rand::{Rng, RngExt};

pub use passes::Workspace;

/// What follows each hidden layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Activation {
    /// GELU in its tanh form.
    Gelu,
    /// Hyperbolic tangent.
    Tanh,
}

/// Where a layer's values lie in the flat parameters: weights `outputs x inputs` column-major,
/// then biases, then the norm's gain and shift where there is one.
#[derive(Debug, Clone, Copy)]
struct Layer {
    inputs: usize,
    outputs: usize,
    weights: usize,
    bias: usize,
    norm: Option<usize>,
}

/// The shape of a network; its values are a flat slice of [`Mlp::parameters`] numbers.
#[derive(Debug, Clone)]
pub struct Mlp {
    layers: Vec<Layer>,
    activation: Activation,
    parameters: usize,
}

impl Mlp {
    /// A network of these widths, inputs first, outputs last. With `layer_norm` a norm follows
    /// each hidden layer's activation.
    #[must_use]
    pub fn new(sizes: &[usize], activation: Activation, layer_norm: bool) -> Self {
        let mut layers = vec![];
        let mut parameters = 0;
        for (i, pair) in sizes.windows(2).enumerate() {
            let (inputs, outputs) = (pair[0], pair[1]);
            let weights = parameters;
            let bias = weights + inputs * outputs;
            parameters = bias + outputs;
            let norm = (layer_norm && i + 2 < sizes.len()).then_some(parameters);
            parameters += if norm.is_some() { 2 * outputs } else { 0 };
            layers.push(Layer {
                inputs,
                outputs,
                weights,
                bias,
                norm,
            });
        }
        Self {
            layers,
            activation,
            parameters,
        }
    }

    /// Number of parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.parameters
    }

    /// Width of the input.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.inputs)
    }

    /// Width of the output.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.outputs)
    }

    /// A hash of widths, activation and norms (FNV-1a): equal shapes have equal hashes.
    #[must_use]
    pub fn shape_hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut add = |value: usize| {
            for byte in (value as u64).to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        add(self.activation as usize);
        for layer in &self.layers {
            add(layer.inputs);
            add(layer.outputs);
            add(usize::from(layer.norm.is_some()));
        }
        hash
    }

    /// Fresh parameters: weights uniform with variance 2 / (inputs + outputs), biases zero, the
    /// last layer's weights times `last_scale`.
    pub fn init(&self, rng: &mut impl Rng, last_scale: f32) -> Vec<f32> {
        let mut parameters = vec![0.0; self.parameters];
        for (i, layer) in self.layers.iter().enumerate() {
            let mut bound = (6.0 / (layer.inputs + layer.outputs) as f32).sqrt();
            if i + 1 == self.layers.len() {
                bound *= last_scale;
            }
            for weight in &mut parameters[layer.weights..layer.bias] {
                *weight = bound * rng.random_range(-1.0..=1.0_f32);
            }
            if let Some(gain) = layer.norm {
                parameters[gain..gain + layer.outputs].fill(1.0);
            }
        }
        parameters
    }

    /// The same network with another number of outputs.
    #[must_use]
    pub fn with_outputs(&self, outputs: usize) -> Self {
        let mut layers = self.layers.clone();
        let mut parameters = self.parameters;
        if let Some(last) = layers.last_mut() {
            last.outputs = outputs;
            last.bias = last.weights + last.inputs * outputs;
            parameters = last.bias + outputs;
        }
        Self {
            layers,
            activation: self.activation,
            parameters,
        }
    }

    /// Parameters for [`with_outputs`](Self::with_outputs): output `j` is a copy of output
    /// `sources[j]`. Of an optimiser's moments as well.
    ///
    /// # Panics
    /// When a source is no output, or the values are not this network's: a fault of the caller.
    #[must_use]
    pub fn take_outputs(&self, values: &[f32], sources: &[usize]) -> Vec<f32> {
        let Some(last) = self.layers.last() else {
            return vec![];
        };
        let mut taken = values[..last.weights].to_vec();
        for column in values[last.weights..last.bias].chunks_exact(last.outputs.max(1)) {
            taken.extend(sources.iter().map(|source| column[*source]));
        }
        let bias = &values[last.bias..last.bias + last.outputs];
        taken.extend(sources.iter().map(|source| bias[*source]));
        taken
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn outputs_are_taken_in_any_order_and_number() {
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let mlp = Mlp::new(&[3, 5, 4], Activation::Gelu, true);
        let mut parameters = mlp.init(&mut rng, 1.0);
        let bias = parameters.len() - 4;
        (0..4).for_each(|i| parameters[bias + i] = i as f32);
        let sources = [2, 0, 0, 3, 1];
        let wider = mlp.with_outputs(5);
        let taken = mlp.take_outputs(&parameters, &sources);
        assert_eq!(taken.len(), wider.parameters());
        let input = [0.3, -0.7, 1.1];
        let old = mlp
            .infer(&parameters, &input, 1, &mut mlp.workspace(1))
            .to_vec();
        let mut workspace = wider.workspace(1);
        let new = wider.infer(&taken, &input, 1, &mut workspace);
        for (value, source) in new.iter().zip(sources) {
            assert!((value - old[source]).abs() < 1e-6);
        }
    }
}
