//! Rapier scene of arm, probe, needle robot, phantom and table: who comes too near to whom.
//!
//! Nothing moves by forces here. Bodies are put where the kinematics say (f64 narrowed to f32 at this edge)
//! and one detection pass is made per image interval, since it costs as much as dozens of ticks. A
//! link counts by its boxes, cylinders, capsules and spheres. Meshes are never opened, so that a missing one changes
//! nothing: where a link's collision shape is a mesh, a capsule from its joint to the next one stands for it.

use rapier3d::math::{Pose as Pose32, Rotation as Rotation32, Vector as Vector32};
use rapier3d::prelude::{
    ActiveCollisionTypes, BroadPhaseBvh, ColliderBuilder, ColliderHandle, ColliderSet, CollisionPipeline,
    Group, InteractionGroups, InteractionTestMode, IslandManager, NarrowPhase, RigidBodyBuilder,
    RigidBodyHandle, RigidBodySet,
};
use sonoloop_scenario::Scenario;
use sonoloop_types::{Pose, Vector};

use crate::chain::{Chain, pose_from_urdf};
use crate::needle_robot::NeedleRobot;

/// Bodies nearer than this count as about to collide; at 50 mm/s the arm moves 2 mm between two looks.
pub(crate) const MARGIN_M: f64 = 5e-3;
/// Table that the phantom stands on reaches this far beyond it. Assumed.
const TABLE_REACH_M: f64 = 0.15;
const TABLE_THICKNESS_M: f64 = 0.04;
/// Housing of a linear probe, elevational, and what it has beyond the array at either end. Assumed.
const HOUSING_DEPTH_M: f64 = 25e-3;
const HOUSING_RIM_M: f64 = 5e-3;
/// Longest housing; what is left up to the flange is the holder. Assumed.
const HOUSING_LENGTH_M: f64 = 0.09;
const HOLDER_SIDE_M: f64 = 50e-3;

/// Radius of the capsule that stands for a mesh, about that of a small arm's links. Assumed.
const MESH_RADIUS_M: f64 = 50e-3;

/// Who a collider belongs to. 0 is the base, 1–6 the links that the joints move.
const PROBE: usize = 7;
const HOLDER: usize = 8;
const PHANTOM: usize = 9;
const TABLE: usize = 10;
const NEEDLE_BASE: usize = 11;
const NEEDLE_ROBOT: usize = 12;
const OWNERS: usize = 13;

/// The two bodies that are nearest to one another, within the margin.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Nearest {
    /// Names of both.
    pub between: String,
    /// One of them is a moving part of the needle robot.
    pub with_needle_robot: bool,
    /// Distance; negative when they overlap.
    pub distance_m: f64,
}

/// Bodies and the buffers of the detection.
pub(crate) struct Scene {
    bodies: RigidBodySet,
    colliders: ColliderSet,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    pipeline: CollisionPipeline,
    /// Moving links, then the flange with probe and holder.
    moving: [RigidBodyHandle; 7],
    /// Moving links of the needle robot.
    needle_moving: [RigidBodyHandle; 5],
    owner_of: Vec<(ColliderHandle, usize)>,
    names: [String; OWNERS],
    /// Pairs of the arm's own bodies that are near one another by build.
    excused: Vec<(usize, usize)>,
    world_from_base: Pose,
}

