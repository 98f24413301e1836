//! Files that people write → checked [`Scenario`].
//!
//! | module | does |
//! |---|---|
//! | `source` | reads a text file |
//! | `tree`, `document` | the parsed file, every value with its place, so that any complaint can point at it |
//! | `raw` | serde structs with `deny_unknown_fields`: units of the files (`_mm`, `_deg`, `_s`), ranges |
//! | `check` | raw → model, and everything that takes two values or two files to judge |
//! | `load`, `randomize` | file, `--set` and seed → resolved text → scenario |
//! | `model` | SI units and radians; has kept every bound |
//!
//! A resolved scenario is a text again, and the [`Scenario`] is built from that text: loading
//! [`Scenario::resolved_yaml`] from the same folder gives the same scenario.

mod check;
mod document;
mod error;
mod load;
mod metrics;
mod model;
mod randomize;
mod raw;
mod relocate;
mod schema;
mod source;
mod tree;

pub use error::LoadError;
pub use load::{
    LoadOptions, add_disturbance, load, load_materials, load_needle, load_phantom, load_probe,
    load_probe_with, load_text,
};
pub use metrics::METRICS;
pub use model::{
    ArmSpec, Bound, CalibrationSpec, DelaySpec, Disturbance, DisturbanceKind, Expectation, Inclusion,
    InsertionSpec, Material, NeedleRobotSpec, OpwSpec, PassageSpec, PhantomMotion, PhantomSpec,
    PlacementSpec, Scenario, Shape,
};
pub use schema::{FileKind, schema};
