//! What is recorded of an episode while it is played.

use simulator::{Simulator, Values};

/// A state.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StateRecord {
    /// The observation where it is floats, empty otherwise.
    pub observation: Vec<f32>,
    /// The observation where it is bytes, as of an image, empty otherwise.
    pub observation_bytes: Vec<u8>,
    /// Poses of the body's parts: x, y, z (m), quaternion w, x, y, z. Where the body is, is where its
    /// first part is.
    pub poses: Vec<[f32; 7]>,
}

impl StateRecord {
    /// The state of a simulator.
    #[must_use]
    pub fn of(simulator: &dyn Simulator) -> Self {
        let mut state = Self::default();
        state.observe(simulator);
        state
    }

    /// Replaces the state by that of a simulator. Nothing is allocated for one of the same shape.
    pub fn observe(&mut self, simulator: &dyn Simulator) {
        self.clear();
        match simulator.observation() {
            Values::F32(values) => self.observation.extend_from_slice(values),
            Values::U8(values) => self.observation_bytes.extend_from_slice(values),
        }
        simulator.poses(&mut self.poses);
    }

    fn clear(&mut self) {
        self.observation.clear();
        self.observation_bytes.clear();
        self.poses.clear();
    }

    /// Where the body is (m); not a number without parts.
    pub(crate) fn place(&self) -> [f32; 3] {
        match self.poses.first() {
            Some([x, y, z, ..]) => [*x, *y, *z],
            None => [f32::NAN; 3],
        }
    }
}

/// The state before an action, and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRecord {
    /// Control step in the episode.
    pub step: u32,
    /// The state before the action.
    pub state: StateRecord,
    /// The action.
    pub action: Vec<f32>,
    /// Reward after the action.
    pub reward: f32,
    /// The graph's node that the body is at, -1 for none.
    pub node: i32,
    /// The node moved towards, -1 for none.
    pub subgoal_node: i32,
    /// The place moved towards (m), if there is one.
    pub subgoal: Option<[f32; 2]>,
}

impl Default for StepRecord {
    fn default() -> Self {
        Self {
            step: 0,
            state: StateRecord::default(),
            action: vec![],
            reward: 0.0,
            node: -1,
            subgoal_node: -1,
            subgoal: None,
        }
    }
}

impl StepRecord {
    /// The default values, with what is allocated kept.
    pub(crate) fn clear(&mut self) {
        let (mut state, mut action) = (
            std::mem::take(&mut self.state),
            std::mem::take(&mut self.action),
        );
        state.clear();
        action.clear();
        *self = Self {
            state,
            action,
            ..Self::default()
        };
    }
}

/// A choice of a node of the graph, recorded before the step that it was made at.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceRecord {
    /// Control step in the episode.
    pub step: u32,
    /// Node of the choice.
    pub node: i32,
    /// The goal's node.
    pub goal_node: i32,
    /// The node moved towards.
    pub subgoal_node: i32,
    /// Value of the node towards the goal, NaN without a critic.
    pub value: f32,
    /// Open neighbours of the node.
    pub neighbours: Vec<u32>,
    /// Their probabilities.
    pub probabilities: Vec<f32>,
}

/// What became of a choice, recorded before the step that it ended at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutcomeRecord {
    /// Control step in the episode.
    pub step: u32,
    /// Node of the choice.
    pub node: i32,
    /// The node moved towards.
    pub subgoal_node: i32,
    /// Whether it was reached.
    pub reached: bool,
}

/// The end of an episode.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EndRecord {
    /// The state after the last action.
    pub state: StateRecord,
    /// Whether the goal was reached.
    pub success: bool,
    /// Whether the body has fallen.
    pub fell: bool,
}

#[cfg(test)]
mod tests {
    use maze::{Layout, PointSimulator};

    use super::*;

    #[test]
    fn a_cleared_record_is_a_new_one_that_allocates_nothing() {
        let simulator = PointSimulator::new(&Layout::named("umaze").unwrap(), 0.5);
        let mut record = StepRecord::default();
        record.state.observe(&simulator);
        record.action.extend([1.0, 2.0]);
        record.node = 3;
        assert_eq!(record.state, StateRecord::of(&simulator));
        assert_eq!(record.state.place(), [0.0, 0.0, 0.7]);
        let allocated = |record: &StepRecord| {
            let state = &record.state;
            (
                state.observation.as_ptr(),
                state.poses.as_ptr(),
                record.action.as_ptr(),
            )
        };
        let before = allocated(&record);
        record.clear();
        assert_eq!(record, StepRecord::default());
        record.state.observe(&simulator);
        record.action.push(1.0);
        assert_eq!(allocated(&record), before);
    }
}
