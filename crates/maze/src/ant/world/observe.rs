//! What is read from the world.

use rapier3d::prelude::*;

use super::{AntMaze, BODIES, ROOT, Sets};
use crate::{OBSERVATION, Observation};

impl AntMaze {
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
}
