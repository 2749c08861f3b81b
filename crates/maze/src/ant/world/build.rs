//! Builds the maze and the ant.

use rapier3d::prelude::*;

use super::sets::{BODIES, DOFS, JOINTS, ROOT, Sets};
use crate::ant::{
    ARMATURE, DAMPING, DENSITY, JOINT_RANGES, LEG_DIRECTIONS, LEG_RADIUS, LINK, RESET_HEIGHT,
    TORSO_RADIUS, child_body, parent_body,
};
use crate::layout::{Layout, WALL_HEIGHT};

/// Natural frequency (Hz) and damping ratio of a joint limit. With them the reset pose's ankles,
/// which start outside their range, are kicked in about as fast as MuJoCo kicks them, and random
/// actions push limbs as far past their limits (`docs/measurements.md`).
const LIMIT_SPRING: [f32; 2] = [6.0, 1.1];
/// Distance (m) from which floor and walls push, `ant.xml`'s margin.
const CONTACT_MARGIN: f32 = 0.01;

pub(super) fn build_maze(sets: &mut Sets, layout: &Layout, walls: bool) {
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

pub(super) fn build_ant(
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
