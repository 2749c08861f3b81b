//! Groups of runs that differ only in their seed, and statistics of their scores.

use std::collections::BTreeSet;

use crate::read::Recorded;

/// Runs with one config except for name and seed.
pub struct SeedGroup {
    /// Their common name.
    pub label: String,
    /// The runs, at least one.
    pub runs: Vec<Recorded>,
}

impl SeedGroup {
    fn seeds(&self) -> BTreeSet<i64> {
        self.runs.iter().map(|run| run.seed).collect()
    }

    /// Scores of the runs that have one.
    pub fn scores(&self) -> Vec<f64> {
        self.runs.iter().filter_map(|run| run.score).collect()
    }

    /// Number of seeds and final score, as a short text.
    pub fn note(&self) -> String {
        let (runs, seeds) = (self.runs.len(), self.seeds().len());
        let plural = |count, word| format!("{count} {word}{}", if count == 1 { "" } else { "s" });
        let mut note = plural(seeds, "seed");
        if runs > seeds {
            note = format!("{} of {note}", plural(runs, "run"));
        }
        let scores = self.scores();
        if let Some((mean, std)) = spread(&scores) {
            note += &format!(", score {mean:.1}");
            note += &std.map_or(String::new(), |std| format!(" ± {std:.1}"));
            if scores.len() < runs {
                note += &format!(" ({} of {runs} runs)", scores.len());
            }
        }
        note
    }
}

/// Groups runs, in the order of their first runs. Groups with the same name have their differing keys in
/// their labels.
pub fn grouped(runs: Vec<Recorded>) -> Vec<SeedGroup> {
    let mut groups: Vec<SeedGroup> = vec![];
    for run in runs {
        let same = |group: &&mut SeedGroup| group.runs[0].config == run.config;
        match groups.iter_mut().find(same) {
            Some(group) => group.runs.push(run),
            None => groups.push(SeedGroup {
                label: without_number(&run.name).to_owned(),
                runs: vec![run],
            }),
        }
    }
    let labels: Vec<String> = (0..groups.len())
        .map(|i| {
            let like = |group: &&SeedGroup| group.label == groups[i].label;
            let alike: Vec<&SeedGroup> = groups.iter().filter(like).collect();
            let own = differences(&groups[i], &alike);
            let gap = if own.is_empty() { "" } else { ": " };
            format!("{}{gap}{own}", groups[i].label)
        })
        .collect();
    for (group, label) in groups.iter_mut().zip(labels) {
        group.label = label;
    }
    groups
}

/// A name without its number, as in `-3` or `-seed3` at the end.
fn without_number(name: &str) -> &str {
    let bare = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let stem = bare.strip_suffix("-seed").or(bare.strip_suffix('-'));
    match stem {
        Some(stem) if bare.len() < name.len() && !stem.is_empty() => stem,
        _ => name,
    }
}

/// Keys whose values differ between groups.
pub fn differing<'a>(groups: &[&'a SeedGroup]) -> Vec<&'a String> {
    let configs: Vec<_> = groups.iter().map(|group| &group.runs[0].config).collect();
    let keys: BTreeSet<&String> = configs.iter().flat_map(|config| config.keys()).collect();
    let differs = |key: &&String| {
        configs
            .iter()
            .any(|other| other.get(*key) != configs[0].get(*key))
    };
    keys.into_iter().filter(differs).collect()
}

/// Keys in which a group's config differs from others, with its values.
fn differences(group: &SeedGroup, others: &[&SeedGroup]) -> String {
    let own = differing(others).into_iter();
    let own: Vec<String> = own
        .map(|key| match group.runs[0].config.get(key) {
            Some(value) => format!("{key} = {value}"),
            None => format!("no {key}"),
        })
        .collect();
    own.join(", ")
}

/// Mean and sample standard deviation. A single value has no deviation.
pub fn spread(values: &[f64]) -> Option<(f64, Option<f64>)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    match values.len() {
        0 => None,
        1 => Some((mean, None)),
        _ => Some((mean, Some((squares / (n - 1.0)).sqrt()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(name: &str, seed: i64, updates: u32, score: Option<f64>) -> Recorded {
        let config = [
            ("low.updates", updates.to_string()),
            ("low.batch", "256".into()),
        ];
        Recorded {
            folder: "runs".into(),
            name: name.to_owned(),
            seed,
            layout: "large".to_owned(),
            config: config.map(|(key, value)| (key.to_owned(), value)).into(),
            toml: String::new(),
            metrics: crate::metrics::Metrics::new(),
            score,
        }
    }

    #[test]
    fn runs_with_one_config_are_a_group() {
        let groups = grouped(vec![
            run("a-seed1", 1, 100, None),
            run("b", 1, 200, None),
            run("a-seed2", 2, 100, None),
        ]);
        let seeds: Vec<Vec<i64>> = groups
            .iter()
            .map(|group| group.seeds().into_iter().collect())
            .collect();
        assert_eq!(seeds, [vec![1, 2], vec![1]]);
        let labels: Vec<&str> = groups.iter().map(|group| group.label.as_str()).collect();
        assert_eq!(labels, ["a", "b"]);
    }

    #[test]
    fn labels_of_groups_with_one_name_have_their_differing_keys() {
        let mut runs = vec![run("a-1", 1, 100, None), run("a-2", 1, 200, None)];
        runs[1].config.insert("low.snap".into(), "1.0".into());
        let labels: Vec<String> = grouped(runs).into_iter().map(|group| group.label).collect();
        assert_eq!(
            labels,
            [
                "a: no low.snap, low.updates = 100",
                "a: low.snap = 1.0, low.updates = 200"
            ]
        );
    }

    #[test]
    fn a_number_at_the_end_of_a_name_is_removed() {
        for (name, label) in [
            ("large-3", "large"),
            ("large-seed12", "large"),
            ("large-seed", "large-seed"),
            ("large3", "large3"),
            ("large-", "large-"),
            ("-3", "-3"),
            ("7", "7"),
        ] {
            assert_eq!(without_number(name), label);
        }
    }

    #[test]
    fn spread_is_the_mean_and_the_sample_deviation() {
        assert_eq!(spread(&[]), None);
        assert_eq!(spread(&[3.0]), Some((3.0, None)));
        // Squares of 9, 1, 1, 1, 0, 0, 4, 16 make 32; over 7, not 8.
        let (mean, std) = spread(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]).unwrap();
        assert_eq!(mean, 5.0);
        assert!((std.unwrap() - (32.0_f64 / 7.0).sqrt()).abs() < 1e-12);
    }
}
