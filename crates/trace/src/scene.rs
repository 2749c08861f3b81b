//! What stands still: walls, graph, goal; and the body's shape. Walls and body twice: as a scene, and
//! as points for viewers that draw no scene (Rerun).

use foxglove::bytes::Bytes;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    Color, CubePrimitive, CylinderPrimitive, LinePrimitive, PackedElementField, Point3, PointCloud,
    Pose, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Vector3, line_primitive,
};
use simulator::{Body, Part, Shape};

use crate::topic::Topic;

/// The world around an episode, which many share.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Walls: centre x, y, half width, half depth (m).
    pub walls: Vec<[f32; 4]>,
    /// Their height (m).
    pub wall_height: f32,
    /// The body's parts.
    pub parts: &'static [Part],
    /// Points of the body in the frame of its first part (m).
    pub outline: Vec<[f32; 3]>,
    /// Places of the graph's nodes (m); empty where there is no graph, of which a trace then has no
    /// topic.
    pub nodes: Vec<[f32; 2]>,
    /// Pairs of nodes that an edge links.
    pub edges: Vec<(u32, u32)>,
}

/// The one fixed frame.
pub(crate) const WORLD: &str = "world";

const GREY: Color = Color {
    r: 0.6,
    g: 0.6,
    b: 0.65,
    a: 1.0,
};
const BLUE: Color = Color {
    r: 0.2,
    g: 0.45,
    b: 0.9,
    a: 0.9,
};
const PALE: Color = Color {
    r: 0.45,
    g: 0.6,
    b: 0.8,
    a: 0.35,
};
const GREEN: Color = Color {
    r: 0.1,
    g: 0.75,
    b: 0.3,
    a: 0.6,
};
const ORANGE: Color = Color {
    r: 0.95,
    g: 0.55,
    b: 0.1,
    a: 0.95,
};
const BRASS: Color = Color {
    r: 0.8,
    g: 0.6,
    b: 0.4,
    a: 1.0,
};

pub(crate) fn pose(x: f32, y: f32, z: f32) -> Pose {
    Pose {
        position: Some(Vector3 {
            x: x.into(),
            y: y.into(),
            z: z.into(),
        }),
        orientation: Some(Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }),
    }
}

fn point(x: f32, y: f32, z: f32) -> Point3 {
    Point3 {
        x: x.into(),
        y: y.into(),
        z: z.into(),
    }
}

/// A cloud of points in a frame.
fn cloud(frame: &str, points: impl Iterator<Item = [f32; 3]>) -> PointCloud {
    let field = |(i, name): (u32, &str)| PackedElementField {
        name: name.to_owned(),
        offset: 4 * i,
        r#type: NumericType::Float32 as i32,
    };
    let mut data = vec![];
    for point in points {
        data.extend_from_slice(point.map(f32::to_le_bytes).as_flattened());
    }
    PointCloud {
        frame_id: frame.to_owned(),
        pose: Some(pose(0.0, 0.0, 0.0)),
        point_stride: 12,
        fields: (0..).zip(["x", "y", "z"]).map(field).collect(),
        data: Bytes::from(data),
        ..PointCloud::default()
    }
}

fn size(x: f32, y: f32, z: f32) -> Option<Vector3> {
    Some(Vector3 {
        x: x.into(),
        y: y.into(),
        z: z.into(),
    })
}

fn entity(id: &str) -> SceneEntity {
    SceneEntity {
        frame_id: WORLD.to_owned(),
        id: id.to_owned(),
        ..SceneEntity::default()
    }
}

impl Scene {
    /// The scene with a body.
    #[must_use]
    pub fn with_body(self, body: &dyn Body) -> Self {
        Self {
            parts: body.parts(),
            outline: body.outline(),
            ..self
        }
    }

    /// Whether a trace of the scene has a topic.
    pub(crate) fn has(&self, topic: Topic) -> bool {
        match topic {
            Topic::BodyPoints => !self.outline.is_empty(),
            _ if topic.is_of_body() => !self.parts.is_empty(),
            _ => !topic.is_of_graph() || !self.nodes.is_empty(),
        }
    }

    /// The walls.
    pub(crate) fn maze(&self) -> SceneUpdate {
        let h = self.wall_height;
        let cubes = self
            .walls
            .iter()
            .map(|[x, y, half_x, half_y]| CubePrimitive {
                pose: Some(pose(*x, *y, h / 2.0)),
                size: size(2.0 * half_x, 2.0 * half_y, h),
                color: Some(GREY),
            });
        let walls = SceneEntity {
            cubes: cubes.collect(),
            ..entity("walls")
        };
        SceneUpdate {
            entities: vec![walls],
            ..SceneUpdate::default()
        }
    }

