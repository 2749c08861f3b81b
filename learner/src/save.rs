//! Checkpoints.

use std::collections::BTreeMap;
use std::path::Path;

use config::Config;
use nets::file;

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
