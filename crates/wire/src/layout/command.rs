use iceoryx2::prelude::ZeroCopySend;
use sonoloop_types::{Command, Estimate};

use super::{
    Defect, LAYOUT_VERSION, check_run, check_version, codes, decode_bool, decode_pose, encode_optional,
    encode_pose, finite, optional,
};

/// The answer to one image; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("sonoloop::Command")]
#[repr(C)]
pub struct CommandMessage {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// What the tracker believes.
    pub state: u8,
    /// Why.
    pub reason: u8,
    /// 1 when `target_base_from_probe` holds a target, 0 to keep the last one.
    pub has_target: u8,
    /// Zero.
    pub reserved: u8,
    /// The run.
    pub run_id: u64,
    /// Sequence number of the image answered.
    pub answers: u64,
    /// Iterations of the optimiser.
    pub iterations: u32,
    /// Time the tracker needed by its own clock, microseconds; reporting only.
    pub compute_us: f32,
    /// Tip (u, v) in pixels; both NaN before the first fix.
    pub tip_px: [f64; 2],
    /// NCC with the previous template, or NaN.
    pub ncc_previous: f64,
    /// NCC with the first template, or NaN.
    pub ncc_anchor: f64,
    /// Brightness ratio, or NaN.
    pub brightness_ratio: f64,
    /// Grey level of the brightest spot at the tip, or NaN.
    pub tip_level: f64,
    /// Conditioning of the normal equations, or NaN.
    pub conditioning: f64,
    /// Where the probe should go, if `has_target`.
    pub target_base_from_probe: [f64; 7],
    /// Speed at which the needle is to be fed.
    pub feed_m_s: f64,
}

impl CommandMessage {
    /// The message that carries `command`.
    pub fn encode(run_id: u64, command: &Command) -> Self {
        let estimate = &command.estimate;
        Self {
            version: LAYOUT_VERSION,
            state: codes::encode(estimate.state),
            reason: codes::encode(estimate.reason),
            has_target: command.target_base_from_probe.is_some().into(),
            reserved: 0,
            run_id,
            answers: command.answers,
            iterations: estimate.iterations,
            compute_us: command.compute_us,
            tip_px: estimate.tip_px.unwrap_or([f64::NAN; 2]),
            ncc_previous: encode_optional(estimate.ncc_previous),
            ncc_anchor: encode_optional(estimate.ncc_anchor),
            brightness_ratio: encode_optional(estimate.brightness_ratio),
            tip_level: encode_optional(estimate.tip_level),
            conditioning: encode_optional(estimate.conditioning),
            target_base_from_probe: command.target_base_from_probe.as_ref().map_or([0.0; 7], encode_pose),
            feed_m_s: command.feed_m_s,
        }
    }

    /// Checks version and run, after which `answers` can be believed.
    ///
    /// # Errors
    /// [`Defect::Version`] or [`Defect::OtherRun`].
    pub fn check_origin(&self, run_id: u64) -> Result<(), Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)
    }

    /// Checks everything. Limits of feed and target are the simulator's to judge.
    ///
    /// # Errors
    /// The first defect found.
    pub fn decode(&self, run_id: u64) -> Result<Command, Defect> {
        self.check_origin(run_id)?;
        let tip_px = match self.tip_px {
            [u, v] if u.is_nan() && v.is_nan() => None,
            [u, v] => Some([finite(u, "tip_px")?, finite(v, "tip_px")?]),
        };
        let target_base_from_probe = decode_bool(self.has_target, "has_target")?
            .then(|| decode_pose(&self.target_base_from_probe, "target_base_from_probe"))
            .transpose()?;
        Ok(Command {
            answers: self.answers,
            estimate: Estimate {
                state: codes::decode(self.state, "state")?,
                reason: codes::decode(self.reason, "reason")?,
                tip_px,
                ncc_previous: optional(self.ncc_previous, "ncc_previous")?,
                ncc_anchor: optional(self.ncc_anchor, "ncc_anchor")?,
                brightness_ratio: optional(self.brightness_ratio, "brightness_ratio")?,
                tip_level: optional(self.tip_level, "tip_level")?,
                iterations: self.iterations,
                conditioning: optional(self.conditioning, "conditioning")?,
            },
            target_base_from_probe,
            feed_m_s: finite(self.feed_m_s, "feed_m_s")?,
            // Reporting only: nonsense becomes zero instead of a refusal.
            compute_us: if self.compute_us.is_finite() { self.compute_us.max(0.0) } else { 0.0 },
        })
    }
}
