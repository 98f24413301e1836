use iceoryx2::prelude::ZeroCopySend;
use sonoloop_types::{Acquisition, CommandReceipt, Image};

use super::{
    Defect, LAYOUT_VERSION, check_run, check_version, codes, decode_bool, decode_pose, encode_optional,
    encode_pose, finite, optional,
};
use crate::MAX_IMAGE_SIDE_PX;

/// Value of [`ImageHeader::receipt`] before the first command.
const NO_COMMAND: u8 = 0;
/// Value of [`ImageHeader::receipt`] after an accepted command.
const ACCEPTED: u8 = 1;

/// What travels in front of the pixels; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("sonoloop::ImageHeader")]
#[repr(C)]
pub struct ImageHeader {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// What the arm says of itself.
    pub arm_status: u8,
    /// 0 no command yet, 1 last command accepted, else why it was refused.
    pub receipt: u8,
    /// 1 when the simulator waits for an answer to this image; a tracker skips images with 0.
    pub answer_due: u8,
    /// Zero.
    pub reserved: u8,
    /// The run.
    pub run_id: u64,
    /// Number of the image, from 0.
    pub sequence: u64,
    /// Tick at which the picture was taken.
    pub acquisition_tick: u64,
    /// Tick at which it was handed out.
    pub publication_tick: u64,
    /// Tick of the measured pose.
    pub pose_tick: u64,
    /// The image that the last command answered.
    pub receipt_answers: u64,
    /// Side of a pixel, metres.
    pub spacing_m: f64,
    /// Measured pose of the probe.
    pub base_from_probe: [f64; 7],
    /// Measured insertion depth; NaN when a hand inserts.
    pub depth_m: f64,
    /// Measured feed; NaN when a hand inserts.
    pub feed_m_s: f64,
    /// Measured contact force.
    pub contact_force_n: f64,
}

/// A checked image header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceivedImage {
    /// What the rig measured.
    pub acquisition: Acquisition,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Side of a pixel, metres.
    pub spacing_m: f64,
    /// True when the simulator waits for an answer to this image.
    pub answer_due: bool,
}

impl ImageHeader {
    /// The header of `image`.
    pub fn encode(
        run_id: u64,
        acquisition: &Acquisition,
        image: &Image,
        spacing_m: f64,
        answer_due: bool,
    ) -> Self {
        let (receipt, receipt_answers) = match acquisition.last_command {
            None => (NO_COMMAND, 0),
            Some(CommandReceipt { answers, refused: None }) => (ACCEPTED, answers),
            Some(CommandReceipt { answers, refused: Some(refusal) }) => (codes::encode(refusal), answers),
        };
        Self {
            version: LAYOUT_VERSION,
            width_px: image.width_px,
            height_px: image.height_px,
            arm_status: codes::encode(acquisition.arm_status),
            receipt,
            answer_due: answer_due.into(),
            reserved: 0,
            run_id,
            sequence: acquisition.sequence,
            acquisition_tick: acquisition.acquisition_tick,
            publication_tick: acquisition.publication_tick,
            pose_tick: acquisition.pose_tick,
            receipt_answers,
            spacing_m,
            base_from_probe: encode_pose(&acquisition.base_from_probe),
            depth_m: encode_optional(acquisition.depth_m),
            feed_m_s: encode_optional(acquisition.feed_m_s),
            contact_force_n: acquisition.contact_force_n,
        }
    }

    /// Checks the header of a message that brought `pixels` bytes.
    ///
    /// # Errors
    /// The first defect found.
    pub fn decode(&self, run_id: u64, pixels: usize) -> Result<ReceivedImage, Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)?;
        let sides = 1..=MAX_IMAGE_SIDE_PX;
        if !sides.contains(&self.width_px) {
            return Err(Defect::Size { field: "width_px" });
        }
        if !sides.contains(&self.height_px) || self.width_px as usize * self.height_px as usize != pixels {
            return Err(Defect::Size { field: "height_px" });
        }
        if finite(self.spacing_m, "spacing_m")? <= 0.0 {
            return Err(Defect::Size { field: "spacing_m" });
        }
        let last_command = match self.receipt {
            NO_COMMAND => None,
            ACCEPTED => Some(CommandReceipt { answers: self.receipt_answers, refused: None }),
            code => Some(CommandReceipt {
                answers: self.receipt_answers,
                refused: Some(codes::decode(code, "receipt")?),
            }),
        };
        Ok(ReceivedImage {
            acquisition: Acquisition {
                sequence: self.sequence,
                acquisition_tick: self.acquisition_tick,
                publication_tick: self.publication_tick,
                pose_tick: self.pose_tick,
                base_from_probe: decode_pose(&self.base_from_probe, "base_from_probe")?,
                depth_m: optional(self.depth_m, "depth_m")?,
                feed_m_s: optional(self.feed_m_s, "feed_m_s")?,
                contact_force_n: finite(self.contact_force_n, "contact_force_n")?,
                arm_status: codes::decode(self.arm_status, "arm_status")?,
                last_command,
            },
            width_px: self.width_px,
            height_px: self.height_px,
            spacing_m: self.spacing_m,
            answer_due: decode_bool(self.answer_due, "answer_due")?,
        })
    }
}
