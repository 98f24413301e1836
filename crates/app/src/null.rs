//! Three trackers that do not look at the picture. Every scenario must fail them, or it tests nothing.

use sonoloop_types::{Acquisition, Estimate, ImageGeometry, Reason, Setup, TrackState, View};

/// Which of the three.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Null {
    /// Computes the tip from measured depth and nominal calibrations.
    DeadReckoning,
    /// Says TRACKING where the operator clicked (or in the picture's middle), for ever.
    AlwaysTracking,
    /// Says LOST, for ever.
    AlwaysLost,
}

impl Null {
    /// All three, with the names they have on the command line.
    pub const ALL: [(&'static str, Self); 3] = [
        ("dead-reckoning", Self::DeadReckoning),
        ("always-tracking", Self::AlwaysTracking),
        ("always-lost", Self::AlwaysLost),
    ];

    /// The one with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, null)| *null)
    }

    /// The name of this one.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, null)| *null == self).map_or("", |(name, _)| name)
    }

    /// What it says of any picture.
    pub fn estimate(self, setup: &Setup, acquisition: &Acquisition) -> Estimate {
        match self {
            Self::DeadReckoning => {
                let tip_px = reckoned_px(setup, acquisition);
                Estimate::bare(TrackState::Tracking, Reason::Ok, Some(tip_px))
            }
            Self::AlwaysTracking => Estimate::bare(TrackState::Tracking, Reason::Ok, Some(marked_px(setup))),
            Self::AlwaysLost => Estimate::bare(TrackState::Lost, Reason::NoCandidate, Some(marked_px(setup))),
        }
    }
}

/// Where the operator clicked, or the picture's middle where nobody did.
fn marked_px(setup: &Setup) -> [f64; 2] {
    let ImageGeometry { width_px, height_px, .. } = setup.geometry;
    setup.click_px.unwrap_or([width_px, height_px].map(|n| f64::from(n) / 2.0))
}

/// Pixel of the nominal tip (lateral) or of the nominal needle's cut with the plane (transverse).
fn reckoned_px(setup: &Setup, acquisition: &Acquisition) -> [f64; 2] {
    let depth_m = acquisition.depth_m.unwrap_or(0.0);
    let tip_in_base = setup.entry_in_base + setup.needle_axis_in_base * depth_m;
    let probe_from_base = acquisition.base_from_probe.inverse();
    let mut tip_in_probe = probe_from_base * tip_in_base;
    let axis_in_probe = probe_from_base * setup.needle_axis_in_base;
    if setup.view == View::Transverse && axis_in_probe.y.abs() > 1e-3 {
        tip_in_probe -= axis_in_probe * (tip_in_probe.y / axis_in_probe.y);
    }
    setup.geometry.px_from_probe(&tip_in_probe)
}
