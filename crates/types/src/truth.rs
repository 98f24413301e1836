use crate::{Point, Pose};

/// What really is the case at one tick; for the judge and the viewer, never for a tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Tick of all values below.
    pub tick: u64,
    /// True pose of the probe.
    pub world_from_probe: Pose,
    /// Tip of the needle, world frame.
    pub tip_in_world: Point,
    /// Tip of the needle, probe frame; its y is the distance to the image plane.
    pub tip_in_probe: Point,
    /// Where a tracker should point, pixels: lateral the projected tip, transverse the needle's axis ∩ plane.
    pub reference_px: [f64; 2],
    /// Signed distance of the tip from the plane: lateral along elevation; transverse along the needle.
    pub plane_to_tip_m: f64,
    /// Tip within half the −6 dB slice thickness of the plane, inside the picture, and 0.71 of its aperture in contact.
    pub visible: bool,
    /// Insertion depth along the needle, as the hub stands.
    pub depth_m: f64,
    /// Speed of the needle's hub along its axis.
    pub feed_m_s: f64,
    /// True force on the needle against the insertion.
    pub needle_force_n: f64,
    /// True contact force along the probe's axis.
    pub contact_force_n: f64,
    /// Distance of the tip from the target.
    pub target_distance_m: f64,
    /// Smallest distance of any joint to its limit.
    pub min_joint_margin_rad: f64,
    /// True while any collision other than probe on phantom exists.
    pub collision: bool,
}
