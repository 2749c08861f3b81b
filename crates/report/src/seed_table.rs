//! Scores of groups of runs as a table of text.

use plot::table::aligned;
use runs::read::Recorded;
use runs::seeds::{SeedGroup, spread};

/// A line for each group, with aligned columns.
pub fn table(groups: &[SeedGroup]) -> String {
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    let list = |of: &dyn Fn(&Recorded) -> String, group: &SeedGroup| {
        let texts: Vec<String> = group.runs.iter().map(of).collect();
        texts.join(" ")
    };
    let header = [
        "group", "runs", "seeds", "scores", "mean", "std", "min", "max",
    ];
    let mut lines = vec![header.map(str::to_owned)];
    for group in groups {
        let scores = group.scores();
        let (mean, std) = spread(&scores).unzip();
        lines.push([
            group.label.clone(),
            group.runs.len().to_string(),
            list(&|run| run.seed.to_string(), group),
            list(&|run| number(run.score), group),
            number(mean),
            number(std.flatten()),
            number(scores.iter().copied().reduce(f64::min)),
            number(scores.iter().copied().reduce(f64::max)),
        ]);
    }
    aligned(&lines)
}

#[cfg(test)]
mod tests {
    use runs::metrics::Metrics;
    use runs::seeds::grouped;

    use super::*;

    fn run(name: &str, seed: i64, updates: u32, score: Option<f64>) -> Recorded {
        Recorded {
            folder: "runs".into(),
            name: name.to_owned(),
            seed,
            layout: "large".to_owned(),
            config: [("low.updates".to_owned(), updates.to_string())].into(),
            toml: String::new(),
            metrics: Metrics::new(),
            score,
        }
    }

    #[test]
    fn the_table_has_a_line_for_each_group() {
        let groups = grouped(vec![
            run("a-1", 1, 100, Some(80.0)),
            run("a-2", 2, 100, Some(90.0)),
            run("a-3", 3, 100, None),
            run("long", 0, 200, None),
        ]);
        let expected = "\
group  runs  seeds       scores  mean  std   min   max
a         3  1 2 3  80.0 90.0 -  85.0  7.1  80.0  90.0
long      1      0            -     -    -     -     -
";
        assert_eq!(table(&groups), expected);
        assert_eq!(groups[0].note(), "3 seeds, score 85.0 ± 7.1 (2 of 3 runs)");
        assert_eq!(groups[1].note(), "1 seed");
    }
}
