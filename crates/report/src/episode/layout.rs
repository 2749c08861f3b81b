//! The maze of an episode.

use anyhow::Context;
use maze::Layout;
use trace::Trace;

/// The maze of an episode, by the config in its trace, or by its name if the trace has no config.
pub(super) fn layout(trace: &Trace) -> anyhow::Result<Layout> {
    if trace.meta.config_toml.is_empty()
        && let Ok(layout) = Layout::named(&trace.meta.maze)
    {
        return Ok(layout);
    }
    layout_of(&trace.meta.config_toml).context("the config.toml that the trace holds")
}

/// The maze of a config. Only `[maze]` is read, so that configs of other versions can be used.
pub(crate) fn layout_of(config: &str) -> anyhow::Result<Layout> {
    let missing = "it tells no maze";
    let config: toml::Table = toml::from_str(config).context(missing)?;
    let maze = config.get("maze").and_then(toml::Value::as_table);
    let maze = maze.context(missing)?;
    let name = maze.get("layout").and_then(toml::Value::as_str);
    let rows = maze.get("rows").and_then(toml::Value::as_array);
    let rows = rows.into_iter().flatten();
    let rows: Vec<String> = rows
        .filter_map(|row| row.as_str().map(str::to_owned))
        .collect();
    Ok(Layout::of(name.context(missing)?, &rows)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_tables_of_the_config_are_ignored() {
        let mut trace = Trace::default();
        assert!(layout(&trace).is_err());
        trace.meta.config_toml = "[future]\nx = 1\n[maze]\nlayout = \"large\"\nrows = []\n".into();
        let large = Layout::named("large").unwrap();
        assert_eq!(layout(&trace).unwrap().boxes(), large.boxes());
        trace.meta.config_toml = "[maze]\nlayout = \"nowhere\"\n".into();
        assert!(layout(&trace).is_err());
    }
}
