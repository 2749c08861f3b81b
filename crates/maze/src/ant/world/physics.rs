//! How a control step is simulated.

use rapier3d::prelude::*;

use crate::CONTROL_SECONDS;

/// Natural frequency (Hz) and damping ratio of a contact. MuJoCo raises the time constant of
/// 0.02 s in `ant.xml` to twice its time step, so its floor is soft; on a stiff one gaits slip and
/// ants flip.
const CONTACT_SPRING: [f32; 2] = [8.0, 1.0];
/// Contacts are found once a call of the pipeline, this far ahead (m): a foot makes up to 3 m/s.
const CONTACT_PREDICTION: f32 = 0.3;

/// How finely a control step is simulated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Physics {
    /// Calls of rapier's pipeline in a control step.
    pub pipeline_steps: usize,
    /// Solver substeps in each call.
    pub solver_iterations: usize,
    /// Whether the maze's walls are there; without them the floor is endless.
    pub walls: bool,
}

impl Physics {
    /// The project's setting: one call of 3 substeps, 33 ms each.
    pub const MAZE: Self = Self {
        pipeline_steps: 1,
        solver_iterations: 3,
        walls: true,
    };
    /// The same without walls.
    pub const OPEN_FLOOR: Self = Self {
        walls: false,
        ..Self::MAZE
    };
}

impl Default for Physics {
    fn default() -> Self {
        Self::MAZE
    }
}

impl Physics {
    pub(super) fn parameters(&self) -> IntegrationParameters {
        let [frequency, damping_ratio] = CONTACT_SPRING;
        let contact = SpringCoefficients::new(frequency, damping_ratio);
        IntegrationParameters {
            dt: CONTROL_SECONDS / self.pipeline_steps as f32,
            num_solver_iterations: self.solver_iterations,
            // One leaves the legs' contacts, coupled through the torso, unsolved: gaits lose speed.
            num_internal_pgs_iterations: 2,
            // Without stabilisation a limit gives back the speed of leaving it, as MuJoCo's does: the
            // reset pose's ankles are kicked into their range and the ant stands up.
            num_internal_stabilization_iterations: 0,
            // With coarse steps the defaults let feet sink in: look ahead further, and renew contacts.
            normalized_prediction_distance: CONTACT_PREDICTION,
            contact_recycling: false,
            max_ccd_substeps: 0,
            contact_softness: contact,
            static_contact_softness: contact,
            friction_model: FrictionModel::Coulomb,
            ..IntegrationParameters::default()
        }
    }
}
