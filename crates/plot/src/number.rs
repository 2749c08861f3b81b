//! Numbers as text.

/// A number with `decimals` decimals and without negative zero; `None` if it is not finite.
pub fn fixed(value: f64, decimals: usize) -> Option<String> {
    if !value.is_finite() {
        return None;
    }
    let text = format!("{value:.decimals$}");
    let zero = !text.contains(|c: char| ('1'..='9').contains(&c));
    Some(match text.strip_prefix('-') {
        Some(positive) if zero => positive.to_owned(),
        _ => text,
    })
}

/// The same value, with negative zero made zero.
pub fn unsigned_zero(value: f32) -> f32 {
    value + 0.0
}

/// The sum; 0 for no values, where `Iterator::sum` is -0.
pub fn sum(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(0.0, |total, value| total + value)
}

/// The parts that are `Some`, separated by commas.
pub fn listed<const N: usize>(parts: [Option<String>; N]) -> String {
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_negative_zero_and_no_text_for_what_is_not_finite() {
        let text = |value, decimals| fixed(value, decimals).unwrap();
        assert_eq!(text(-0.0, 0), "0");
        assert_eq!(text(-0.04, 1), "0.0");
        assert_eq!(text(-0.05, 2), "-0.05");
        assert_eq!(text(Vec::<f64>::new().iter().sum(), 1), "0.0");
        assert_eq!(text(-10.0, 0), "-10");
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(fixed(value, 1), None);
        }
        assert!(unsigned_zero(-0.0).is_sign_positive());
        assert_eq!(unsigned_zero(-1.0), -1.0);
        assert!(sum(std::iter::empty()).is_sign_positive());
        assert_eq!(sum([1.0, -3.0].into_iter()), -2.0);
        let parts = [Some("a".to_owned()), None, Some("b".to_owned())];
        assert_eq!(listed(parts), "a, b");
    }
}
