//! When the way over an edge is given up.

/// When an edge is given up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeTimeout {
    /// After this many times its steps,
    pub factor: f32,
    /// and after this many steps at most.
    pub most: usize,
}

/// Short edges too need the time to turn round.
const LEAST: usize = 15;

impl EdgeTimeout {
    /// Steps after which an edge that takes `steps` is given up.
    #[must_use]
    pub fn limit(&self, steps: f32) -> usize {
        let limit = (self.factor * steps).ceil() as usize;
        limit.max(LEAST).min(self.most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_lies_between_the_least_and_the_most() {
        let timeout = EdgeTimeout {
            factor: 2.0,
            most: 40,
        };
        assert_eq!(
            [3.0, 12.2, 90.0].map(|steps| timeout.limit(steps)),
            [15, 25, 40]
        );
    }
}
