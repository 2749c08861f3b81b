//! Tick positions of an axis, and their labels.

/// Multiples of 1, 2 or 5 times a power of ten that cover `low` to `high`, in at most `intervals`
/// intervals.
pub(crate) fn ticks(mut low: f64, mut high: f64, intervals: usize) -> Vec<f64> {
    let scale = low.abs().max(high.abs());
    // Values that hardly differ get a margin around them.
    if high - low <= (1e-9 * scale).max(1e-100) {
        let room = if scale > 1e-100 { 0.1 * scale } else { 1.0 };
        (low, high) = (low - room, high + room);
    }
    let mut power = ((high - low) / intervals as f64).log10().floor() as i32;
    loop {
        for factor in [1, 2, 5] {
            // Dividing by a power of ten rounds correctly; multiplying by 0.1 does not.
            let scaled = |value: f64| match 10_f64.powi(power.abs()) {
                ten if power < 0 => value * ten / f64::from(factor),
                ten => value / ten / f64::from(factor),
            };
            let first = (scaled(low) + 1e-9).floor() as i64;
            let last = (scaled(high) - 1e-9).ceil() as i64;
            if last - first <= intervals as i64 {
                let value = |i| match (i * i64::from(factor)) as f64 {
                    whole if power < 0 => whole / 10_f64.powi(-power),
                    whole => whole * 10_f64.powi(power),
                };
                return (first..=last).map(value).collect();
            }
        }
        power += 1;
    }
}

/// Labels of ticks: all in plain notation, or all with powers of ten.
pub(crate) fn labels(ticks: &[f64]) -> Vec<String> {
    let most = ticks
        .iter()
        .fold(0.0, |most: f64, tick| most.max(tick.abs()));
    let plain = (1e-3..1e6).contains(&most);
    let label = |tick: &f64| match plain || *tick == 0.0 {
        true => tick.to_string(),
        false => format!("{tick:e}"),
    };
    ticks.iter().map(label).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        let text = |low, high| labels(&ticks(low, high, 8)).join(" ");
        assert_eq!(text(0.0, 100.0), "0 20 40 60 80 100");
        assert_eq!(text(0.0, 0.7), "0 0.1 0.2 0.3 0.4 0.5 0.6 0.7");
        assert_eq!(text(-0.3, 0.31), "-0.3 -0.2 -0.1 0 0.1 0.2 0.3 0.4");
        assert_eq!(text(0.0, 3e-7), "0 5e-8 1e-7 1.5e-7 2e-7 2.5e-7 3e-7");
        assert_eq!(text(0.0, 2.1e9), "0 5e8 1e9 1.5e9 2e9 2.5e9");
        assert_eq!(text(85.0, 85.0), "75 80 85 90 95");
        assert_eq!(text(0.0, 0.0), "-1 -0.5 0 0.5 1");
        for exponent in -12..12 {
            for lead in [1.0, 1.3, 2.0, 3.7, 5.0, 9.99] {
                for share in [0.0, -0.4, 0.5, 0.99] {
                    let high = lead * 10_f64.powi(exponent);
                    let ticks = ticks(share * high, high, 8);
                    let slack = 1e-8 * high;
                    assert!(ticks[0] <= share * high + slack, "{ticks:?}");
                    assert!(ticks[ticks.len() - 1] >= high - slack, "{ticks:?}");
                    assert!((3..=9).contains(&ticks.len()), "{ticks:?}");
                    // A round step is 1, 2 or 5 followed by zeros.
                    let step = format!("{:.6e}", ticks[1] - ticks[0]);
                    let digits = step.split('e').next().unwrap().trim_matches(['0', '.']);
                    assert!(["1", "2", "5"].contains(&digits), "{ticks:?}");
                }
            }
        }
        // Extreme ranges terminate with finite ticks.
        for (low, high) in [(-1e100, 1e100), (0.0, 1e-99), (1e9, 1e9 + 1e-6)] {
            let ticks = ticks(low, high, 8);
            assert!(ticks.iter().all(|tick| tick.is_finite()), "{ticks:?}");
            assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]), "{ticks:?}");
        }
    }
}
