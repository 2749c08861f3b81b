//! Torques and limits of the joints.

use rapier3d::prelude::*;

use super::{AntMaze, BODIES, JOINTS, ROOT};
use crate::ant::{JOINT_RANGES, child_body, parent_body};

/// A limit acts this much (s) before a limb gets there: rapier looks once a substep, and a fast
/// limb would be far past it.
const LIMIT_LEAD: f32 = 0.018;
/// A limb that would stay this far (rad) from its limits at its speed does not get there within a
/// call of the pipeline: full torque turns it by 0.15 rad, the rest is for pushes of the floor.
const LIMIT_REACH: f32 = 0.25;

impl AntMaze {
    /// Moves each limit towards the limb that comes at it. Limits out of reach are left out, since
    /// each costs rapier a solve of the mass matrix even where it does nothing.
    pub(super) fn lead_limits(&mut self) {
        let Some((ant, _)) = self.sets.multibody.get_mut(self.root) else {
            return;
        };
        let mut velocity = [0.0; JOINTS];
        velocity.copy_from_slice(&ant.generalized_velocity().as_slice()[ROOT..]);
        for link in ant.links_mut().filter(|link| !link.is_root()) {
            let joint = link.assembly_id() - ROOT;
            let [low, high] = JOINT_RANGES[joint];
            let ahead = LIMIT_LEAD * velocity[joint];
            let limits = [low - ahead.min(0.0), high - ahead.max(0.0)];
            let angle = link.joint().coords()[3];
            let reach = velocity[joint].abs() * self.parameters.dt + LIMIT_REACH;
            let hinge = &mut link.joint.data;
            hinge.set_limits(JointAxis::AngX, limits);
            if angle - reach > limits[0] && angle + reach < limits[1] {
                hinge.limit_axes = JointAxesMask::empty();
            }
        }
    }

    /// Joint torques as equal and opposite torques on the two bodies of each joint.
    pub(super) fn apply(&mut self, torque: &[f32; JOINTS]) {
        let bodies = &mut self.sets.bodies;
        let mut sums = [Vector::ZERO; BODIES];
        for (joint, &torque) in torque.iter().enumerate() {
            let parent = parent_body(joint);
            if let Some(body) = bodies.get(self.links[parent]) {
                let turning = *body.rotation() * self.axes[joint] * torque;
                sums[child_body(joint)] += turning;
                sums[parent] -= turning;
            }
        }
        for (link, sum) in self.links.iter().zip(sums) {
            if let Some(body) = bodies.get_mut(*link) {
                body.reset_torques(false);
                body.add_torque(sum, false);
            }
        }
    }
}
