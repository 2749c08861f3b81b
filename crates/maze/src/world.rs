//! The rapier world that holds one ant and its maze.

use std::sync::Arc;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use rapier3d::prelude::*;

use crate::ant::{
    ANKLE_AXES, ARMATURE, DAMPING, DENSITY, JOINT_OF_ACTUATOR, JOINT_RANGES, LEG_DIRECTIONS,
    LEG_RADIUS, LINK, MAX_TORQUE, RESET_HEIGHT, TORSO_RADIUS, child_body, parent_body,
};
use crate::layout::{Layout, WALL_HEIGHT};
use crate::teleport::{Exits, Teleports};
use crate::{ACTION, Action, CONTROL_SECONDS, OBSERVATION, Observation};

const BODIES: usize = 9;
const JOINTS: usize = 8;
/// Natural frequency (Hz) and damping ratio of a joint limit. With them the reset pose's ankles,
/// which start outside their range, are kicked in about as fast as MuJoCo kicks them, and random
/// actions push limbs as far past their limits (`docs/measurements.md`).
const LIMIT_SPRING: [f32; 2] = [6.0, 1.1];
/// A limit acts this much (s) before a limb gets there: rapier looks once a substep, and a fast
/// limb would be far past it.
const LIMIT_LEAD: f32 = 0.018;
/// A limb that would stay this far (rad) from its limits at its speed does not get there within a
/// call of the pipeline: full torque turns it by 0.15 rad, the rest is for pushes of the floor.
const LIMIT_REACH: f32 = 0.25;
/// Natural frequency (Hz) and damping ratio of a contact. MuJoCo raises the time constant of
/// 0.02 s in `ant.xml` to twice its time step, so its floor is soft; on a stiff one gaits slip and
/// ants flip.
const CONTACT_SPRING: [f32; 2] = [8.0, 1.0];
/// Contacts are found once a call of the pipeline, this far ahead (m): a foot makes up to 3 m/s.
const CONTACT_PREDICTION: f32 = 0.3;
/// Distance (m) from which floor and walls push, `ant.xml`'s margin.
const CONTACT_MARGIN: f32 = 0.01;
/// Degrees of freedom of the free torso: linear, then angular.
const ROOT: usize = 6;
const DOFS: usize = ROOT + JOINTS;

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

/// Everything of a world that changes while it is simulated.
#[derive(Clone)]
struct Sets {
    islands: IslandManager,
    broad: BroadPhaseBvh,
    narrow: NarrowPhase,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    impulse: ImpulseJointSet,
    multibody: MultibodyJointSet,
}

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

