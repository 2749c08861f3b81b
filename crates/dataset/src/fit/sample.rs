//! Rows to look at where looking at all of them would take long.

/// At most about `most` of `n` rows, ascending: all where they are few, else one of each stretch,
/// never at one place of it, so that no period of the data is met.
pub(super) fn rows(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let stretch = n.div_ceil(most.max(1)).max(1);
    (0..n.div_ceil(stretch)).map(move |number| {
        let scattered = (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        let row = number * stretch + scattered as usize % stretch;
        row.min(n - 1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_rows_are_all_looked_at_and_many_evenly() {
        assert_eq!(rows(0, 10).count(), 0);
        assert_eq!(rows(7, 10).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
        let some: Vec<usize> = rows(1_000_003, 1000).collect();
        assert!(some.len() >= 999 && some.len() <= 1000);
        assert!(
            some.windows(2)
                .all(|pair| pair[0] < pair[1] && pair[1] - pair[0] < 2100)
        );
        assert!(some.iter().any(|row| row % 1001 > 900));
    }
}
