//! Where robots, needle and phantom are, for those who draw them.

use sonoloop_types::{Point, Pose, Slice};
use sonoloop_world::World;

/// What stood where when a picture was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    /// Joint angles of the arm.
    pub arm_rad: [f64; 6],
    /// Joints of the needle robot, metres and radians; `None` where a hand inserts.
    pub needle_robot: Option<[f64; 5]>,
    /// The phantom; it shifts without turning.
    pub world_from_phantom: Pose,
    /// Centre line of the needle from its entry to the tip, world frame; empty before it is in the phantom.
    pub needle_in_world: Vec<Point>,
}

impl Posture {
    /// That of a picture that is taken now; `slice` is what it shows.
    pub fn of(world: &World, slice: &Slice) -> Self {
        let world_from_phantom = world.truth().world_from_probe * slice.phantom_from_probe.inverse();
        let centreline = slice.needle.iter().flat_map(|needle| &needle.centreline_in_phantom);
        Self {
            arm_rad: world.joint_angles_rad(),
            needle_robot: world.needle_robot_joints(),
            world_from_phantom,
            needle_in_world: centreline.map(|point| world_from_phantom * point).collect(),
        }
    }
}