fn integration(physics: &Physics) -> IntegrationParameters {
    let [frequency, damping_ratio] = CONTACT_SPRING;
    let contact = SpringCoefficients::new(frequency, damping_ratio);
    IntegrationParameters {
        dt: CONTROL_SECONDS / physics.pipeline_steps as f32,
        num_solver_iterations: physics.solver_iterations,
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
            parameters: integration(&physics),
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

    /// Moves each limit towards the limb that comes at it. Limits out of reach are left out, since
    /// each costs rapier a solve of the mass matrix even where it does nothing.
    fn lead_limits(&mut self) {
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
    fn apply(&mut self, torque: &[f32; JOINTS]) {
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

    /// The 29 values of D4RL's observation.
    #[must_use]
    pub fn observation(&self) -> Observation {
        let mut o = [0.0; OBSERVATION];
        let Sets {
            bodies, multibody, ..
        } = &self.sets;
        let (Some(torso), Some((ant, _))) = (bodies.get(self.links[0]), multibody.get(self.root))
        else {
            return o;
        };
        let Pose {
            rotation: q,
            translation,
            ..
        } = *torso.position();
        for i in 0..3 {
            o[i] = translation[i];
        }
        o[3..7].copy_from_slice(&[q.w, q.x, q.y, q.z]);
        // A link's own velocity is stale after a step; the multibody's is not.
        let velocity = ant.generalized_velocity();
        let spin = q.inverse() * Vector::new(velocity[3], velocity[4], velocity[5]);
        for i in 0..3 {
            o[15 + i] = velocity[i];
            o[18 + i] = spin[i];
        }
        for link in ant.links().filter(|link| !link.is_root()) {
            let joint = link.assembly_id() - ROOT;
            o[7 + joint] = link.joint().coords()[3];
            o[21 + joint] = velocity[ROOT + joint];
        }
        o
    }

    /// Poses of torso and the hip and foot links of legs 1 to 4: x, y, z (m), quaternion
    /// w, x, y, z.
    #[must_use]
    pub fn body_poses(&self) -> [[f32; 7]; BODIES] {
        self.links.map(|link| {
            self.sets.bodies.get(link).map_or([0.0; 7], |body| {
                let Pose {
                    rotation: q,
                    translation: t,
                    ..
                } = *body.position();
                [t.x, t.y, t.z, q.w, q.x, q.y, q.z]
            })
        })
    }

    /// Mass (kg) and principal inertia (kg m^2) of torso and the hip and foot links of legs 1 to 4.
    #[must_use]
    pub fn inertias(&self) -> [[f32; 4]; BODIES] {
        self.links.map(|link| {
            self.sets.bodies.get(link).map_or([0.0; 4], |body| {
                let own = &body.mass_properties().local_mprops;
                let [x, y, z] = own.principal_inertia().to_array();
                [own.mass(), x, y, z]
            })
        })
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

fn build_maze(sets: &mut Sets, layout: &Layout, walls: bool) {
    let groups = InteractionGroups::new(Group::GROUP_2, Group::GROUP_1, InteractionTestMode::And);
    let floor = ColliderBuilder::new(SharedShape::halfspace(Vector::Z));
    let mut insert = |shape: ColliderBuilder| {
        let shape = shape.friction(1.0).contact_skin(CONTACT_MARGIN);
        sets.colliders.insert(shape.collision_groups(groups));
    };
    insert(floor);
    if !walls {
        return;
    }
    for [x, y, half_x, half_y] in layout.boxes() {
        let wall = ColliderBuilder::cuboid(half_x, half_y, WALL_HEIGHT / 2.0);
        insert(wall.translation(Vector::new(x, y, WALL_HEIGHT / 2.0)));
    }
}

/// The four capsules of `ant.xml` from the torso's centre to the hips, as mass alone: what of them
/// is not inside the torso's sphere or the hip links' round ends stands out by less than 1 cm, so
/// they touch nothing that those would not.
fn stubs() -> MassProperties {
    LEG_DIRECTIONS
        .into_iter()
        .map(|[x, y]| {
            let hip = Vector::new(x, y, 0.0) * LINK;
            MassProperties::from_capsule(DENSITY, Vector::ZERO, hip, LEG_RADIUS)
        })
        .sum()
}

fn build_ant(
    sets: &mut Sets,
    axes: &[Vector; JOINTS],
) -> ([RigidBodyHandle; BODIES], MultibodyJointHandle) {
    // As in ant.xml the ant touches floor and walls but never itself.
    let groups = InteractionGroups::new(Group::GROUP_1, Group::GROUP_2, InteractionTestMode::And);
    let Sets {
        bodies,
        colliders,
        multibody,
        ..
    } = sets;
    let links = std::array::from_fn(|body| {
        let mut place = Vector::new(0.0, 0.0, RESET_HEIGHT);
        if body > 0 {
            let [x, y] = LEG_DIRECTIONS[(body - 1) / 2];
            let distance = if body % 2 == 1 { LINK } else { 2.0 * LINK };
            place += Vector::new(x, y, 0.0) * distance;
        }
        let mut builder = RigidBodyBuilder::dynamic()
            .pose(Pose::from_translation(place))
            .can_sleep(false);
        if body == 0 {
            builder = builder.additional_mass_properties(stubs());
        }
        bodies.insert(builder)
    });
    let mut add = |shape: ColliderBuilder, body: usize| {
        let shape = shape
            .density(DENSITY)
            .friction(1.0)
            .collision_groups(groups);
        colliders.insert_with_parent(shape, links[body], bodies);
    };
    add(ColliderBuilder::ball(TORSO_RADIUS), 0);
    for (leg, [x, y]) in LEG_DIRECTIONS.into_iter().enumerate() {
        let offset = Vector::new(x, y, 0.0) * LINK;
        let capsule = |end| ColliderBuilder::capsule_from_endpoints(Vector::ZERO, end, LEG_RADIUS);
        add(capsule(offset), 1 + 2 * leg);
        add(capsule(offset * 2.0), 2 + 2 * leg);
    }
    if let Some(torso) = bodies.get_mut(links[0]) {
        torso.recompute_mass_properties_from_colliders(colliders);
    }
    let [frequency, damping_ratio] = LIMIT_SPRING;
    let limit = SpringCoefficients::new(frequency, damping_ratio);
    let mut root = MultibodyJointHandle::invalid();
    for (joint, &axis) in axes.iter().enumerate() {
        let [x, y] = LEG_DIRECTIONS[joint / 2];
        let hinge = RevoluteJointBuilder::new(axis)
            .local_anchor1(Vector::new(x, y, 0.0) * LINK)
            .local_anchor2(Vector::ZERO)
            .contacts_enabled(false)
            .limits(JOINT_RANGES[joint])
            .softness(limit);
        let (parent, child) = (links[parent_body(joint)], links[child_body(joint)]);
        if let Some(handle) = multibody.insert(parent, child, hinge, true) {
            root = handle;
        }
    }
    if let Some((ant, _)) = multibody.get_mut(root) {
        ant.set_self_contacts_enabled(false);
        // rapier damps every new angular degree of freedom, the free torso's too.
        for dof in 0..DOFS {
            let hinge = dof >= ROOT;
            ant.damping_mut()[dof] = if hinge { DAMPING } else { 0.0 };
            ant.armature_mut()[dof] = if hinge { ARMATURE } else { 0.0 };
        }
    }
    (links, root)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::ant::JOINT_RANGES;

    fn medium() -> AntMaze {
        AntMaze::new(&Layout::named("medium").unwrap(), Physics::MAZE)
    }

    #[test]
    fn the_ant_weighs_what_mujoco_says() {
        let inertias = medium().inertias();
        let mass: f32 = inertias.iter().map(|[mass, ..]| mass).sum();
        assert!((mass - 0.91088).abs() < 1e-4, "{mass}");
        let torso_mass = inertias[0][0];
        assert!((torso_mass - 0.483_882).abs() < 1e-4, "{torso_mass}");
        // A foot link: kg, and kg m^2 along and across.
        let [mass, mut i @ ..] = inertias[2];
        i.sort_by(f32::total_cmp);
        for (got, wanted) in [mass, i[0], i[1], i[2]]
            .iter()
            .zip([0.067_592, 2.094e-4, 2.675e-3, 2.675e-3])
        {
            assert!((got / wanted - 1.0).abs() < 1e-2, "{inertias:?}");
        }
    }

    #[test]
    fn without_torque_it_settles_at_mujocos_standing_height() {
        let mut world = medium();
        world.reset_to([0.0, 0.0]);
        for _ in 0..60 {
            world.step(&[0.0; 8]);
        }
        // In MuJoCo 0.597 m after 20 steps, then 0.585: its friction lets the feet creep apart.
        let z = world.observation()[2];
        assert!((0.53..0.62).contains(&z), "{z}");
    }

    #[test]
    fn set_is_read_back() {
        let mut world = medium();
        let mut o = world.observation();
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        for value in &mut o[7..] {
            *value = rng.random_range(-0.5..0.5);
        }
        let turn = 0.4_f32;
        o[3..7].copy_from_slice(&[(turn / 2.0).cos(), (turn / 2.0).sin(), 0.0, 0.0]);
        world.set(&o);
        for (got, wanted) in world.observation().iter().zip(&o) {
            assert!((got - wanted).abs() < 1e-5, "{got} {wanted}");
        }
    }

    #[test]
    fn a_torque_moves_its_own_joint_as_mujoco_has_it() {
        let mut world = medium();
        world.reset_to([0.0, 0.0]);
        let mut action = [0.0; 8];
        action[2] = 1.0;
        world.step(&action);
        let o = world.observation();
        // 30 N m on hip 1 for one step in MuJoCo: 0.143 rad, 2.81 rad/s. Semi-implicit substeps
        // have positions half a substep ahead of velocities.
        let physics = Physics::MAZE;
        let substeps = physics.pipeline_steps * physics.solver_iterations;
        let ahead = o[21] * CONTROL_SECONDS / substeps as f32 / 2.0;
        assert!((o[7] - ahead - 0.143).abs() < 0.01, "{}", o[7] - ahead);
        assert!((o[21] - 2.81).abs() < 0.1, "{}", o[21]);
        for joint in [2, 4, 6] {
            assert!(
                o[7 + joint].abs() < 0.05,
                "hip of another leg moved: {}",
                o[7 + joint]
            );
        }
    }

    #[test]
    fn random_actions_never_break_the_body() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let layout = Layout::named("medium").unwrap();
        let mut world = AntMaze::new(&layout, Physics::MAZE);
        let mut overshoot = 0.0_f32;
        for cell in layout.free_cells().into_iter().step_by(5) {
            world.reset(layout.centre(cell), &mut rng);
            for step in 0..400 {
                world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
                let o = world.observation();
                assert!(o.iter().copied().all(f32::is_finite));
                assert!(o[2] < 2.0, "torso at {} m", o[2]);
                // The reset pose starts the ankles 30 degrees outside their range.
                if step >= 10 {
                    for (joint, [low, high]) in JOINT_RANGES.into_iter().enumerate() {
                        overshoot = overshoot.max(low - o[7 + joint]).max(o[7 + joint] - high);
                    }
                }
            }
            assert!(!layout.is_wall_at([world.observation()[0], world.observation()[1]]));
        }
        assert!(
            overshoot.to_degrees() < 8.0,
            "{} degrees",
            overshoot.to_degrees()
        );
    }

    #[test]
    fn an_inlet_takes_the_ant_to_every_outlet_and_changes_nothing_else() {
        let layout = Layout::named("teleport").unwrap();
        let mut world = AntMaze::new(&layout, Physics::MAZE);
        let inlet = layout.centre(layout.inlets()[0]);
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..20 {
            world.reset([inlet[0] + 1.2, inlet[1]], &mut rng);
            let before = world.save();
            world.step(&[0.0; 8]);
            let o = world.observation();
            seen.insert(layout.cell_at([o[0], o[1]]).unwrap());
            for _ in 0..20 {
                world.step(&[0.0; 8]);
            }
            let end = world.observation();
            assert!(
                (end[0] - o[0]).hypot(end[1] - o[1]) < 1.0,
                "it stands: {end:?}"
            );
            world.restore(&before);
            world.step(&[0.0; 8]);
            assert_eq!(
                world.observation(),
                o,
                "a restored state takes the same exit"
            );
        }
        assert_eq!(seen.into_iter().collect::<Vec<_>>(), layout.outlets());
    }

    #[test]
    fn the_same_seed_gives_the_same_bits_and_a_saved_state_continues() {
        let run = |world: &mut AntMaze, seed| {
            let mut rng = Pcg64Mcg::seed_from_u64(seed);
            for _ in 0..50 {
                world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
            }
            world.observation().map(f32::to_bits)
        };
        let (mut a, mut b) = (medium(), medium());
        // A used world resets to the same future as a new one.
        run(&mut b, 9);
        a.reset([0.0, 0.0], &mut Pcg64Mcg::seed_from_u64(4));
        b.reset([0.0, 0.0], &mut Pcg64Mcg::seed_from_u64(4));
        assert_eq!(run(&mut a, 5), run(&mut b, 5));
        let saved = a.save();
        let mut other = a.clone();
        let first = run(&mut a, 6);
        assert_eq!(run(&mut other, 6), first, "a clone goes the same way");
        a.restore(&saved);
        assert_eq!(run(&mut a, 6), first);
    }
}