impl Scene {
    pub(crate) fn new(
        scenario: &Scenario,
        chain: &Chain,
        needle_robot: &NeedleRobot,
        world_from_needle_base: &Pose,
    ) -> Self {
        let Scenario { arm: spec, probe, phantom, needle_robot: needle_spec, .. } = scenario;
        let mut bodies = RigidBodySet::new();
        let mut colliders = ColliderSet::new();
        let mut owner_of = Vec::new();
        let fixed = bodies.insert(RigidBodyBuilder::fixed());
        let mut kinematic = || bodies.insert(RigidBodyBuilder::kinematic_position_based());
        let moving: [RigidBodyHandle; 7] = std::array::from_fn(|_| kinematic());
        let needle_moving: [RigidBodyHandle; 5] = std::array::from_fn(|_| kinematic());
        let mut insert =
            |builder: ColliderBuilder, owner: usize, body: RigidBodyHandle, body_from_collider: &Pose| {
                let collider = builder
                    .position(narrow(body_from_collider))
                    .collision_groups(groups(owner))
                    .active_collision_types(ActiveCollisionTypes::all());
                let handle = colliders.insert_with_parent(collider, body, &mut bodies);
                owner_of.push((handle, owner));
            };

        let links: Vec<&str> = chain.joints.iter().map(|joint| joint.link.as_str()).collect();
        let arm =
            Mechanism { urdf: &spec.urdf, base_link: &spec.base_link, links: &links, spans: &chain.spans() };
        for (carrier, shape, pose) in arm.shapes() {
            match carrier {
                0 => insert(shape, 0, fixed, &(spec.world_from_base * pose)),
                _ => insert(shape, carrier, moving[carrier - 1], &pose),
            }
        }
        let needle = Mechanism {
            urdf: &needle_spec.urdf,
            base_link: &needle_spec.base_link,
            links: &needle_robot.links(),
            spans: &needle_robot.spans(),
        };
        // Where a hand inserts the needle its robot stands aside, and out of everybody's way.
        let shapes = if scenario.insertion.hand.is_some() { Vec::new() } else { needle.shapes() };
        for (carrier, shape, pose) in shapes {
            match carrier {
                0 => insert(shape, NEEDLE_BASE, fixed, &(world_from_needle_base * pose)),
                _ => insert(shape, NEEDLE_ROBOT, needle_moving[carrier - 1], &pose),
            }
        }

        let flange_from_probe = spec.flange_from_probe;
        let reach_m = flange_from_probe.translation.vector.norm();
        let housing_m = HOUSING_LENGTH_M.min(reach_m * 0.8);
        let housing = cuboid([probe.aperture_m() + 2.0 * HOUSING_RIM_M, HOUSING_DEPTH_M, housing_m]);
        insert(
            housing,
            PROBE,
            moving[6],
            &(flange_from_probe * Pose::translation(0.0, 0.0, -housing_m / 2.0)),
        );
        let holder_m = reach_m - housing_m;
        if holder_m > 1e-3 {
            // A straight block from the flange to the back of the housing.
            let back = (flange_from_probe * Pose::translation(0.0, 0.0, -housing_m)).translation.vector;
            let along = nalgebra::UnitQuaternion::rotation_between(&Vector::z(), &back)
                .unwrap_or_else(nalgebra::UnitQuaternion::identity);
            let middle = Pose::from_parts((back / 2.0).into(), along);
            insert(cuboid([HOLDER_SIDE_M, HOLDER_SIDE_M, back.norm()]), HOLDER, moving[6], &middle);
        }

        let [x, y, z] = phantom.size_m;
        insert(cuboid([x, y, z]), PHANTOM, fixed, &Pose::translation(0.0, 0.0, -z / 2.0));
        let table = cuboid([x + 2.0 * TABLE_REACH_M, y + 2.0 * TABLE_REACH_M, TABLE_THICKNESS_M]);
        insert(table, TABLE, fixed, &Pose::translation(0.0, 0.0, -z - TABLE_THICKNESS_M / 2.0));

        let mut names: [String; OWNERS] = std::array::from_fn(|_| String::new());
        names[0] = spec.base_link.clone();
        for (name, joint) in names[1..].iter_mut().zip(&chain.joints) {
            name.clone_from(&joint.link);
        }
        for (owner, name) in [
            (PROBE, "probe"),
            (HOLDER, "holder"),
            (PHANTOM, "phantom"),
            (TABLE, "table"),
            (NEEDLE_BASE, "needle robot's base"),
            (NEEDLE_ROBOT, "needle robot"),
        ] {
            names[owner] = name.into();
        }
        Self {
            bodies,
            colliders,
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            pipeline: CollisionPipeline::new(),
            moving,
            needle_moving,
            owner_of,
            names,
            excused: Vec::new(),
            world_from_base: spec.world_from_base,
        }
    }

