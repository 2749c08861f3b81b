//! What rapier keeps of a world, and its sizes.

use rapier3d::prelude::*;

pub(super) const BODIES: usize = 9;
pub(super) const JOINTS: usize = 8;
/// Degrees of freedom of the free torso: linear, then angular.
pub(super) const ROOT: usize = 6;
pub(super) const DOFS: usize = ROOT + JOINTS;

/// Everything of a world that changes while it is simulated.
#[derive(Clone)]
pub(super) struct Sets {
    pub(super) islands: IslandManager,
    pub(super) broad: BroadPhaseBvh,
    pub(super) narrow: NarrowPhase,
    pub(super) bodies: RigidBodySet,
    pub(super) colliders: ColliderSet,
    pub(super) impulse: ImpulseJointSet,
    pub(super) multibody: MultibodyJointSet,
}
