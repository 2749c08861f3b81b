//! Forward and backward passes.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::{Activation, Layer, Mlp};
use crate::kernel;

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
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
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
