//! The rapier world that holds one ant and its maze.

mod build;
mod joints;
mod observe;
mod physics;
mod sets;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use rapier3d::prelude::*;

use crate::ant::{ANKLE_AXES, JOINT_OF_ACTUATOR, MAX_TORQUE, RESET_HEIGHT};
use crate::layout::Layout;
use crate::teleport::{Exits, Teleports};
use crate::{ACTION, Action, OBSERVATION, Observation};
use build::{build_ant, build_maze};
use sets::{BODIES, DOFS, JOINTS, ROOT, Sets};

pub use physics::Physics;

/// A saved state; restoring it continues bit by bit as the original did.
#[derive(Clone)]
pub struct State(Box<(Sets, Exits)>);

/// What an episode begins from: with it and the actions the episode is simulated again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Positions and velocities as set; the quaternion is not normalised yet.
    pub observation: Observation,
    /// Seed of the choice of teleports' outlets, 0 in a maze without.
    pub exits: u64,
}

/// One ant in one maze. A clone is another ant in the same state; the two share what never
/// changes, so clone a world rather than build many.
pub struct AntMaze {
    physics: Physics,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
    soft: SoftBodySet,
    sets: Sets,
    /// Never simulated. Resets start from it, since rapier's caches make a world remember.
    pristine: Arc<Sets>,
    links: [RigidBodyHandle; BODIES],
    root: MultibodyJointHandle,
    axes: [Vector; JOINTS],
    teleports: Teleports,
}

impl Clone for AntMaze {
    fn clone(&self) -> Self {
        Self {
            // Workspaces of a step; they hold no state.
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            soft: SoftBodySet::new(),
            sets: self.sets.clone(),
            pristine: Arc::clone(&self.pristine),
            teleports: self.teleports.clone(),
            ..*self
        }
    }
}

impl AntMaze {
    /// Builds the world, with the ant at rest at the origin.
    #[must_use]
    pub fn new(layout: &Layout, physics: Physics) -> Self {
        let mut sets = Sets {
            islands: IslandManager::new(),
            // Nine shapes move among a few walls, and resets restore the tree: mending it every
            // step costs more than it gains.
            broad: BroadPhaseBvh::with_optimization_strategy(BvhOptimizationStrategy::None),
            narrow: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse: ImpulseJointSet::new(),
            multibody: MultibodyJointSet::new(),
        };
        build_maze(&mut sets, layout, physics.walls);
        let axes = std::array::from_fn(|joint| {
            if joint % 2 == 0 {
                Vector::Z
            } else {
                let [x, y] = ANKLE_AXES[joint / 2];
                Vector::new(x, y, 0.0)
            }
        });
        let (links, root) = build_ant(&mut sets, &axes);
        let mut world = Self {
            physics,
            parameters: physics.parameters(),
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            soft: SoftBodySet::new(),
            pristine: Arc::new(sets.clone()),
            sets,
            links,
            root,
            axes,
            teleports: Teleports::new(layout),
        };
        world.reset_to([0.0, 0.0]);
        world
    }

    /// Puts the ant at rest at a place (m) in D4RL's reset pose without noise.
    pub fn reset_to(&mut self, place: [f32; 2]) {
        self.set(&reset_pose(place));
    }

    /// Puts the ant at a place (m) with D4RL's reset noise: positions U(-0.1, 0.1), velocities
    /// 0.1 N(0, 1). In a maze with teleports it seeds the choice of their outlets, too. What it
    /// returns makes the same start again.
    pub fn reset(&mut self, place: [f32; 2], rng: &mut (impl Rng + ?Sized)) -> Start {
        let mut observation = reset_pose(place);
        if let Ok(noise) = Uniform::new_inclusive(-0.1, 0.1) {
            for value in &mut observation[..15] {
                *value += noise.sample(rng);
            }
        }
        for value in &mut observation[15..] {
            let sample: f32 = StandardNormal.sample(rng);
            *value = 0.1 * sample;
        }
        let exits = self.teleports.draw(rng);
        let start = Start { observation, exits };
        self.begin(&start);
        start
    }

