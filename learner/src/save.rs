//! Checkpoints.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use config::Config;
use nets::file::{self, ParameterFile};

/// Saves one module's flat weights with what they belong to.
pub(crate) fn module(
    folder: &Path,
    name: &str,
    config: &Config,
    version: u64,
    weights: &[f32],
) -> anyhow::Result<()> {
    let metadata = BTreeMap::from([
        ("kind".to_owned(), format!("formica {name}")),
        ("version".to_owned(), version.to_string()),
        ("config".to_owned(), config.hash()),
    ]);
    let path = folder
        .join("checkpoints")
        .join(format!("{name}.safetensors"));
    file::save(
        &path,
        &[("weights".to_owned(), vec![weights.len()], weights)],
        &metadata,
    )?;
    Ok(())
}

/// Reads what [`module`] saved, of a network with so many parameters.
pub(crate) fn load(path: &Path, parameters: usize) -> anyhow::Result<Vec<f32>> {
    let told = || path.display().to_string();
    let file = ParameterFile::load(path).with_context(told)?;
    file.tensor("weights", &[parameters]).with_context(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_come_back_and_those_of_another_shape_do_not() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("checkpoints")).unwrap();
        let text = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";
        let config = Config::parse(text, "x.toml", "x", &[]).unwrap();
        module(folder.path(), "low", &config, 3, &[0.5, -1.0]).unwrap();
        let path = folder.path().join("checkpoints/low.safetensors");
        assert_eq!(load(&path, 2).unwrap(), [0.5, -1.0]);
        assert!(load(&path, 3).is_err());
    }
}
