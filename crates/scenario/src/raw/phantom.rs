use std::collections::BTreeMap;

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// A block of tissue mimic with inclusions. Origin at the centre of the top face, z up.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawPhantom {
    /// Name shown in reports.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// Extent along x, y, z.
    #[garde(inner(range(min = 5.0, max = 1000.0)))]
    pub size_mm: [f64; 3],
    /// The materials file, relative to this file.
    #[garde(length(min = 1))]
    pub materials: String,
    /// Material of the block.
    pub background: String,
    /// Bodies inside; where two overlap the later one counts.
    #[serde(default)]
    #[garde(length(max = 200), dive)]
    pub inclusions: Vec<RawInclusion>,
}

/// A body inside the phantom: one of `ellipsoid`, `cylinder`, `cuboid`.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawInclusion {
    /// Name, unique in the phantom.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// Its material.
    pub material: String,
    /// Its middle, phantom frame.
    #[garde(inner(range(min = -1000.0, max = 1000.0)))]
    pub centre_mm: [f64; 3],
    /// Roll, pitch, yaw about the fixed axes x, y, z.
    #[serde(default)]
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub rpy_deg: [f64; 3],
    /// An ellipsoid.
    #[serde(default)]
    #[garde(dive)]
    pub ellipsoid: Option<RawEllipsoid>,
    /// A cylinder about its own z axis.
    #[serde(default)]
    #[garde(dive)]
    pub cylinder: Option<RawCylinder>,
    /// A box.
    #[serde(default)]
    #[garde(dive)]
    pub cuboid: Option<RawCuboid>,
}

/// Half axes along x, y, z.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawEllipsoid {
    /// Half axes.
    #[garde(inner(range(min = 0.01, max = 500.0)))]
    pub radii_mm: [f64; 3],
}

/// Axis along z.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCylinder {
    /// Radius.
    #[garde(range(min = 0.01, max = 500.0))]
    pub radius_mm: f64,
    /// Whole length.
    #[garde(range(min = 0.01, max = 1000.0))]
    pub length_mm: f64,
}

/// Edges along x, y, z.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCuboid {
    /// Whole edge lengths.
    #[garde(inner(range(min = 0.01, max = 1000.0)))]
    pub size_mm: [f64; 3],
}

/// Materials by name.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawMaterials {
    /// Materials by name.
    #[garde(length(min = 1, max = 1000), dive)]
    pub materials: BTreeMap<String, RawMaterial>,
}

/// One material.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawMaterial {
    /// Sound speed; from gases to metals.
    #[garde(range(min = 300.0, max = 7000.0))]
    pub sound_speed_m_s: f64,
    /// One-way attenuation at 1 MHz.
    #[garde(range(min = 0.0, max = 20.0))]
    pub attenuation_db_cm_mhz: f64,
    /// Exponent of the frequency in the attenuation; 1 is proportional.
    #[garde(range(min = 0.5, max = 2.0))]
    pub attenuation_exponent: f64,
    /// Density; from gases to metals.
    #[garde(range(min = 1.0, max = 20000.0))]
    pub density_kg_m3: f64,
    /// Scatter power relative to unit backscatter; null where nothing scatters.
    #[garde(range(min = -60.0, max = 40.0))]
    #[serde(deserialize_with = "Option::deserialize")]
    #[schemars(required)]
    pub backscatter_db: Option<f64>,
    /// Young's modulus; null for liquids.
    #[garde(range(min = 0.01, max = 300000000.0))]
    #[serde(deserialize_with = "Option::deserialize")]
    #[schemars(required)]
    pub youngs_modulus_kpa: Option<f64>,
    /// How a needle gets through; null where none does.
    #[garde(dive)]
    #[serde(deserialize_with = "Option::deserialize")]
    #[schemars(required)]
    pub needle: Option<RawPassage>,
}

/// How a material lets a needle through. Forces are those on a 22G needle; others scale with the diameter.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawPassage {
    /// Friction on the shaft per buried length.
    #[garde(range(min = 0.0, max = 1000.0))]
    pub friction_n_m: f64,
    /// Force on the tip while it cuts.
    #[garde(range(min = 0.0, max = 50.0))]
    pub cutting_n: f64,
    /// Force on the tip at which it pierces the material's face; at least `cutting_n`.
    #[garde(range(min = 0.0, max = 50.0))]
    pub puncture_n: f64,
    /// a₁ of the force a₁x + a₂x² on a face that has given way by x.
    #[garde(range(min = 0.0, max = 1e6))]
    pub stiffness_n_m: f64,
    /// a₂ of the same.
    #[garde(range(min = 0.0, max = 1e9))]
    pub stiffening_n_m2: f64,
    /// Distance from the tip at which 1/e of what it carries along is left.
    #[garde(range(min = 0.1, max = 100.0))]
    pub drag_decay_mm: f64,
    /// Share of the needle's own curvature that its bevel steers into here; 0 is straight on.
    #[garde(range(min = 0.0, max = 10.0))]
    pub bending: f64,
}