    /// Begins as a [`reset`](Self::reset) did: the same actions lead to the same bits.
    pub fn begin(&mut self, start: &Start) {
        self.teleports.begin(start.exits);
        self.set(&start.observation);
    }

    /// Starts anew from an observation: the pristine world with these positions and velocities.
    pub fn set(&mut self, observation: &Observation) {
        self.sets.clone_from(&self.pristine);
        let o = observation;
        let rotation = Rotation::from_xyzw(o[4], o[5], o[6], o[3]).normalize();
        let torso = Pose::from_parts(Vector::new(o[0], o[1], o[2]), rotation);
        let spin = rotation * Vector::new(o[18], o[19], o[20]);
        let Sets {
            bodies, multibody, ..
        } = &mut self.sets;
        if let Some(body) = bodies.get_mut(self.links[0]) {
            body.set_position(torso, true);
        }
        if let Some((ant, _)) = multibody.get_mut(self.root) {
            let mut displacement = [0.0; DOFS];
            for link in ant.links().filter(|link| !link.is_root()) {
                let dof = link.assembly_id();
                displacement[dof] = o[7 + dof - ROOT] - link.joint().coords()[3];
            }
            ant.apply_displacements(&displacement);
            let mut velocity = ant.generalized_velocity_mut();
            for i in 0..3 {
                velocity[i] = o[15 + i];
                velocity[3 + i] = spin[i];
            }
            for joint in 0..JOINTS {
                velocity[ROOT + joint] = o[21 + joint];
            }
            ant.forward_kinematics(bodies, true);
            ant.update_rigid_bodies(bodies, true);
        }
    }

    /// Simulates one control step (0.1 s) under constant torques. Actions beyond [-1, 1] are
    /// clipped; a non-finite action counts as zero.
    pub fn step(&mut self, action: &Action) {
        let mut torque = [0.0; JOINTS];
        for actuator in 0..ACTION {
            let share = action[actuator];
            let share = if share.is_finite() {
                share.clamp(-1.0, 1.0)
            } else {
                0.0
            };
            torque[JOINT_OF_ACTUATOR[actuator]] = MAX_TORQUE * share;
        }
        for _ in 0..self.physics.pipeline_steps {
            self.apply(&torque);
            self.lead_limits();
            let Sets {
                islands,
                broad,
                narrow,
                bodies,
                colliders,
                impulse,
                multibody,
            } = &mut self.sets;
            self.pipeline.step(
                Vector::new(0.0, 0.0, -9.81),
                &self.parameters,
                islands,
                broad,
                narrow,
                bodies,
                colliders,
                impulse,
                multibody,
                &mut self.soft,
                &mut self.ccd,
                &(),
                &(),
            );
        }
        self.teleport();
    }

    /// Takes an ant that came near an inlet to one of the outlets; all but its place stays, and the
    /// world forgets the contacts of the other place.
    fn teleport(&mut self) {
        let Some(body) = self.sets.bodies.get(self.links[0]) else {
            return;
        };
        let Vector { x, y, .. } = body.position().translation;
        if let Some(outlet) = self.teleports.exit([x, y]) {
            let mut observation = self.observation();
            observation[..2].copy_from_slice(&outlet);
            self.set(&observation);
        }
    }

    /// Saves the state; see [`restore`](Self::restore).
    #[must_use]
    pub fn save(&self) -> State {
        State(Box::new((
            self.sets.clone(),
            self.teleports.exits().clone(),
        )))
    }

    /// Continues from a saved state of a world of the same maze and physics.
    pub fn restore(&mut self, state: &State) {
        let (sets, exits) = &*state.0;
        self.sets.clone_from(sets);
        self.teleports.set_exits(exits);
    }
}

/// D4RL's reset pose at a place (m), without noise and at rest.
fn reset_pose(place: [f32; 2]) -> Observation {
    let mut observation = [0.0; OBSERVATION];
    observation[..2].copy_from_slice(&place);
    observation[2] = RESET_HEIGHT;
    observation[3] = 1.0;
    observation
}
