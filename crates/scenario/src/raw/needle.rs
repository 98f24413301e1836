use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// A needle: its maker's figures and how it echoes.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawNeedle {
    /// Name shown in reports.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// Outer diameter of the shaft.
    #[garde(range(min = 0.1, max = 5.0))]
    pub outer_diameter_mm: f64,
    /// Length of the shaft.
    #[garde(range(min = 10.0, max = 500.0))]
    pub length_mm: f64,
    /// Angle between the bevel's face and the needle's axis.
    #[garde(range(min = 5.0, max = 90.0))]
    pub bevel_deg: f64,
    /// Curvature of the path that the bevel steers into; 0 goes straight.
    #[garde(range(min = 0.0, max = 20.0))]
    pub curvature_per_m: f64,
    /// Coherent echo of the shaft at normal incidence, over unit-backscatter speckle.
    #[garde(range(min = -20.0, max = 80.0))]
    pub specular_level_db: f64,
    /// Incoherent echo of the shaft's roughness at any angle, over unit-backscatter speckle.
    #[garde(range(min = -40.0, max = 60.0))]
    pub rough_level_db: f64,
    /// Echo of the tip, over unit-backscatter speckle.
    #[garde(range(min = -40.0, max = 60.0))]
    pub tip_level_db: f64,
}
