//! Random streams: one for each purpose, seed and index, none of which overlap.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// The generator of a run's `seed` for a `purpose` and an `index`, as an episode's number. Different
/// arguments give unrelated streams: all of them go through a hash, so that neighbouring seeds share
/// nothing.
#[must_use]
pub fn stream(seed: u64, purpose: &str, index: u64) -> Pcg64Mcg {
    Pcg64Mcg::from_seed(state(seed, purpose, index).to_le_bytes())
}

/// The same as a number, for what takes a seed.
#[must_use]
pub fn seed(seed: u64, purpose: &str, index: u64) -> u64 {
    (state(seed, purpose, index) >> 64) as u64
}

fn state(seed: u64, purpose: &str, index: u64) -> u128 {
    let mut state = mix(seed ^ 0x9e37_79b9_7f4a_7c15);
    for byte in purpose.bytes() {
        state = mix(state ^ u64::from(byte));
    }
    // The length keeps a purpose apart from one that begins with it.
    state = mix(state ^ purpose.len() as u64);
    let low = mix(state ^ index);
    let high = mix(low ^ state.rotate_left(32));
    u128::from(high) << 64 | u128::from(low)
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, 2014), with its increment.
fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let value = (value ^ value >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ value >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ value >> 31
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use rand::RngExt;

    use super::*;

    #[test]
    fn no_two_arguments_share_a_stream() {
        let mut seen = HashSet::new();
        for seed in 0..50 {
            for purpose in ["encoder", "low", "high", "evaluation", "eval"] {
                for index in 0..50 {
                    let first: u64 = stream(seed, purpose, index).random();
                    assert!(seen.insert(first), "{seed} {purpose} {index}");
                }
            }
        }
    }

    #[test]
    fn the_same_arguments_give_the_same_stream() {
        let draw = || stream(7, "low", 3).random::<u64>();
        assert_eq!(draw(), draw());
    }
}
