//! Learning curves of several runs, with mean and deviation over seeds.

use plot::chart::{Chart, Series};
use runs::read::Recorded;
use runs::seeds::{SeedGroup, spread};

/// The metric of test episodes. Its rows are single episodes: 0, or 100 if the goal was reached. Rows of
/// other metrics are already means.
pub const SCORE: &str = "rollout/score";
/// Episodes per point. The standard error of this many is at most 11 points.
const EPISODES: usize = 20;
/// Intervals of the common grid of time, which ends at the last row of the longest run.
const GRID: usize = 200;

/// The mean of the newest `window` rows at each point of the grid. `None` before there are as many rows, so
/// that no point is noisier than others, and after the first point that includes the last row. A run with
/// fewer rows has the mean of all.
fn resample(rows: &[[f64; 2]], window: usize, grid: &[f64]) -> Vec<Option<f64>> {
    let window = window.min(rows.len());
    let mut over = false;
    grid.iter()
        .map(|x| {
            let seen = rows.partition_point(|[seconds, _]| seconds <= x);
            if seen < window || over {
                return None;
            }
            over = seen == rows.len();
            let newest = rows[seen - window..seen].iter().map(|[_, value]| value);
            Some(newest.sum::<f64>() / window as f64)
        })
        .collect()
}

/// The chart of a metric. A run without this metric has no line.
pub fn chart(groups: &[SeedGroup], metric: &str) -> Chart {
    let runs = || groups.iter().flat_map(|group| &group.runs);
    let last = |run: &Recorded| run.rows(metric).last().map_or(0.0, |[seconds, _]| *seconds);
    let longest = runs().map(last).fold(1.0, f64::max);
    // In this order the last point equals the last row's time exactly.
    let grid: Vec<f64> = (0..=GRID)
        .map(|i| longest * (i as f64 / GRID as f64))
        .collect();
    let most = runs().map(|run| run.rows(metric).len()).max().unwrap_or(0);
    let episodes = metric == SCORE;
    let least = if episodes { EPISODES } else { 1 };
    // With more rows than points, no row may be left out between two points.
    let window = least.max(most.div_ceil(GRID));
    let mut mazes: Vec<&str> = runs().map(|run| run.layout.as_str()).collect();
    mazes.sort_unstable();
    mazes.dedup();
    let (what, y_label) = match metric {
        SCORE => ("Score in training", "score (% of episodes at the goal)"),
        _ => (metric, metric),
    };
    let mut subtitle = match window {
        1 => "values as they are".to_owned(),
        _ if episodes => format!("mean of the newest {window} episodes"),
        _ => format!("mean of the newest {window} values"),
    };
    if runs().any(|run| (1..window).contains(&run.rows(metric).len())) {
        subtitle += ", or of all if fewer";
    }
    if groups.iter().any(|group| group.runs.len() > 1) {
        subtitle += "; bold and band: mean ± 1 std of the runs; thin: each run";
    }
    if metric == SCORE && runs().any(|run| run.score.is_some()) {
        subtitle += "; dots: final scores";
    }
    let plural = if mazes.len() > 1 { "s" } else { "" };
    Chart {
        title: format!("{what}, maze{plural} {}", mazes.join(", ")),
        subtitle,
        x_label: "time since the start (minutes)".to_owned(),
        y_label: y_label.to_owned(),
        x_end: longest / 60.0,
        y_range: (metric == SCORE).then_some([0.0, 100.0]),
        series: groups
            .iter()
            .map(|group| series(group, metric, window, &grid))
            .collect(),
    }
}

/// The lines of a group. Mean and band are drawn where all runs have a value: a run that starts late or
/// ends early would make them jump.
fn series(group: &SeedGroup, metric: &str, window: usize, grid: &[f64]) -> Series {
    let runs = || {
        let runs = group.runs.iter();
        runs.filter(|run| !run.rows(metric).is_empty())
    };
    let curves: Vec<Vec<Option<f64>>> = runs()
        .map(|run| resample(run.rows(metric), window, grid))
        .collect();
    let mut series = Series {
        label: group.label.clone(),
        note: group.note(),
        ..Series::default()
    };
    let minutes = |i: usize| grid[i] / 60.0;
    for i in 0..grid.len() {
        let values: Option<Vec<f64>> = curves.iter().map(|curve| curve[i]).collect();
        if let Some((mean, std)) = values.and_then(|values| spread(&values)) {
            series.bold.push([minutes(i), mean]);
            let band = std.map(|std| [minutes(i), mean - std, mean + std]);
            series.band.extend(band);
        }
    }
    for (run, curve) in runs().zip(&curves) {
        let points = curve.iter().enumerate();
        let points = points.filter_map(|(i, value)| value.map(|value| [minutes(i), value]));
        let points: Vec<[f64; 2]> = points.collect();
        if let (true, Some(score), Some([end, _])) = (metric == SCORE, run.score, points.last()) {
            series.dots.push([*end, score]);
        }
        if curves.len() > 1 {
            series.thin.push(points);
        }
    }
    series
}