    /// Excuses pairs of the arm's own bodies that are near at `link_poses` (base frame): how its designer
    /// drew them, not how it moves.
    pub(crate) fn excuse_own_neighbours(&mut self, link_poses: &[Pose; 7], needle_links: &[Pose; 5]) {
        let own = |owner: usize| owner <= HOLDER;
        let near = self.near_pairs(link_poses, needle_links);
        self.excused = near.into_iter().map(|(a, b, _)| (a, b)).filter(|&(a, b)| own(a) && own(b)).collect();
    }

    /// The nearest pair within the margin with the arm's links at `link_poses` (base frame) and the needle robot's at
    /// `needle_links` (world frame); probe on phantom and excused pairs do not count.
    pub(crate) fn nearest(&mut self, link_poses: &[Pose; 7], needle_links: &[Pose; 5]) -> Option<Nearest> {
        let near = self.near_pairs(link_poses, needle_links);
        let (a, b, distance_m) = near
            .into_iter()
            .filter(|&(a, b, _)| !self.excused.contains(&(a, b)))
            .min_by(|l, r| l.2.total_cmp(&r.2).then((l.0, l.1).cmp(&(r.0, r.1))))?;
        Some(Nearest {
            between: format!("{} and {}", self.names[a], self.names[b]),
            with_needle_robot: b == NEEDLE_ROBOT,
            distance_m,
        })
    }

    /// Owners (smaller first) and distance of every pair within the margin.
    fn near_pairs(&mut self, link_poses: &[Pose; 7], needle_links: &[Pose; 5]) -> Vec<(usize, usize, f64)> {
        let arm = link_poses.iter().map(|base_from_link| self.world_from_base * base_from_link);
        let needle = needle_links.iter().copied();
        let handles = self.moving.iter().chain(&self.needle_moving);
        for (handle, world_from_link) in handles.zip(arm.chain(needle)) {
            if let Some(body) = self.bodies.get_mut(*handle) {
                body.set_position(narrow(&world_from_link), true);
            }
        }
        self.pipeline.step(
            MARGIN_M as f32,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &(),
            &(),
        );
        let owner =
            |handle| self.owner_of.iter().find(|(known, _)| *known == handle).map(|(_, owner)| *owner);
        let mut near = Vec::new();
        for pair in self.narrow_phase.contact_pairs() {
            let Some((_, contact)) = pair.find_deepest_contact() else { continue };
            let (Some(a), Some(b)) = (owner(pair.collider1), owner(pair.collider2)) else { continue };
            let distance_m = f64::from(contact.dist);
            if distance_m < MARGIN_M {
                near.push((a.min(b), a.max(b), distance_m));
            }
        }
        near
    }
}

/// A robot of bodies that its joints move.
struct Mechanism<'a> {
    urdf: &'a urdf_rs::Robot,
    base_link: &'a str,
    /// Links that the joints move, in order.
    links: &'a [&'a str],
    /// From the base's origin, then from each moved link's, to the next joint; from the last to the tip.
    spans: &'a [Vector],
}

impl Mechanism<'_> {
    /// Every collision shape: the carrier (0 the base, then the moved links), the collider, its pose in the carrier.
    fn shapes(&self) -> Vec<(usize, ColliderBuilder, Pose)> {
        let mut shapes = Vec::new();
        let mut by_mesh = vec![false; self.spans.len()];
        for link in &self.urdf.links {
            let Some((carrier, carrier_from_link)) = self.carrier(&link.name) else { continue };
            for collision in &link.collision {
                if matches!(collision.geometry, urdf_rs::Geometry::Mesh { .. }) {
                    by_mesh[carrier] = true;
                }
                let Some((shape, along_y)) = primitive(&collision.geometry) else { continue };
                shapes.push((
                    carrier,
                    shape,
                    carrier_from_link * pose_from_urdf(&collision.origin) * along_y,
                ));
            }
        }
        for (carrier, span) in self.spans.iter().enumerate().filter(|(carrier, _)| by_mesh[*carrier]) {
            let end = Vector32::new(span.x as f32, span.y as f32, span.z as f32);
            let capsule = ColliderBuilder::capsule_from_endpoints(Vector32::ZERO, end, MESH_RADIUS_M as f32);
            shapes.push((carrier, capsule, Pose::identity()));
        }
        shapes
    }

    /// What carries a link over fixed joints, and the link's pose in it; `None` when the link hangs elsewhere.
    fn carrier(&self, link: &str) -> Option<(usize, Pose)> {
        let mut link = link;
        let mut pose = Pose::identity();
        for _ in 0..=self.urdf.joints.len() {
            if let Some(index) = self.links.iter().position(|moved| *moved == link) {
                return Some((index + 1, pose));
            }
            if link == self.base_link {
                return Some((0, pose));
            }
            let joint = self.urdf.joints.iter().find(|j| j.child.link == link)?;
            if joint.joint_type != urdf_rs::JointType::Fixed {
                return None;
            }
            pose = pose_from_urdf(&joint.origin) * pose;
            link = &joint.parent.link;
        }
        None
    }
}

