use serde::{Deserialize, Serialize};

use crate::{Point, Vector};

/// A needle as its maker describes it, and how it echoes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NeedleSpec {
    /// Name shown in reports.
    pub name: String,
    /// Outer diameter of the shaft.
    pub outer_diameter_m: f64,
    /// Length of the shaft.
    pub length_m: f64,
    /// Angle between the bevel's face and the needle's axis.
    pub bevel_rad: f64,
    /// Curvature of the path the bevel steers into, κ.
    pub curvature_per_m: f64,
    /// Coherent (specular) echo of the shaft at normal incidence, dB over unit-backscatter speckle.
    pub specular_level_db: f64,
    /// Incoherent echo of the shaft's roughness at any angle, dB over unit-backscatter speckle.
    pub rough_level_db: f64,
    /// Echo of the tip (bevel facet and edge), dB over unit-backscatter speckle.
    pub tip_level_db: f64,
}

/// Where the needle lies at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct NeedlePath {
    /// Centre line in the phantom frame, from the entry to the tip, at most 2 mm apart.
    pub centreline_in_phantom: Vec<Point>,
    /// Unit vector along which the tip would go on, phantom frame.
    pub axis_in_phantom: Vector,
    /// Unit normal of the bevel's face, pointing out of the steel, phantom frame.
    pub bevel_normal_in_phantom: Vector,
}

impl NeedlePath {
    /// The tip, last point of the centre line, phantom frame. Panics on an empty line.
    pub fn tip_in_phantom(&self) -> Point {
        *self.centreline_in_phantom.last().expect("a needle path has at least its tip")
    }
}
