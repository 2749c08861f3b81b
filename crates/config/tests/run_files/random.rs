//! Random sound configs, which the resolved file gives again.

use proptest::prelude::*;

use agents::CONFIGS;
use config::Config;

/// A key with a sound value of it, as TOML.
fn line() -> impl Strategy<Value = String> {
    let word = |key: &'static str, words: &'static [&'static str]| {
        prop::sample::select(words).prop_map(move |word| format!("{key} = \"{word}\""))
    };
    let count = |key: &'static str, range: std::ops::RangeInclusive<u64>| {
        (range, 0..3).prop_map(move |(count, form)| match form {
            0 => format!("{key} = {count}"),
            1 => format!("{key} = {count}.0"),
            _ => format!("{key} = 0x{count:x}"),
        })
    };
    let number = |key: &'static str, range: std::ops::Range<f64>| {
        range.prop_map(move |number| format!("{key} = {number:?}"))
    };
    let path = |key: &'static str| {
        // Of variables, one is set wherever this runs.
        "[a-zA-Zäé ~$.'-]{0,6}(\\$\\{PATH\\}|/)[a-z\"$]{1,6}".prop_map(move |path| {
            let path = path.replace('$', "$$").replace("$${PATH}", "${PATH}");
            let path = path.trim_start_matches('~').to_owned();
            format!("{key} = {}", toml::Value::String(path))
        })
    };
    prop_oneof![
        word("run.name", &["a", "x-1", "_", "2024-05-01", "true"]),
        count("run.seed", 0..=4_294_967_295),
        number("run.checkpoint_seconds", 0.0..86_400.0),
        word(
            "maze.layout",
            &["umaze", "medium", "large", "giant", "teleport"]
        ),
        count("topology.window", 1..=64),
        number("actor.pause_seconds", 0.0..86_400.0),
        path("dataset.path"),
        number("collect.noise", 0.0..2.0),
        number("encoder.learning_rate", 0.0..1.0),
        number("low.weight_clip", 1.0..1e6),
        prop::collection::vec(1_usize..4096, 1..8).prop_map(|l| format!("low.hidden = {l:?}")),
        prop::collection::vec([0_usize..9, 0..9], 0..4)
            .prop_map(|l| format!("dataset.leave_out = {l:?}")),
        word("graph.knowledge", &["none", "data", "rollouts"]),
        count("high.steps", 1..=10_000_000_000),
        number("high.clip", 0.01..1.0),
        any::<bool>().prop_map(|flag| format!("graph.online = {flag}")),
        any::<bool>().prop_map(|flag| format!("traces.evaluation = {flag}")),
        count("evaluation.episodes", 1..=1024),
        number("execution.reached_radius", 0.1..10.0),
    ]
}

proptest! {
    #[test]
    fn the_resolved_file_is_its_own(
        lines in prop::collection::btree_map("[a-z]", line(), 0..8),
        walker in any::<bool>(),
    ) {
        let key = |line: &String| line.split(' ').next().unwrap_or_default().to_owned();
        let unique: std::collections::BTreeMap<String, String> =
            lines.values().map(|line| (key(line), line.clone())).collect();
        let mut text = unique.values().cloned().collect::<Vec<_>>().join("\n");
        text.push_str(if walker { "\nrun.algorithm = \"walker\"\n" } else { "\n" });
        if !unique.contains_key("dataset.path") {
            text.push_str("dataset.path = \"x\"\n");
        }
        if !unique.contains_key("collect.noise") {
            text.push_str("[collect]\n");
        }
        let Ok(config) = CONFIGS.parse(&text, "x.toml", "x", &[]) else {
            // A path may begin with what is filled in and not set.
            return Err(TestCaseError::fail(format!(
                "{text}\n{}", CONFIGS.parse(&text, "x.toml", "x", &[]).unwrap_err()
            )));
        };
        let again = CONFIGS.parse(config.resolved(), "y.toml", "y", &[]);
        prop_assert_eq!(again.as_ref().map(Config::resolved), Ok(config.resolved()));
        prop_assert_eq!(again.unwrap(), config);
    }
}