/// Collider and the turn from URDF's z-axis to rapier's y-axis; `None` for a mesh or a shape of no size.
fn primitive(geometry: &urdf_rs::Geometry) -> Option<(ColliderBuilder, Pose)> {
    let along_y = Pose::from_parts(
        nalgebra::Translation3::identity(),
        nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::FRAC_PI_2),
    );
    let sound = |values: &[f64]| values.iter().all(|v| v.is_finite() && *v > 0.0);
    match geometry {
        urdf_rs::Geometry::Box { size } => sound(&size.0).then(|| (cuboid(size.0), Pose::identity())),
        urdf_rs::Geometry::Sphere { radius } => {
            sound(&[*radius]).then(|| (ColliderBuilder::ball(*radius as f32), Pose::identity()))
        }
        urdf_rs::Geometry::Cylinder { radius, length } => sound(&[*radius, *length])
            .then(|| (ColliderBuilder::cylinder((length / 2.0) as f32, *radius as f32), along_y)),
        urdf_rs::Geometry::Capsule { radius, length } => sound(&[*radius, *length])
            .then(|| (ColliderBuilder::capsule_z((length / 2.0) as f32, *radius as f32), Pose::identity())),
        urdf_rs::Geometry::Mesh { .. } => None,
    }
}

fn cuboid(size_m: [f64; 3]) -> ColliderBuilder {
    let [x, y, z] = size_m.map(|edge| (edge / 2.0) as f32);
    ColliderBuilder::cuboid(x, y, z)
}

/// Neighbours along the chain, the wrist beside what it carries, the probe on the phantom: these may touch.
fn groups(owner: usize) -> InteractionGroups {
    let bit = |owner: usize| 1u32 << owner;
    let mut ignored = bit(owner);
    match owner {
        0..=6 => {
            ignored |= bit(owner + 1) | if owner > 0 { bit(owner - 1) } else { bit(TABLE) | bit(PHANTOM) };
            if owner >= 4 {
                ignored |= bit(PROBE) | bit(HOLDER);
            } else {
                ignored &= !bit(PROBE);
            }
        }
        PROBE => ignored |= bit(4) | bit(5) | bit(6) | bit(HOLDER) | bit(PHANTOM),
        HOLDER => ignored |= bit(4) | bit(5) | bit(6) | bit(PROBE),
        PHANTOM => ignored |= bit(PROBE) | bit(TABLE) | bit(0) | bit(NEEDLE_BASE),
        // Bases are bolted down where their owner wants them.
        NEEDLE_BASE => ignored |= bit(NEEDLE_ROBOT) | bit(PHANTOM) | bit(TABLE) | bit(0),
        NEEDLE_ROBOT => ignored |= bit(NEEDLE_BASE),
        _ => ignored |= bit(PHANTOM) | bit(0) | bit(NEEDLE_BASE),
    }
    InteractionGroups::new(
        Group::from_bits_truncate(bit(owner)),
        Group::from_bits_truncate(!ignored),
        InteractionTestMode::And,
    )
}

fn narrow(pose: &Pose) -> Pose32 {
    let t = pose.translation.vector;
    let q = pose.rotation.coords;
    Pose32::from_parts(
        Vector32::new(t.x as f32, t.y as f32, t.z as f32),
        Rotation32::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32),
    )
}

