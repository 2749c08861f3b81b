//! The graph-builder.
#[derive(Debug, Clone, clap::Args)]
pub struct Args { #[arg(long)] pub domain: String, #[arg(long)] pub folder: std::path::PathBuf }
pub fn run(_a: &Args, _s: &std::sync::Arc<std::sync::atomic::AtomicBool>) -> anyhow::Result<()> { anyhow::bail!("no") }
