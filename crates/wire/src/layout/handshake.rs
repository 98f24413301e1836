use iceoryx2::prelude::ZeroCopySend;
use sonoloop_types::EndReason;

use super::{Defect, LAYOUT_VERSION, check_run, check_version, codes, decode_text, encode_text};

/// What travels in front of the bytes of `setup`, `checkpoint`, `restore` and `control`; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("sonoloop::BlobHeader")]
#[repr(C)]
pub struct BlobHeader {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// Zero.
    pub reserved: u32,
    /// The run.
    pub run_id: u64,
}

impl BlobHeader {
    /// The header of run `run_id`.
    pub fn encode(run_id: u64) -> Self {
        Self { version: LAYOUT_VERSION, reserved: 0, run_id }
    }

    /// Run of a message whose run is not known yet (the set-up).
    ///
    /// # Errors
    /// [`Defect::Version`].
    pub fn run(&self) -> Result<u64, Defect> {
        check_version(self.version)?;
        Ok(self.run_id)
    }

    /// Checks version and run.
    ///
    /// # Errors
    /// [`Defect::Version`] or [`Defect::OtherRun`].
    pub fn check(&self, run_id: u64) -> Result<(), Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)
    }
}

/// A tracker's word that it is ready; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("sonoloop::Ready")]
#[repr(C)]
pub struct ReadyMessage {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// Zero.
    pub reserved: u32,
    /// The run.
    pub run_id: u64,
    /// Name of the tracker, UTF-8, filled up with zeros.
    pub name: [u8; 64],
    /// Version of the tracker, UTF-8, filled up with zeros.
    pub tracker_version: [u8; 32],
}

impl ReadyMessage {
    /// The message of a tracker; longer texts are cut.
    pub fn encode(run_id: u64, name: &str, version: &str) -> Self {
        Self {
            version: LAYOUT_VERSION,
            reserved: 0,
            run_id,
            name: encode_text(name),
            tracker_version: encode_text(version),
        }
    }

    /// Name and version of the tracker.
    ///
    /// # Errors
    /// The first defect found.
    pub fn decode(&self, run_id: u64) -> Result<(String, String), Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)?;
        Ok((decode_text(&self.name, "name")?, decode_text(&self.tracker_version, "tracker_version")?))
    }
}

/// The simulator's word that the run is over; see `docs/wire.md`.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("sonoloop::End")]
#[repr(C)]
pub struct EndMessage {
    /// [`LAYOUT_VERSION`].
    pub version: u32,
    /// Why.
    pub reason: u8,
    /// Zero.
    pub reserved: [u8; 3],
    /// The run.
    pub run_id: u64,
}

impl EndMessage {
    /// The message of a run that ends.
    pub fn encode(run_id: u64, reason: EndReason) -> Self {
        Self { version: LAYOUT_VERSION, reason: codes::encode(reason), reserved: [0; 3], run_id }
    }

    /// Why the run ended.
    ///
    /// # Errors
    /// The first defect found.
    pub fn decode(&self, run_id: u64) -> Result<EndReason, Defect> {
        check_version(self.version)?;
        check_run(self.run_id, run_id)?;
        codes::decode(self.reason, "reason")
    }
}
