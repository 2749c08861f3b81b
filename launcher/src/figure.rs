//! Figures in text for people.

/// A figure with so many decimals and no negative zero; none where it is not finite.
pub(crate) fn figure(value: f64, decimals: usize) -> Option<String> {
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

/// The same value; of a zero without its sign.
pub(crate) fn unsigned_zero(value: f32) -> f32 {
    value + 0.0
}

/// A sum that is 0 where there is nothing to add: that of `Iterator::sum` is -0.
pub(crate) fn total(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(0.0, |sum, value| sum + value)
}

/// The parts that there are, with commas between them.
pub(crate) fn listed<const N: usize>(parts: [Option<String>; N]) -> String {
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_negative_zero_and_nothing_that_is_no_number() {
        let told = |value, decimals| figure(value, decimals).unwrap();
        assert_eq!(told(-0.0, 0), "0");
        assert_eq!(told(-0.04, 1), "0.0");
        assert_eq!(told(-0.05, 2), "-0.05");
        assert_eq!(told(Vec::<f64>::new().iter().sum(), 1), "0.0");
        assert_eq!(told(-10.0, 0), "-10");
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(figure(value, 1), None);
        }
        assert!(unsigned_zero(-0.0).is_sign_positive());
        assert_eq!(unsigned_zero(-1.0), -1.0);
        assert!(total(std::iter::empty()).is_sign_positive());
        assert_eq!(total([1.0, -3.0].into_iter()), -2.0);
        let parts = [Some("a".to_owned()), None, Some("b".to_owned())];
        assert_eq!(listed(parts), "a, b");
    }
}
