use std::fmt;

use garde::Validate;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};

/// One thing that goes wrong: `at_s` and exactly one of the other keys.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawDisturbance {
    /// When.
    #[garde(range(min = 0.0, max = 3600.0))]
    pub at_s: f64,
    /// The probe slips in its holder; no measured value shows it.
    #[serde(default)]
    #[garde(dive)]
    pub probe_knock: Option<RawKnock>,
    /// The probe is lifted off and put back.
    #[serde(default)]
    #[garde(dive)]
    pub lift_off: Option<RawLiftOff>,
    /// The receiver's gain steps.
    #[serde(default)]
    #[garde(dive)]
    pub gain_change: Option<RawGain>,
    /// The needle's echo steps.
    #[serde(default)]
    #[garde(dive)]
    pub needle_brightness: Option<RawGain>,
    /// The tracker is killed and started again.
    #[serde(default)]
    #[garde(dive)]
    pub tracker_killed: Option<RawTrackerKilled>,
    /// From now on pictures arrive later.
    #[serde(default)]
    #[garde(dive)]
    pub image_delay: Option<RawImageDelay>,
    /// From now on commands take effect later.
    #[serde(default)]
    #[garde(dive)]
    pub command_delay: Option<RawCommandDelay>,
    /// Gel is missing under a part of the array.
    #[serde(default)]
    #[garde(dive)]
    pub gel_lost: Option<RawGelLost>,
    /// The receiver's electronic noise steps.
    #[serde(default)]
    #[garde(dive)]
    pub noise: Option<RawGain>,
    /// Something between probe and skin takes sound from a part of the array.
    #[serde(default)]
    #[garde(dive)]
    pub shadow: Option<RawShadow>,
    /// The scanner hands out the last picture again and again; the rig's measurements go on.
    #[serde(default)]
    #[garde(dive)]
    pub frozen_images: Option<RawSpan>,
    /// Pictures are lost before anybody gets them.
    #[serde(default)]
    #[garde(dive)]
    pub dropped_images: Option<RawDropped>,
    /// The arm stops and obeys nothing, then goes on.
    #[serde(default)]
    #[garde(dive)]
    pub arm_stall: Option<RawSpan>,
    /// The tracker gets images and does not answer.
    #[serde(default)]
    #[garde(dive)]
    pub tracker_hung: Option<RawSpan>,
    /// What the tracker sends is garbage, drawn from the seed.
    #[serde(default)]
    #[garde(dive)]
    pub tracker_garbage: Option<RawSpan>,
    /// The phantom moves to and fro until the end of the run.
    #[serde(default)]
    #[garde(dive)]
    pub breathing: Option<RawBreathing>,
    /// The phantom moves slowly aside.
    #[serde(default)]
    #[garde(dive)]
    pub phantom_drift: Option<RawDrift>,
    /// The phantom moves aside, once.
    #[serde(default)]
    #[garde(dive)]
    pub phantom_step: Option<RawStep>,
}

impl RawDisturbance {
    /// The keys beside `at_s`, each of which is one kind.
    pub(crate) const KINDS: &str = "probe_knock, lift_off, gain_change, needle_brightness, tracker_killed, \
         image_delay, command_delay, gel_lost, noise, shadow, frozen_images, dropped_images, arm_stall, \
         tracker_hung, tracker_garbage, breathing, phantom_drift, phantom_step";
}

/// A breath: half of 1 − cos, along a direction of the world.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawBreathing {
    /// From one end of a breath to the other, along x.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub x_mm: f64,
    /// The same along y.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub y_mm: f64,
    /// The same along z, up.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub z_mm: f64,
    /// One breath.
    #[garde(range(min = 0.5, max = 60.0))]
    pub period_s: f64,
    /// Where in a breath it begins: 0 and 180 are its ends.
    #[serde(default)]
    #[garde(range(min = -360.0, max = 360.0))]
    pub phase_deg: f64,
}

