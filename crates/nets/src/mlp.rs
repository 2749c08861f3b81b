//! Multi-layer perceptrons with an explicit backward pass.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rand::{Rng, RngExt};

use crate::file::{FileError, ParameterFile};
use crate::kernel;

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

/// Buffers of one network for a largest batch, allocated once. The default holds no batch.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    capacity: usize,
    /// Per hidden layer: slope of the activation, then its gradient.
    slopes: Vec<Vec<f32>>,
    /// Per hidden layer: activation, standardised where a norm follows.
    hidden: Vec<Vec<f32>>,
    /// Per hidden layer: output of the norm, empty without one.
    normed: Vec<Vec<f32>>,
    scales: Vec<Vec<f32>>,
    output: Vec<f32>,
    gradients: [Vec<f32>; 2],
}

fn columns(values: &[f32], rows: usize, columns: usize) -> MatRef<'_, f32> {
    MatRef::from_column_major_slice(&values[..rows * columns], rows, columns)
}

fn columns_mut(values: &mut [f32], rows: usize, columns: usize) -> MatMut<'_, f32> {
    MatMut::from_column_major_slice_mut(&mut values[..rows * columns], rows, columns)
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

    /// Buffers for batches of up to `capacity` samples.
    #[must_use]
    pub fn workspace(&self, capacity: usize) -> Workspace {
        let hidden = &self.layers[..self.layers.len().saturating_sub(1)];
        let widest = self
            .layers
            .iter()
            .map(|layer| layer.inputs)
            .max()
            .unwrap_or(0);
        let buffer = |layer: &Layer| vec![0.0; layer.outputs * capacity];
        Workspace {
            capacity,
            slopes: hidden.iter().map(buffer).collect(),
            hidden: hidden.iter().map(buffer).collect(),
            normed: hidden
                .iter()
                .map(|layer| {
                    if layer.norm.is_some() {
                        buffer(layer)
                    } else {
                        vec![]
                    }
                })
                .collect(),
            scales: hidden.iter().map(|_| vec![0.0; capacity]).collect(),
            output: vec![0.0; self.outputs() * capacity],
            gradients: [vec![0.0; widest * capacity], vec![0.0; widest * capacity]],
        }
    }

    /// Outputs `[batch, outputs]` of inputs `[batch, inputs]`, without a later backward pass.
    /// The same arithmetic as [`forward`](Self::forward).
    pub fn infer<'w>(
        &self,
        parameters: &[f32],
        input: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        self.forward(parameters, input, batch, workspace)
    }

    /// Outputs `[batch, outputs]` of inputs `[batch, inputs]`; the workspace keeps what
    /// [`backward`](Self::backward) needs.
    ///
    /// # Panics
    /// When the batch is larger than the workspace's capacity, or the input too short: a fault of
    /// the caller, never of outside data.
    pub fn forward<'w>(
        &self,
        parameters: &[f32],
        input: &[f32],
        batch: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        assert!(
            batch <= workspace.capacity,
            "batch {batch} beyond {}",
            workspace.capacity
        );
        let w = workspace;
        for (k, layer) in self.layers.iter().enumerate() {
            let Layer {
                inputs,
                outputs,
                weights,
                bias,
                norm,
            } = *layer;
            let (before, from) = w.hidden.split_at_mut(k);
            let (normed_before, normed) = w.normed.split_at_mut(k);
            let x: &[f32] = match k {
                0 => input,
                _ if self.layers[k - 1].norm.is_some() => &normed_before[k - 1],
                _ => &before[k - 1],
            };
            let last = k + 1 == self.layers.len();
            let z = if last {
                &mut w.output
            } else {
                &mut w.slopes[k]
            };
            matmul(
                columns_mut(z, outputs, batch),
                Accum::Replace,
                columns(&parameters[weights..], outputs, inputs),
                columns(x, inputs, batch),
                1.0,
                Par::Seq,
            );
            let z = &mut z[..outputs * batch];
            let bias = &parameters[bias..bias + outputs];
            if last {
                kernel::add_bias(z, bias);
                continue;
            }
            let h = &mut from[0][..outputs * batch];
            match self.activation {
                Activation::Gelu => kernel::gelu(z, bias, h),
                Activation::Tanh => kernel::tanh(z, bias, h),
            }
            if let Some(gain) = norm {
                let (gain, shift) = parameters[gain..gain + 2 * outputs].split_at(outputs);
                let y = &mut normed[0][..outputs * batch];
                kernel::layer_norm(h, y, gain, shift, &mut w.scales[k][..batch]);
            }
        }
        &w.output[..self.outputs() * batch]
    }

    /// Adds the gradient of a loss to `gradient`, given its gradient in the outputs of the last
    /// [`forward`](Self::forward) with the same arguments; writes that of the inputs where asked.
    #[allow(clippy::too_many_arguments)]
    pub fn backward(
        &self,
        parameters: &[f32],
        input: &[f32],
        batch: usize,
        workspace: &mut Workspace,
        output_gradient: &[f32],
        gradient: &mut [f32],
        mut input_gradient: Option<&mut [f32]>,
    ) {
        let w = workspace;
        let [mut current, mut next] = w.gradients.each_mut();
        for (k, layer) in self.layers.iter().enumerate().rev() {
            let Layer {
                inputs,
                outputs,
                weights,
                bias,
                norm,
            } = *layer;
            let n = outputs * batch;
            let dz: &[f32] = if k + 1 == self.layers.len() {
                kernel::sum_columns(&output_gradient[..n], &mut gradient[bias..bias + outputs]);
                &output_gradient[..n]
            } else {
                if let Some(at) = norm {
                    let (gain, shift) = gradient[at..at + 2 * outputs].split_at_mut(outputs);
                    kernel::layer_norm_backward(
                        &mut current[..n],
                        &w.hidden[k][..n],
                        &parameters[at..at + outputs],
                        &w.scales[k][..batch],
                        gain,
                        shift,
                    );
                }
                let bias = &mut gradient[bias..bias + outputs];
                kernel::activation_backward(&current[..n], &mut w.slopes[k][..n], bias);
                &w.slopes[k][..n]
            };
            let dz = columns(dz, outputs, batch);
            let x: &[f32] = match k {
                0 => input,
                _ if self.layers[k - 1].norm.is_some() => &w.normed[k - 1],
                _ => &w.hidden[k - 1],
            };
            matmul(
                columns_mut(&mut gradient[weights..], outputs, inputs),
                Accum::Add,
                dz,
                columns(x, inputs, batch).transpose(),
                1.0,
                Par::Seq,
            );
            let target: Option<&mut [f32]> = if k == 0 {
                input_gradient.as_deref_mut()
            } else {
                Some(&mut *next)
            };
            if let Some(target) = target {
                matmul(
                    columns_mut(target, inputs, batch),
                    Accum::Replace,
                    columns(&parameters[weights..], outputs, inputs).transpose(),
                    dz,
                    1.0,
                    Par::Seq,
                );
            }
            std::mem::swap(&mut current, &mut next);
        }
    }

    /// Named tensors of flat parameters, for a parameter file: `prefix.0.weight`, ...
    #[must_use]
    pub fn tensors<'p>(
        &self,
        prefix: &str,
        parameters: &'p [f32],
    ) -> Vec<(String, Vec<usize>, &'p [f32])> {
        let mut tensors = vec![];
        for (k, layer) in self.layers.iter().enumerate() {
            let Layer {
                inputs,
                outputs,
                weights,
                bias,
                norm,
            } = *layer;
            let mut add = |name: &str, shape: Vec<usize>, at: usize| {
                let length = shape.iter().product::<usize>();
                tensors.push((
                    format!("{prefix}.{k}.{name}"),
                    shape,
                    &parameters[at..at + length],
                ));
            };
            // Column-major outputs x inputs is row-major inputs x outputs.
            add("weight", vec![inputs, outputs], weights);
            add("bias", vec![outputs], bias);
            if let Some(at) = norm {
                add("gain", vec![outputs], at);
                add("shift", vec![outputs], at + outputs);
            }
        }
        tensors
    }

    /// Flat parameters from a file's tensors.
    ///
    /// # Errors
    /// A missing tensor, another shape, a value that is not finite.
    pub fn from_tensors(&self, prefix: &str, file: &ParameterFile) -> Result<Vec<f32>, FileError> {
        let mut parameters = vec![0.0; self.parameters];
        let mut at = 0;
        let template = parameters.clone();
        for (name, shape, values) in self.tensors(prefix, &template) {
            let found = file.tensor(&name, &shape)?;
            parameters[at..at + values.len()].copy_from_slice(&found);
            at += values.len();
        }
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::Adam;

    /// Half the squared outputs, weighted, as a loss.
    fn loss(mlp: &Mlp, parameters: &[f32], input: &[f32], w: &mut Workspace) -> f64 {
        let out = mlp.forward(parameters, input, input.len() / mlp.inputs(), w);
        out.iter()
            .enumerate()
            .map(|(i, y)| 0.5 * (1.0 + 0.1 * (i % 7) as f64) * f64::from(*y).powi(2))
            .sum()
    }

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

    #[test]
    fn gradients_match_finite_differences() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for activation in [Activation::Gelu, Activation::Tanh] {
            for norm in [false, true] {
                let mlp = Mlp::new(&[5, 24, 17, 3], activation, norm);
                let parameters = mlp.init(&mut rng, 1.0);
                let input: Vec<f32> = (0..5 * 9).map(|_| rng.random_range(-1.0..1.0)).collect();
                let mut w = mlp.workspace(16);
                let out = mlp.forward(&parameters, &input, 9, &mut w).to_vec();
                let slope: Vec<f32> = out
                    .iter()
                    .enumerate()
                    .map(|(i, y)| (1.0 + 0.1 * (i % 7) as f32) * y)
                    .collect();
                let mut gradient = vec![0.0; mlp.parameters()];
                let mut input_gradient = vec![0.0; input.len()];
                mlp.backward(
                    &parameters,
                    &input,
                    9,
                    &mut w,
                    &slope,
                    &mut gradient,
                    Some(&mut input_gradient),
                );
                let mut check = |values: &[f32], gradient: &[f32], of_input: bool| {
                    let direction: Vec<f32> =
                        values.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
                    let analytic: f64 = gradient
                        .iter()
                        .zip(&direction)
                        .map(|(g, d)| f64::from(*g) * f64::from(*d))
                        .sum();
                    let step = 1e-3;
                    let mut at = |sign: f32| {
                        let moved: Vec<f32> = values
                            .iter()
                            .zip(&direction)
                            .map(|(v, d)| v + sign * step * d)
                            .collect();
                        if of_input {
                            loss(&mlp, &parameters, &moved, &mut w)
                        } else {
                            loss(&mlp, &moved, &input, &mut w)
                        }
                    };
                    let numeric = (at(1.0) - at(-1.0)) / f64::from(2.0 * step);
                    let error = (numeric - analytic).abs() / analytic.abs().max(0.5);
                    assert!(
                        error < 0.02,
                        "{activation:?} {norm}: {analytic} and {numeric}"
                    );
                };
                check(&parameters, &gradient, false);
                check(&input, &input_gradient, true);
            }
        }
    }

    #[test]
    fn gradients_accumulate() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let mlp = Mlp::new(&[2, 4, 1], Activation::Gelu, true);
        let parameters = mlp.init(&mut rng, 1.0);
        let mut w = mlp.workspace(1);
        let mut once = vec![0.0; mlp.parameters()];
        mlp.forward(&parameters, &[0.3, 0.4], 1, &mut w);
        mlp.backward(&parameters, &[0.3, 0.4], 1, &mut w, &[1.0], &mut once, None);
        let mut twice = once.clone();
        mlp.forward(&parameters, &[0.3, 0.4], 1, &mut w);
        mlp.backward(
            &parameters,
            &[0.3, 0.4],
            1,
            &mut w,
            &[1.0],
            &mut twice,
            None,
        );
        for (one, two) in once.iter().zip(&twice) {
            assert!((2.0 * one - two).abs() < 1e-6);
        }
    }

    #[test]
    fn a_small_network_learns_the_sine() {
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mlp = Mlp::new(&[1, 32, 32, 1], Activation::Gelu, false);
        let mut parameters = mlp.init(&mut rng, 1.0);
        let mut adam = Adam::new(mlp.parameters(), 3e-3);
        let mut w = mlp.workspace(64);
        let mut error = 0.0;
        for _ in 0..1500 {
            let x: Vec<f32> = (0..64).map(|_| rng.random_range(-3.0..3.0)).collect();
            let out = mlp.forward(&parameters, &x, 64, &mut w);
            let slope: Vec<f32> = out
                .iter()
                .zip(&x)
                .map(|(y, x)| 2.0 / 64.0 * (y - x.sin()))
                .collect();
            error = slope.iter().map(|s| (s * 32.0).powi(2)).sum::<f32>() / 64.0;
            let mut gradient = vec![0.0; mlp.parameters()];
            mlp.backward(&parameters, &x, 64, &mut w, &slope, &mut gradient, None);
            adam.step(&mut parameters, &gradient);
        }
        assert!(error < 1e-3, "mean squared error {error}");
    }
}
