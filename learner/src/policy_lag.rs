//! How old the weights of the rollouts are.

use wire::{Metric, Reporter, Role, TrajectoryHeader};

/// Ages of rollouts, in versions of the network that learns from them.
pub(crate) struct PolicyLag {
    /// The network, by number; none where nothing learns from rollouts.
    network: Option<usize>,
    /// Older rollouts are not learned from.
    limit: u64,
    trajectories: u64,
    sum: u64,
    most: u64,
    /// Trajectories that were too old, in all.
    stale: u64,
}

impl PolicyLag {
    pub(crate) fn new(network: Option<usize>, limit: usize) -> Self {
        Self {
            network,
            limit: limit as u64,
            trajectories: 0,
            sum: 0,
            most: 0,
            stale: 0,
        }
    }

    /// Counts a rollout. Returns whether it is to be learned from.
    pub(crate) fn admits(&mut self, header: &TrajectoryHeader, current: &wire::Versions) -> bool {
        let Some(network) = self.network else {
            return false;
        };
        let age = current[network].saturating_sub(header.versions[network]);
        self.trajectories += 1;
        self.sum += age;
        self.most = self.most.max(age);
        let stale = age > self.limit;
        self.stale += u64::from(stale);
        !stale
    }

    /// Reports the ages since the last report.
    pub(crate) fn report(&mut self, reporter: &Reporter, current: &wire::Versions) {
        let Some(network) = self.network.filter(|_| self.trajectories > 0) else {
            return;
        };
        for (name, value) in [
            (
                "rollout/policy_lag",
                self.sum as f64 / self.trajectories as f64,
            ),
            ("rollout/policy_lag_max", self.most as f64),
            ("rollout/stale_trajectories", self.stale as f64),
        ] {
            let metric = Metric::new(Role::Learner, 0, name, current[network], value);
            reporter.metric(&metric);
        }
        (self.trajectories, self.sum, self.most) = (0, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rollouts_of_old_weights_are_not_learned_from() {
        let mut lag = PolicyLag::new(Some(1), 3);
        let mut current = [0; wire::PARTS];
        current[1] = 10;
        let mut of = |version: u64| {
            let mut header = TrajectoryHeader::default();
            header.versions[1] = version;
            lag.admits(&header, &current)
        };
        assert_eq!([10, 7, 6, 11].map(&mut of), [true, true, false, true]);
        assert_eq!((lag.stale, lag.most, lag.sum), (1, 4, 7));
        assert!(!PolicyLag::new(None, 3).admits(&TrajectoryHeader::default(), &current));
    }
}