/// A slow motion of the phantom, world frame.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawDrift {
    /// Along x.
    #[serde(default)]
    #[garde(range(min = -10.0, max = 10.0))]
    pub x_mm_s: f64,
    /// Along y.
    #[serde(default)]
    #[garde(range(min = -10.0, max = 10.0))]
    pub y_mm_s: f64,
    /// Along z, up.
    #[serde(default)]
    #[garde(range(min = -10.0, max = 10.0))]
    pub z_mm_s: f64,
    /// How long it goes on.
    #[garde(range(min = 0.001, max = 3600.0))]
    pub duration_s: f64,
}

/// A step of the phantom, world frame.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawStep {
    /// Along x.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub x_mm: f64,
    /// Along y.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub y_mm: f64,
    /// Along z, up.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub z_mm: f64,
    /// How long it takes.
    #[serde(default = "default_step_s")]
    #[garde(range(min = 0.001, max = 60.0))]
    pub duration_s: f64,
}

fn default_step_s() -> f64 {
    0.3
}

/// How the probe slips, in its own frame.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawKnock {
    /// Along elevation.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub elevation_mm: f64,
    /// Along the array.
    #[serde(default)]
    #[garde(range(min = -20.0, max = 20.0))]
    pub lateral_mm: f64,
    /// About the probe's axis.
    #[serde(default)]
    #[garde(range(min = -30.0, max = 30.0))]
    pub yaw_deg: f64,
    /// About the array.
    #[serde(default)]
    #[garde(range(min = -30.0, max = 30.0))]
    pub tilt_deg: f64,
    /// About elevation: the picture turns, and one end of the array lifts.
    #[serde(default)]
    #[garde(range(min = -30.0, max = 30.0))]
    pub roll_deg: f64,
    /// How long the slip takes.
    #[serde(default = "default_knock_s")]
    #[garde(range(min = 0.001, max = 60.0))]
    pub duration_s: f64,
}

fn default_knock_s() -> f64 {
    0.1
}

/// How far and how long the probe is off the surface.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawLiftOff {
    /// Height above the surface.
    #[garde(range(min = 0.1, max = 100.0))]
    pub height_mm: f64,
    /// How long it stays up.
    #[garde(range(min = 0.001, max = 600.0))]
    pub duration_s: f64,
}

/// A level from then on.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawGain {
    /// On top of the value in the probe's or needle's file.
    #[garde(range(min = -60.0, max = 60.0))]
    pub gain_db: f64,
}

/// How long the tracker is gone.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawTrackerKilled {
    /// From the kill to the restart.
    #[garde(range(min = 0.001, max = 600.0))]
    pub down_s: f64,
}

/// How late pictures are from then on.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawImageDelay {
    /// From taking a picture to handing it out.
    #[garde(range(min = 0, max = 2000))]
    pub image_ms: u64,
}

/// How late commands act from then on.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCommandDelay {
    /// From the answer to its effect.
    #[garde(range(min = 1, max = 2000))]
    pub command_ms: u64,
}

/// Where gel is missing, how wide the gap is, and for how long.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawGelLost {
    /// One end along the array; 0 is its middle.
    #[garde(range(min = -100.0, max = 100.0))]
    pub from_mm: f64,
    /// The other end, to the right of the first.
    #[garde(range(min = -100.0, max = 100.0))]
    pub to_mm: f64,
    /// Air between the elements and the skin.
    #[garde(range(min = 0.001, max = 20.0))]
    pub gap_mm: f64,
    /// How long until gel has filled it again.
    #[garde(range(min = 0.001, max = 600.0))]
    pub duration_s: f64,
}

