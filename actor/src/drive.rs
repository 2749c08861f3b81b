//! Behaviours that move a body towards a place: what data are collected with.

use std::path::Path;

use anyhow::Context;
use simulator::Body;

use crate::walker::Walker;

/// A behaviour of a simulator's body.
#[derive(Clone)]
pub(crate) enum Drive {
    /// A walker that has learnt it.
    Walker(Box<Walker>),
    /// That of a body which moves straight by itself.
    Straight(&'static dyn Body),
}

impl Drive {
    /// The behaviour for a simulator; `walker` is the file of the ant's, or none for the one built in.
    ///
    /// # Errors
    /// A simulator without a behaviour, a walker that cannot be read.
    pub(crate) fn of(simulator: &str, walker: Option<&Path>) -> anyhow::Result<Self> {
        let body = simulators::body(simulator)
            .with_context(|| format!("there is no simulator '{simulator}'"))?;
        if body.towards([0.0; 2], &mut vec![]) {
            return Ok(Self::Straight(body));
        }
        let walker = Walker::load(walker)?;
        if !walker.fits(body) {
            anyhow::bail!(
                "data cannot be collected with the simulator '{simulator}': the walker moves another body; \
                 give a data set by dataset.path"
            );
        }
        Ok(Self::Walker(Box::new(walker)))
    }

    /// Identifies the behaviour in a file of collected data.
    pub(crate) fn hash(&self) -> String {
        match self {
            Self::Walker(walker) => walker.hash(),
            Self::Straight(_) => "straight".to_owned(),
        }
    }

    /// Replaces `action` by the action in an observation on the way in a world `direction` (m).
    pub(crate) fn act(&mut self, observation: &[f32], direction: [f32; 2], action: &mut Vec<f32>) {
        action.clear();
        match self {
            Self::Walker(walker) => action.extend(walker.act(observation, direction)),
            Self::Straight(body) => {
                body.towards(direction, action);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulators_with_a_behaviour_have_actions_of_their_width() {
        for name in simulators::names() {
            let spaces = simulators::body(name).unwrap().spaces();
            let (mut drive, mut action) = (Drive::of(name, None).unwrap(), vec![9.0]);
            let mut observation = vec![0.0; spaces.observation.len()];
            if name == "ant" {
                observation[3] = 1.0;
            }
            drive.act(&observation, [1.0, 2.0], &mut action);
            assert_eq!(action.len(), spaces.action.len(), "{name}");
        }
    }

    #[test]
    fn an_unknown_simulator_is_refused_and_a_walker_fits_its_own_body_alone() {
        let refused = Drive::of("flea", None).map(drop).unwrap_err().to_string();
        assert!(refused.contains("no simulator 'flea'"), "{refused}");
        let walker = Walker::load(None).unwrap();
        assert!(walker.fits(&maze::AntBody) && !walker.fits(&maze::PointBody));
    }
}
