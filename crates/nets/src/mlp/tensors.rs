//! Parameters as named tensors of a file.

use super::{Layer, Mlp};
use crate::file::{FileError, ParameterFile};

impl Mlp {
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