/// Where something is in the sound's way, how much it takes, and for how long.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawShadow {
    /// Its middle along the array; 0 is the array's.
    #[garde(range(min = -100.0, max = 100.0))]
    pub x_mm: f64,
    /// Along the array.
    #[garde(range(min = 0.1, max = 200.0))]
    pub width_mm: f64,
    /// What it takes from sound that goes through it there and back.
    #[garde(range(min = 0.1, max = 100.0))]
    pub loss_db: f64,
    /// How long it is there.
    #[garde(range(min = 0.001, max = 600.0))]
    pub duration_s: f64,
}

/// For how long.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawSpan {
    /// How long it lasts.
    #[garde(range(min = 0.001, max = 600.0))]
    pub duration_s: f64,
}

/// How many pictures are lost, and for how long.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawDropped {
    /// Share of the pictures; which ones, each seed draws.
    #[garde(range(min = 0.001, max = 1.0))]
    pub share: f64,
    /// How long it lasts.
    #[garde(range(min = 0.001, max = 600.0))]
    pub duration_s: f64,
}

/// A value that each seed draws: `key` and exactly one of the other keys.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRandomize {
    /// Dotted key of this file; lists by index, as in `disturbances.0.at_s`.
    #[garde(length(min = 1, max = 200))]
    pub key: String,
    /// Evenly between two bounds.
    #[serde(default)]
    #[garde(skip)]
    pub uniform: Option<[f64; 2]>,
    /// One of a list, each as likely.
    #[serde(default)]
    #[garde(length(min = 1, max = 1000))]
    pub choice: Option<Vec<RawScalar>>,
    /// Normally distributed, cut off at 2.5 standard deviations.
    #[serde(default)]
    #[garde(dive)]
    pub normal: Option<RawNormal>,
}

/// Parameters of a normal distribution.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawNormal {
    /// Mean.
    #[garde(skip)]
    pub mean: f64,
    /// Standard deviation.
    #[garde(range(min = 0.0))]
    pub sigma: f64,
}

/// A number, truth value or text; which of them is told by the key it is for.
#[derive(Debug, Clone)]
pub(crate) struct RawScalar;

impl<'de> Deserialize<'de> for RawScalar {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ScalarVisitor;
        impl Visitor<'_> for ScalarVisitor {
            type Value = RawScalar;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, true, false or a text")
            }
            fn visit_bool<E>(self, _: bool) -> Result<RawScalar, E> {
                Ok(RawScalar)
            }
            fn visit_i64<E>(self, _: i64) -> Result<RawScalar, E> {
                Ok(RawScalar)
            }
            fn visit_u64<E>(self, _: u64) -> Result<RawScalar, E> {
                Ok(RawScalar)
            }
            fn visit_f64<E>(self, _: f64) -> Result<RawScalar, E> {
                Ok(RawScalar)
            }
            fn visit_str<E>(self, _: &str) -> Result<RawScalar, E> {
                Ok(RawScalar)
            }
        }
        deserializer.deserialize_any(ScalarVisitor)
    }
}

impl JsonSchema for RawScalar {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Scalar".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({ "type": ["number", "boolean", "string"] })
    }
}

/// What a metric must keep: a truth value, or `{min, max}` with at least one of them.
#[derive(Debug, Clone, Copy, JsonSchema)]
#[schemars(untagged)]
pub(crate) enum RawBound {
    Is(bool),
    Range(RawRange),
}

/// Either end may be left open.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRange {
    /// Least value.
    #[serde(default)]
    pub min: Option<f64>,
    /// Largest value.
    #[serde(default)]
    pub max: Option<f64>,
}

impl<'de> Deserialize<'de> for RawBound {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct BoundVisitor;
        impl<'de> Visitor<'de> for BoundVisitor {
            type Value = RawBound;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true, false or {min: …, max: …}")
            }
            fn visit_bool<E>(self, value: bool) -> Result<RawBound, E> {
                Ok(RawBound::Is(value))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RawBound, A::Error> {
                RawRange::deserialize(de::value::MapAccessDeserializer::new(map)).map(RawBound::Range)
            }
        }
        deserializer.deserialize_any(BoundVisitor)
    }
}
