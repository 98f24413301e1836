use iceoryx2::prelude::ZeroCopySend;
use sonoloop_types::{Point, Truth};

use super::{Defect, LAYOUT_VERSION, check_run, check_version, decode_bool, decode_pose, encode_pose};

/// The truth at one tick, on its own domain; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("sonoloop::Truth")]
#[repr(C)]
pub struct TruthMessage {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// 1 when the tip is visible.
    pub visible: u8,
    /// 1 while a collision exists.
    pub collision: u8,
    /// 1 when the run is held at this tick.
    pub held: u8,
    /// Zero.
    pub reserved: u8,
    /// The run.
    pub run_id: u64,
    /// Tick of all values.
    pub tick: u64,
    /// True pose of the probe.
    pub world_from_probe: [f64; 7],
    /// Tip, world frame.
    pub tip_in_world: [f64; 3],
    /// Tip, probe frame.
    pub tip_in_probe: [f64; 3],
    /// Where a tracker should point, pixels.
    pub reference_px: [f64; 2],
    /// Signed distance of the tip from the plane.
    pub plane_to_tip_m: f64,
    /// Insertion depth.
    pub depth_m: f64,
    /// Speed of the needle.
    pub feed_m_s: f64,
    /// Contact force.
    pub contact_force_n: f64,
    /// Distance of the tip from the target.
    pub target_distance_m: f64,
    /// Smallest distance of any joint to its limit.
    pub min_joint_margin_rad: f64,
    /// Force on the needle against the insertion.
    pub needle_force_n: f64,
}

impl TruthMessage {
    /// The message that carries `truth`; `held` says that the run goes no further until asked to.
    pub fn encode(run_id: u64, truth: &Truth, held: bool) -> Self {
        Self {
            version: LAYOUT_VERSION,
            visible: truth.visible.into(),
            collision: truth.collision.into(),
            held: held.into(),
            reserved: 0,
            run_id,
            tick: truth.tick,
            world_from_probe: encode_pose(&truth.world_from_probe),
            tip_in_world: truth.tip_in_world.coords.into(),
            tip_in_probe: truth.tip_in_probe.coords.into(),
            reference_px: truth.reference_px,
            plane_to_tip_m: truth.plane_to_tip_m,
            depth_m: truth.depth_m,
            feed_m_s: truth.feed_m_s,
            contact_force_n: truth.contact_force_n,
            target_distance_m: truth.target_distance_m,
            min_joint_margin_rad: truth.min_joint_margin_rad,
            needle_force_n: truth.needle_force_n,
        }
    }

    /// The truth, and whether the run is held. Checks version, run, flags and pose; the other values may be NaN
    /// where the truth has none.
    ///
    /// # Errors
    /// The first defect found.
    pub fn decode(&self, run_id: u64) -> Result<(Truth, bool), Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)?;
        let truth = Truth {
            tick: self.tick,
            world_from_probe: decode_pose(&self.world_from_probe, "world_from_probe")?,
            tip_in_world: Point::from(self.tip_in_world),
            tip_in_probe: Point::from(self.tip_in_probe),
            reference_px: self.reference_px,
            plane_to_tip_m: self.plane_to_tip_m,
            visible: decode_bool(self.visible, "visible")?,
            depth_m: self.depth_m,
            feed_m_s: self.feed_m_s,
            contact_force_n: self.contact_force_n,
            target_distance_m: self.target_distance_m,
            min_joint_margin_rad: self.min_joint_margin_rad,
            needle_force_n: self.needle_force_n,
            collision: decode_bool(self.collision, "collision")?,
        };
        Ok((truth, decode_bool(self.held, "held")?))
    }
}