#[cfg(test)]
mod tests {
    use runs::metrics::Metric;
    use runs::seeds::grouped;

    use super::*;

    #[test]
    fn a_series_is_resampled_to_the_mean_of_its_newest_rows() {
        let rows = [[1.0, 0.0], [2.0, 100.0], [2.0, 0.0], [5.0, 100.0]];
        let grid = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0];
        // There are two rows from 2 s on. The last one is included at 6 s.
        let expected = [
            None,
            None,
            Some(50.0),
            Some(50.0),
            Some(50.0),
            Some(50.0),
            None,
        ];
        assert_eq!(resample(&rows, 2, &grid), expected);
        let third = 100.0 / 3.0;
        let values = resample(&rows, 3, &grid);
        assert_eq!(values[1..3], [None, Some(third)]);
        assert_eq!(values[5], Some(200.0 / 3.0));
        // A run with fewer rows than the window: the mean of all.
        let expected = [None, None, None, None, None, Some(50.0), None];
        assert_eq!(resample(&rows, 20, &grid), expected);
    }

    /// Episodes at 1 s, 2 s and so on.
    fn recorded(seed: i64, values: &[f64], score: Option<f64>) -> Recorded {
        let rows = values.iter().zip(1_u32..);
        Recorded {
            folder: "runs".into(),
            name: "a".into(),
            seed,
            layout: "large".into(),
            config: std::collections::BTreeMap::new(),
            toml: String::new(),
            metrics: [SCORE, "low/value_loss"]
                .map(|name| {
                    let rows = rows.clone().map(|(v, i)| [f64::from(i), *v]);
                    let rows = rows.collect();
                    (name.to_owned(), Metric { rows, left_out: 0 })
                })
                .into(),
            score,
        }
    }

    #[test]
    fn the_mean_is_drawn_where_all_runs_of_a_group_have_a_value() {
        let runs = vec![
            recorded(0, &[100.0; 200], Some(90.0)),
            recorded(1, &[0.0; 100], None),
        ];
        let chart = chart(&grouped(runs), SCORE);
        let series = &chart.series[0];
        let near = |value: f64, minutes: f64| (value * 60.0 - minutes * 60.0).abs() < 1e-6;
        let ends = |line: &[[f64; 2]]| (line[0][0] * 60.0, line[line.len() - 1][0] * 60.0);
        assert_eq!(ends(&series.bold), (20.0, 100.0));
        assert_eq!(ends(&series.thin[0]), (20.0, 200.0));
        assert!(series.bold.iter().all(|[_, mean]| *mean == 50.0));
        let deviation = 5000.0_f64.sqrt();
        for [_, low, high] in &series.band {
            assert!(near(*low, 50.0 - deviation) && near(*high, 50.0 + deviation));
        }
        assert_eq!(series.band.len(), series.bold.len());
        // The only score, at the end of its run.
        assert_eq!(series.dots.len(), 1);
        assert!(near(series.dots[0][0], 200.0 / 60.0) && series.dots[0][1] == 90.0);
    }

    #[test]
    fn the_last_row_is_always_on_the_grid() {
        // Multiplied by 200 and divided by 200, the second and the third become smaller.
        for seconds in [12.3, 248.47588267567355, 107.44303616188411] {
            let mut run = recorded(0, &[100.0], None);
            run.metrics.get_mut(SCORE).unwrap().rows[0][0] = seconds;
            let chart = chart(&grouped(vec![run]), SCORE);
            assert_eq!(chart.series[0].bold.len(), 1, "{seconds}");
            assert!(chart.subtitle.contains("or of all if fewer"));
        }
    }

    #[test]
    fn one_run_has_no_band_and_other_metrics_have_no_dots() {
        let runs = || vec![recorded(0, &[3.0; 50], Some(90.0))];
        let score = chart(&grouped(runs()), SCORE);
        assert_eq!(
            score.subtitle,
            "mean of the newest 20 episodes; dots: final scores"
        );
        assert_eq!(score.series[0].dots.len(), 1);
        assert!(score.series[0].band.is_empty() && score.series[0].thin.is_empty());
        let loss = chart(&grouped(runs()), "low/value_loss");
        assert_eq!(loss.subtitle, "values as they are");
        assert!(loss.series[0].dots.is_empty());
        assert_eq!(loss.y_range, None);
    }
}