    /// Nodes as spheres, edges as lines, one for both directions; an edge of a node that does not
    /// exist is left out.
    pub(crate) fn graph(&self) -> SceneUpdate {
        let nodes = self.nodes.iter().map(|[x, y]| SpherePrimitive {
            pose: Some(pose(*x, *y, 0.05)),
            size: size(0.25, 0.25, 0.1),
            color: Some(BLUE),
        });
        let there = |(from, to): &(u32, u32)| (*from.max(to) as usize) < self.nodes.len();
        let either = |(from, to): (u32, u32)| [from.min(to), from.max(to)];
        let edges = self.edges.iter().copied().filter(there).map(either);
        let mut edges: Vec<[u32; 2]> = edges.collect();
        edges.sort_unstable();
        edges.dedup();
        let lines = LinePrimitive {
            r#type: line_primitive::Type::LineList as i32,
            pose: Some(pose(0.0, 0.0, 0.0)),
            thickness: 0.03,
            points: self
                .nodes
                .iter()
                .map(|[x, y]| point(*x, *y, 0.03))
                .collect(),
            color: Some(PALE),
            indices: edges.into_flattened(),
            ..LinePrimitive::default()
        };
        let graph = SceneEntity {
            spheres: nodes.collect(),
            // Without indices all points would be taken, in pairs.
            lines: if lines.indices.is_empty() {
                vec![]
            } else {
                vec![lines]
            },
            ..entity("graph")
        };
        SceneUpdate {
            entities: vec![graph],
            ..SceneUpdate::default()
        }
    }

    /// The choice under way: from where to where.
    pub(crate) fn choice(&self, node: i32, subgoal: i32) -> SceneUpdate {
        let place = |node: i32| self.nodes.get(usize::try_from(node).ok()?).copied();
        let mut choice = entity("choice");
        if let (Some([x, y]), Some([to_x, to_y])) = (place(node), place(subgoal)) {
            choice.spheres.push(SpherePrimitive {
                pose: Some(pose(to_x, to_y, 0.1)),
                size: size(0.6, 0.6, 0.2),
                color: Some(ORANGE),
            });
            choice.lines.push(LinePrimitive {
                r#type: line_primitive::Type::LineStrip as i32,
                pose: Some(pose(0.0, 0.0, 0.0)),
                thickness: 0.12,
                points: vec![point(x, y, 0.05), point(to_x, to_y, 0.05)],
                color: Some(ORANGE),
                ..LinePrimitive::default()
            });
        }
        SceneUpdate {
            entities: vec![choice],
            ..SceneUpdate::default()
        }
    }

    /// The walls' outlines at floor and top, a point every half metre or nearer.
    pub(crate) fn wall_points(&self) -> PointCloud {
        let outline = |[x, y, half_x, half_y]: [f32; 4]| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            (0..4).flat_map(move |side| {
                let [a, b] = [corners[side], corners[(side + 1) % 4]];
                let length = 2.0 * if side % 2 == 0 { half_x } else { half_y };
                // No more than a wall of a kilometre has.
                let parts = (length * 2.0).ceil().clamp(1.0, 2000.0) as u16;
                (0..parts).map(move |i| {
                    let share = f32::from(i) / f32::from(parts);
                    let along = |axis: usize| a[axis] + share * (b[axis] - a[axis]);
                    [x + half_x * along(0), y + half_y * along(1)]
                })
            })
        };
        let height = self.wall_height;
        let flat = self.walls.iter().flat_map(|wall| outline(*wall));
        cloud(WORLD, flat.flat_map(|[x, y]| [[x, y, 0.0], [x, y, height]]))
    }

    /// The nodes once more as poses, for viewers that do not draw a scene (Rerun).
    pub(crate) fn node_poses(&self) -> Vec<Pose> {
        self.nodes.iter().map(|[x, y]| pose(*x, *y, 0.05)).collect()
    }
}

/// The goal (m) and the radius of success (m).
pub(crate) fn goal([x, y]: [f32; 2], radius: f32) -> SceneUpdate {
    let disc = CylinderPrimitive {
        pose: Some(pose(x, y, 0.02)),
        size: size(2.0 * radius, 2.0 * radius, 0.04),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(GREEN),
    };
    let goal = SceneEntity {
        cylinders: vec![disc],
        ..entity("goal")
    };
    SceneUpdate {
        entities: vec![goal],
        ..SceneUpdate::default()
    }
}

/// A shape, added to the entity of its part.
fn draw(shape: Shape, entity: &mut SceneEntity) {
    match shape {
        Shape::Sphere { radius } => entity.spheres.push(SpherePrimitive {
            pose: Some(pose(0.0, 0.0, 0.0)),
            size: size(2.0 * radius, 2.0 * radius, 2.0 * radius),
            color: Some(BRASS),
        }),
        Shape::Capsule { from, to, radius } => entity.lines.push(LinePrimitive {
            r#type: line_primitive::Type::LineStrip as i32,
            pose: Some(pose(0.0, 0.0, 0.0)),
            thickness: f64::from(radius) * 2.0,
            points: [from, to].map(|[x, y, z]| point(x, y, z)).to_vec(),
            color: Some(BRASS),
            ..LinePrimitive::default()
        }),
    }
}

impl Scene {
    /// The body's outline, which moves with its first part.
    pub(crate) fn body_points(&self) -> PointCloud {
        let frame = self.parts.first().map_or(WORLD, |part| part.name);
        cloud(frame, self.outline.iter().copied())
    }

    /// The body's parts, each locked to its frame: only /tf moves.
    pub(crate) fn body(&self) -> SceneUpdate {
        let entities = self.parts.iter().map(|part| {
            let mut entity = SceneEntity {
                frame_id: part.name.to_owned(),
                id: part.name.to_owned(),
                frame_locked: true,
                ..SceneEntity::default()
            };
            for shape in part.shapes {
                draw(*shape, &mut entity);
            }
            entity
        });
        SceneUpdate {
            entities: entities.collect(),
            ..SceneUpdate::default()
        }
    }
}
