//! The bytes of every message, and the way back into checked values.
//!
//! `docs/wire.md` holds the table of offsets for other languages; a test keeps the two together. All structs
//! are `repr(C)` without hidden padding, little-endian on every machine that sonoloop runs on. `f64::NAN`
//! stands for "no value" where the table says so; a pose is position x, y, z then quaternion x, y, z, w.
//!
//! Shared memory is untrusted: every `decode` works on a copy and checks version, run, numbers, ranges and
//! sizes before a value gets out. Enumerations are bytes, never Rust enums.

mod codes;
mod command;
mod handshake;
mod image;
mod truth;

pub use command::CommandMessage;
pub use handshake::{BlobHeader, EndMessage, ReadyMessage};
pub use image::{ImageHeader, ReceivedImage};
pub use truth::TruthMessage;

use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use sonoloop_types::{Pose, Refusal};

/// Version of all layouts in this module; the first field of every message.
pub const LAYOUT_VERSION: u32 = 1;

/// How far a quaternion's norm may be from one.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Why bytes do not make a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Defect {
    /// Another layout version.
    #[error("layout version {found}, expected {LAYOUT_VERSION}")]
    Version {
        /// The version found.
        found: u32,
    },
    /// A message of another run.
    #[error("run id {found:#018x}, expected {expected:#018x}")]
    OtherRun {
        /// The id found.
        found: u64,
        /// This run's id.
        expected: u64,
    },
    /// A number is infinite, or NaN where a value must be.
    #[error("{field} is not finite")]
    NotFinite {
        /// Name of the field in the table.
        field: &'static str,
    },
    /// A quaternion is not of unit length.
    #[error("the quaternion of {field} is not of unit length")]
    NotUnit {
        /// Name of the field in the table.
        field: &'static str,
    },
    /// A byte is not one of the numbers of its enumeration.
    #[error("{field} = {value} has no meaning")]
    Code {
        /// Name of the field in the table.
        field: &'static str,
        /// The byte found.
        value: u8,
    },
    /// A size is out of bounds or does not match the bytes that came.
    #[error("{field} is out of bounds or does not match the payload")]
    Size {
        /// Name of the field in the table.
        field: &'static str,
    },
    /// Bytes that should be text are not.
    #[error("{field} is not UTF-8 text")]
    Text {
        /// Name of the field in the table.
        field: &'static str,
    },
}

impl Defect {
    /// How a command with this defect is refused.
    pub fn refusal(&self) -> Refusal {
        match self {
            Self::NotFinite { .. } => Refusal::NotFinite,
            Self::OtherRun { .. } => Refusal::OtherRun,
            Self::Version { .. }
            | Self::NotUnit { .. }
            | Self::Code { .. }
            | Self::Size { .. }
            | Self::Text { .. } => Refusal::Malformed,
        }
    }
}

fn check_version(found: u32) -> Result<(), Defect> {
    if found == LAYOUT_VERSION { Ok(()) } else { Err(Defect::Version { found }) }
}

fn check_run(found: u64, expected: u64) -> Result<(), Defect> {
    if found == expected { Ok(()) } else { Err(Defect::OtherRun { found, expected }) }
}

fn finite(value: f64, field: &'static str) -> Result<f64, Defect> {
    if value.is_finite() { Ok(value) } else { Err(Defect::NotFinite { field }) }
}

/// NaN is "no value"; infinite is a defect.
fn optional(value: f64, field: &'static str) -> Result<Option<f64>, Defect> {
    if value.is_nan() { Ok(None) } else { finite(value, field).map(Some) }
}

fn encode_optional(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

fn encode_pose(pose: &Pose) -> [f64; 7] {
    let (position, quaternion) = (&pose.translation, &pose.rotation);
    [position.x, position.y, position.z, quaternion.i, quaternion.j, quaternion.k, quaternion.w]
}

fn decode_pose(values: &[f64; 7], field: &'static str) -> Result<Pose, Defect> {
    for &value in values {
        finite(value, field)?;
    }
    let [x, y, z, i, j, k, w] = *values;
    let quaternion = Quaternion::new(w, i, j, k);
    // A norm that overflows is infinite and outside as well; it is never NaN, as all parts are finite.
    if (quaternion.norm() - 1.0).abs() > UNIT_TOLERANCE {
        return Err(Defect::NotUnit { field });
    }
    // Taken over bit by bit: normalising again would make a run over the wire differ from one without.
    Ok(Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_unchecked(quaternion)))
}

fn decode_bool(value: u8, field: &'static str) -> Result<bool, Defect> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        value => Err(Defect::Code { field, value }),
    }
}

/// Cuts `text` to the last whole character that fits and fills up with zeros.
fn encode_text<const N: usize>(text: &str) -> [u8; N] {
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut bytes = [0; N];
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

fn decode_text(bytes: &[u8], field: &'static str) -> Result<String, Defect> {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    let text = std::str::from_utf8(&bytes[..end]).map_err(|_| Defect::Text { field })?;
    // Control characters would reach the user's terminal.
    if text.chars().any(char::is_control) { Err(Defect::Text { field }) } else { Ok(text.to_owned()) }
}
