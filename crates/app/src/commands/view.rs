//! Where the probe and the needle of a single picture are.

use std::ops::Range;

use sonoloop_types::{NeedlePath, Point, Pose, ProbeSpec, Slice, Vector};

/// Length of needle that is drawn, and the number of its pieces.
const NEEDLE_LENGTH_M: f64 = 60e-3;
const NEEDLE_PIECES: u32 = 60;
/// Far more than the gap at which an element is blind.
const GAP_M: f32 = 1e-3;

/// A probe on the top face of a phantom, and what it sees.
#[derive(Debug, Clone, Default)]
pub struct View {
    /// Middle of the probe along the phantom's x.
    pub x_m: f64,
    /// Middle of the probe along the phantom's y.
    pub y_m: f64,
    /// Turn about the vertical.
    pub yaw_rad: f64,
    /// Lean of the plane in elevation.
    pub tilt_rad: f64,
    /// The needle, if one is in the phantom.
    pub needle: Option<NeedleView>,
    /// Stretch of the array without contact, as shares of its length.
    pub lifted: Range<f64>,
    /// The gap grows from nothing at the right end of that stretch, as under a probe that leans.
    pub slanted: bool,
    /// Gain on top of the probe's own.
    pub gain_db: f64,
}

/// A straight needle, seen from the probe.
#[derive(Debug, Clone, Copy)]
pub struct NeedleView {
    /// Below the horizontal.
    pub angle_rad: f64,
    /// Depth of the tip below the middle of the probe.
    pub tip_depth_m: f64,
    /// Lateral: distance of the needle from the plane. Transverse: how far the tip is past the plane, along the needle.
    pub offset_m: f64,
    /// The needle crosses the plane instead of lying in it.
    pub transverse: bool,
    /// Turn of the needle about the vertical through its tip.
    pub yaw_rad: f64,
}

impl View {
    /// The probe stands on the top face, pointing down, before yaw and tilt.
    fn phantom_from_probe(&self) -> Pose {
        let down = Pose::rotation(Vector::x() * std::f64::consts::PI);
        Pose::translation(self.x_m, self.y_m, 0.0)
            * Pose::rotation(Vector::z() * self.yaw_rad)
            * down
            * Pose::rotation(Vector::x() * self.tilt_rad)
    }

    /// What the renderer is asked for.
    pub fn slice(&self, probe: &ProbeSpec) -> Slice {
        let phantom_from_probe = self.phantom_from_probe();
        let elements = f64::from(probe.elements);
        let gap_m = |element: u32| {
            let (place, Range { start, end }) = ((f64::from(element) + 0.5) / elements, self.lifted.clone());
            let share = if self.slanted { ((end - place) / (end - start)) as f32 } else { 1.0 };
            if self.lifted.contains(&place) { GAP_M * share } else { 0.0 }
        };
        Slice {
            sequence: 0,
            phantom_from_probe,
            needle: self.needle.map(|needle| needle.path(&phantom_from_probe)),
            needle_gain_db: 0.0,
            element_gap_m: (0..probe.elements).map(gap_m).collect(),
            element_loss_db: Vec::new(),
            indentation: None,
            drag: None,
            gain_db: self.gain_db,
            noise_gain_db: 0.0,
        }
    }
}

impl NeedleView {
    fn path(&self, phantom_from_probe: &Pose) -> NeedlePath {
        let (sin, cos) = self.angle_rad.sin_cos();
        let offset = self.offset_m;
        // The bevel's face looks up to the probe.
        let (axis, up, offset) = if self.transverse {
            let axis = Vector::new(0.0, cos, sin);
            (axis, Vector::new(0.0, sin, -cos), axis * offset)
        } else {
            (Vector::new(cos, 0.0, sin), Vector::new(sin, 0.0, -cos), Vector::new(0.0, offset, 0.0))
        };
        let turn = Pose::rotation(Vector::z() * self.yaw_rad);
        let (axis, up) = (turn * axis, turn * up);
        let tip = Point::new(0.0, 0.0, self.tip_depth_m) + offset;
        let at = |k: u32| {
            let behind_tip_m = NEEDLE_LENGTH_M * f64::from(NEEDLE_PIECES - k) / f64::from(NEEDLE_PIECES);
            phantom_from_probe * (tip - axis * behind_tip_m)
        };
        NeedlePath {
            centreline_in_phantom: (0..=NEEDLE_PIECES).map(at).collect(),
            axis_in_phantom: phantom_from_probe * axis,
            bevel_normal_in_phantom: phantom_from_probe * up,
        }
    }
}