#[cfg(test)]
mod tests {
    use sonoloop_types::Point;

    use super::*;
    use crate::fixture;

    /// The arm at home, the needle robot far away.
    fn scene() -> (Scene, [Pose; 7]) {
        scene_of(&fixture::scenario())
    }

    fn scene_of(scenario: &Scenario) -> (Scene, [Pose; 7]) {
        let chain = Chain::from_spec(&scenario.arm).unwrap();
        let spec = &scenario.needle_robot;
        let robot = NeedleRobot::new(spec, 0.15, Point::origin(), Vector::x()).unwrap();
        let mut scene = Scene::new(scenario, &chain, &robot, &spec.world_from_base);
        let poses = chain.link_poses(&scenario.arm.home_rad);
        scene.excuse_own_neighbours(&poses, &AWAY);
        (scene, poses)
    }

    static AWAY: std::sync::LazyLock<[Pose; 5]> =
        std::sync::LazyLock::new(|| [Pose::translation(-5.0, 0.0, 0.0); 5]);

    /// Link poses with the probe's face at a place in the world, looking down; the other links at home.
    fn with_probe_at(poses: &[Pose; 7], x_m: f64, z_m: f64) -> [Pose; 7] {
        let spec = fixture::kuka();
        let down = nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI);
        let world_from_probe = Pose::from_parts(Vector::new(x_m, 0.0, z_m).into(), down);
        let mut moved = *poses;
        moved[6] = spec.world_from_base.inverse() * world_from_probe * spec.flange_from_probe.inverse();
        moved
    }

    #[test]
    fn truth_a_capsule_from_joint_to_joint_stands_for_a_mesh() {
        let mut scenario = fixture::scenario();
        // The wrist's body is a mesh that is nowhere: 80 mm from the joint's origin to the next.
        let link = scenario.arm.urdf.links.iter_mut().find(|link| link.name == "link_5").unwrap();
        link.collision[0].geometry =
            urdf_rs::Geometry::Mesh { filename: "package://nowhere/link_5.stl".into(), scale: None };
        let (mut scene, poses) = scene_of(&scenario);
        // Out in the open, the link's x pointing down, its far end 54 mm over the table at −60 mm.
        let down = nalgebra::UnitQuaternion::from_axis_angle(&Vector::y_axis(), std::f64::consts::FRAC_PI_2);
        let mut moved = poses;
        let world_from_link = Pose::from_parts(Vector::new(0.2, 0.0, -0.06 + 0.054 + 0.08).into(), down);
        moved[4] = scenario.arm.world_from_base.inverse() * world_from_link;
        let near = scene.nearest(&moved, &AWAY).expect("4 mm over the table");
        assert_eq!(near.between, "link_5 and table");
        assert!((near.distance_m - 4e-3).abs() < 1e-5, "{}", near.distance_m);
    }

    #[test]
    fn probe_may_press_on_the_phantom() {
        let (mut scene, poses) = scene();
        assert_eq!(scene.nearest(&with_probe_at(&poses, 0.0, -0.004), &AWAY), None);
    }

    #[test]
    fn truth_distance_of_probe_and_table_is_found_within_the_margin() {
        let (mut scene, poses) = scene();
        // Beside the phantom (x up to 0.1), over the table, whose top is at −60 mm.
        let near = scene.nearest(&with_probe_at(&poses, 0.15, -0.057), &AWAY).expect("3 mm over the table");
        assert_eq!(near.between, "probe and table");
        assert!((near.distance_m - 3e-3).abs() < 1e-5, "{}", near.distance_m);
        assert_eq!(scene.nearest(&with_probe_at(&poses, 0.15, -0.054), &AWAY), None);
        let deep = scene.nearest(&with_probe_at(&poses, 0.15, -0.061), &AWAY).unwrap();
        assert!((deep.distance_m + 1e-3).abs() < 1e-5, "{}", deep.distance_m);
        // And back again: the answer does not depend on where the arm has been.
        let again = scene.nearest(&with_probe_at(&poses, 0.15, -0.057), &AWAY).unwrap();
        assert_eq!(again, near);
    }
}
