//! Records the score of an evaluation, and its episodes.

use std::path::Path;

use anyhow::Context;
use config::Config;
use plot::number::fixed;
use runs::file;
use wire::EpisodeResult;

/// Writes `episodes.csv` and `score.json`, and returns a line with the score.
pub(crate) fn write(
    folder: &Path,
    config: &Config,
    results: &[EpisodeResult],
) -> anyhow::Result<String> {
    let n = results.len().max(1) as f64;
    let successes: u32 = results.iter().map(|result| result.success).sum();
    let falls: u32 = results.iter().map(|result| result.fell).sum();
    // The references of D4RL for antmaze are 0 and 1, so the score is the share of successes.
    let score = 100.0 * f64::from(successes) / n;
    let arrived = results.iter().filter(|result| result.success == 1);
    let steps: u32 = arrived.map(|result| result.steps).sum();
    let mean = (successes > 0).then(|| f64::from(steps) / f64::from(successes));
    let mut csv = String::from("episode,success,steps,fell,nearest_m,edges,reached\n");
    for r in results {
        let [edges, reached] = r.choices;
        csv += &format!(
            "{},{},{},{},{:.3},{edges},{reached}\n",
            r.episode, r.success, r.steps, r.fell, r.nearest
        );
    }
    file::write(&folder.join("episodes.csv"), csv.as_bytes())?;
    let json = serde_json::json!({
        "score": score,
        "episodes": results.len(),
        "successes": successes,
        "fallen": falls,
        "mean_steps_of_successes": mean,
        "maze": config.maze.layout,
        "seed": config.run.seed,
        "config": config.hash(),
        "version": env!("CARGO_PKG_VERSION"),
    });
    let text = serde_json::to_string_pretty(&json).context("writing the score")?;
    file::write(&folder.join("score.json"), text.as_bytes())?;
    Ok(line(results.len(), successes, mean, falls))
}

/// The score as a line.
fn line(episodes: usize, successes: u32, mean_steps: Option<f64>, falls: u32) -> String {
    let score = 100.0 * f64::from(successes) / episodes.max(1) as f64;
    let mean = mean_steps.and_then(|steps| fixed(steps, 0));
    let mean = mean.map_or(String::new(), |mean| {
        format!(", in {mean} steps on average")
    });
    format!(
        "normalized score {score:.1}: {successes} of {episodes} episodes reached the goal{mean}; \
         {falls} ended on the back"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_mean_without_successes() {
        let none = "normalized score 0.0: 0 of 4 episodes reached the goal; 3 ended on the back";
        assert_eq!(line(4, 0, None, 3), none);
        let half = "normalized score 50.0: 2 of 4 episodes reached the goal, in 120 steps on \
                    average; 1 ended on the back";
        assert_eq!(line(4, 2, Some(120.0), 1), half);
        assert!(line(0, 0, None, 0).contains("0 of 0 episodes"));
    }
}
