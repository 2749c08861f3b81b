//! Quarter turns of the plane, exact: they only swap and negate components.

/// The number of quarter turns, anticlockwise, after which straight ahead (1, 0) lies within 45
/// degrees of a direction.
pub(crate) fn quarter_turns([x, y]: [f32; 2]) -> u8 {
    if x.abs() >= y.abs() {
        if x >= 0.0 { 0 } else { 2 }
    } else if y >= 0.0 {
        1
    } else {
        3
    }
}

/// Turns a vector by `turns` quarter turns clockwise.
pub(crate) fn turned_back([x, y]: [f32; 2], turns: u8) -> [f32; 2] {
    match turns % 4 {
        0 => [x, y],
        1 => [y, -x],
        2 => [-x, -y],
        _ => [-y, x],
    }
}

/// Turns a vector by `turns` quarter turns anticlockwise.
pub(crate) fn turned(vector: [f32; 2], turns: u8) -> [f32; 2] {
    turned_back(vector, (4 - turns % 4) % 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_is_turned_to_within_45_degrees_of_straight_ahead() {
        for degrees in (0..360).step_by(7) {
            let (y, x) = (degrees as f32).to_radians().sin_cos();
            let [ahead, side] = turned_back([x, y], quarter_turns([x, y]));
            assert!(ahead >= side.abs(), "{degrees} degrees");
        }
    }

    #[test]
    fn turning_back_is_the_inverse() {
        for turns in 0..=u8::MAX {
            assert_eq!(turned_back(turned([0.3, -0.7], turns), turns), [0.3, -0.7]);
        }
        assert_eq!(turned([1.0, 0.0], 1), [0.0, 1.0]);
    }
}
