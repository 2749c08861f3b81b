//! The score of an evaluation, and its episodes one by one.

use std::path::Path;

use anyhow::Context;
use config::Config;
use wire::EpisodeResult;

use crate::folder;

/// Writes `episodes.csv` and `score.json`; a line that says how it went.
pub(crate) fn write(
    folder: &Path,
    config: &Config,
    results: &[EpisodeResult],
) -> anyhow::Result<String> {
    let n = results.len().max(1) as f64;
    let successes: u32 = results.iter().map(|result| result.success).sum();
    let falls: u32 = results.iter().map(|result| result.fell).sum();
    // D4RL's references for antmaze are 0 and 1, so the score is the share of successes.
    let score = 100.0 * f64::from(successes) / n;
    let arrived = results.iter().filter(|result| result.success == 1);
    let steps: u32 = arrived.map(|result| result.steps).sum();
    let mut csv = String::from("episode,success,steps,fell,nearest_m,edges,reached\n");
    for r in results {
        let [edges, reached] = r.edges;
        csv += &format!(
            "{},{},{},{},{:.3},{edges},{reached}\n",
            r.episode, r.success, r.steps, r.fell, r.nearest
        );
    }
    folder::write(&folder.join("episodes.csv"), csv.as_bytes())?;
    let json = serde_json::json!({
        "score": score,
        "episodes": results.len(),
        "successes": successes,
        "fallen": falls,
        "mean_steps_of_successes": f64::from(steps) / f64::from(successes.max(1)),
        "maze": config.maze.layout,
        "seed": config.run.seed,
        "config": config.hash(),
        "version": env!("CARGO_PKG_VERSION"),
    });
    let text = serde_json::to_string_pretty(&json).context("writing the score")?;
    folder::write(&folder.join("score.json"), text.as_bytes())?;
    let mean = f64::from(steps) / f64::from(successes.max(1));
    Ok(format!(
        "normalized score {score:.1}: {successes} of {} episodes reached the goal, in {mean:.0} \
         steps on average; {falls} ended on the back",
        results.len()
    ))
}
