//! How good each stage is, and which one limits a run the most.

use std::collections::BTreeMap;

use config::Config;
use plot::number::fixed;
use runs::metrics::Newest;
use runs::times::Times;

use super::summary;

/// Quality of each stage from 0 to 1, as far as it was measured.
fn qualities(config: &Config, newest: &Newest) -> Vec<(&'static str, f64)> {
    let stages = summary(&config.values(), newest).into_iter();
    stages
        .filter_map(|stage| Some((stage.name, stage.quality?.clamp(0.0, 1.0))))
        .collect()
}

/// A sentence about the stage of the lowest quality; `None` if nothing was measured, or all is well.
pub fn weakest(config: &Config, newest: &Newest) -> Option<String> {
    let qualities = qualities(config, newest);
    let (stage, quality) = qualities.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let percent = fixed(100.0 * quality, 0).filter(|_| *quality < 0.995)?;
    Some(format!(
        "the weakest stage is {stage}, at {percent}% of what it could be worth; stages.json has all"
    ))
}

/// `stages.json`.
pub fn json(config: &Config, newest: &Newest, times: &Times) -> serde_json::Value {
    serde_json::json!({
        "seconds": {
            "collect": times.collect.as_secs_f64(),
            "train": times.train.as_secs_f64(),
            "rollouts": times.rollouts.as_secs_f64(),
            "evaluate": times.evaluate.as_secs_f64(),
        },
        "quality": qualities(config, newest).into_iter().collect::<BTreeMap<_, _>>(),
        "metrics": newest,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weakest_stage_is_named_with_its_quality() {
        let text = "[dataset]\npath = \"x\"\n[collect]\n";
        let config = agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap();
        let weakest = |newest: &Newest| weakest(&config, newest);
        let mut newest = Newest::new();
        assert_eq!(weakest(&newest), None, "nothing was measured");
        newest.insert("graph/coverage".to_owned(), 1.0);
        assert_eq!(weakest(&newest), None, "nothing is amiss");
        newest.insert("encoder/place_error_m".to_owned(), 400.0);
        newest.insert("graph/edge_success".to_owned(), 0.337);
        newest.insert("high/greedy_arrived".to_owned(), f64::NAN);
        let text = weakest(&newest).unwrap();
        assert!(
            text.starts_with("the weakest stage is encoder, at 0% of"),
            "{text}"
        );
        newest.insert("encoder/place_error_m".to_owned(), 0.1);
        let text = weakest(&newest).unwrap();
        assert!(text.contains("stage is low, at 34% of"), "{text}");
        let quality = &json(&config, &newest, &Times::default())["quality"];
        assert_eq!(quality["low"], 0.337);
        assert!(quality.get("high").is_none());
    }
}
