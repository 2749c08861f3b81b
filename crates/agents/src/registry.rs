//! Every algorithm by its name, and the run files that name them.

use config::{Config, Document, Reader, Registry, Settings};
use simulator::Body;

use crate::algorithm::{Algorithm, Plan};
use crate::gcbc::Gcbc;
use crate::lg_h_ppo::LgHPpo;
use crate::walker::Walker;

/// Every algorithm, the default first.
pub static ALGORITHMS: &[&dyn Algorithm] = &[&LgHPpo, &Gcbc, &Walker];

/// Reads run files of these algorithms.
pub static CONFIGS: Reader = Reader::new(&Names);

/// The algorithm of a name.
#[must_use]
pub fn find(name: &str) -> Option<&'static dyn Algorithm> {
    let mut algorithms = ALGORITHMS.iter().copied();
    algorithms.find(|algorithm| algorithm.name() == name)
}

/// The body that a run's simulator has. A config names no other than those that there are.
#[must_use]
pub fn body(config: &Config) -> &'static dyn Body {
    simulators::body(&config.run.simulator).unwrap_or(&maze::AntBody)
}

/// What a run trains, and how. `None` for a config that names another algorithm than its settings
/// are of, which no [reader](CONFIGS) gives.
#[must_use]
pub fn plan(config: &Config) -> Option<Box<dyn Plan>> {
    find(&config.run.algorithm)?.plan(config, body(config))
}

struct Names;

impl Registry for Names {
    fn algorithms(&self) -> Vec<&'static str> {
        ALGORITHMS
            .iter()
            .map(|algorithm| algorithm.name())
            .collect()
    }

    fn simulators(&self) -> Vec<&'static str> {
        simulators::names().collect()
    }

    fn is_offline(&self, algorithm: &str) -> bool {
        find(algorithm).is_none_or(Algorithm::is_offline)
    }

    fn read(&self, algorithm: &str, document: &mut Document<'_>) -> Settings {
        match find(algorithm) {
            Some(algorithm) => algorithm.settings(document),
            None => Settings::new(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn config(algorithm: &str) -> Config {
        let text = format!(
            "[run]\nalgorithm = \"{algorithm}\"\n[dataset]\npath = \"x.hdf5\"\n[collect]\n"
        );
        CONFIGS.parse(&text, "x.toml", "x", &[]).unwrap()
    }

    #[test]
    fn every_algorithm_makes_a_plan_of_its_defaults() {
        for algorithm in ALGORITHMS {
            let config = config(algorithm.name());
            let plan = plan(&config).unwrap();
            let networks = plan.networks();
            assert!((1..crate::PARTS).contains(&networks.len()));
            let names: BTreeSet<&str> = networks.iter().map(|network| network.name).collect();
            assert_eq!(names.len(), networks.len(), "{}", algorithm.name());
            for network in &networks {
                assert!(network.weights > 0, "{}", network.name);
            }
            for stage in plan.stages() {
                assert!(stage.after.iter().all(|number| *number < networks.len()));
                assert!(!stage.needs_graph || plan.graph().is_some());
            }
            assert!(
                plan.on_policy()
                    .is_none_or(|number| number < networks.len())
            );
            assert_eq!(plan.needs().is_some(), algorithm.is_offline());
        }
    }

    #[test]
    fn names_are_those_of_one_algorithm_each() {
        let names: BTreeSet<&str> = ALGORITHMS
            .iter()
            .map(|algorithm| algorithm.name())
            .collect();
        assert_eq!(names.len(), ALGORITHMS.len());
        assert!(find("no-such").is_none());
    }
}
