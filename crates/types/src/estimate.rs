use serde::{Deserialize, Serialize};

/// What an image that shows a good candidate for a lost tip is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Confirmation {
    /// It counts, and enough of them in a row confirm the candidate.
    #[default]
    Confirms,
    /// It counts, but the candidate is being put to another test, and stays RECOVERING.
    Counts,
    /// It does not count: the plane is still being moved, or the probe is off the surface.
    Held,
}

/// What the tracker says of its target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackState {
    /// No first fix yet.
    Searching,
    /// The tip is where the estimate says.
    Tracking,
    /// The target is gone; the insertion must stand still.
    Lost,
    /// A candidate was found and awaits confirmation.
    Recovering,
}

/// Why the state is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// All tests passed.
    Ok,
    /// NCC with the previous template fell below its threshold.
    NccPrevious,
    /// NCC with the first template fell below its threshold.
    NccAnchor,
    /// The tip is dimmer (or its surroundings brighter) than the template allows.
    Brightness,
    /// Under half of the template lies inside the picture.
    OutOfImage,
    /// The optimiser left its region of trust.
    Diverged,
    /// The normal equations have no solution (no texture).
    Singular,
    /// No place in the picture looks enough like the template.
    NoCandidate,
    /// A candidate is being confirmed.
    Candidate,
    /// The tracker was restarted from its checkpoint.
    Restarted,
    /// The picture stands still although needle or probe moved: it shows nothing of now.
    Frozen,
}

/// One image's answer, with the values behind it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// State after this image.
    pub state: TrackState,
    /// Why.
    pub reason: Reason,
    /// Tip (u, v) in pixels; while LOST the last believed one, `None` before the first fix.
    pub tip_px: Option<[f64; 2]>,
    /// NCC with the previous template T_n, −1…1; `None` when it could not be computed.
    pub ncc_previous: Option<f64>,
    /// NCC with the first template T_1, −1…1; `None` when it could not be computed.
    pub ncc_anchor: Option<f64>,
    /// rms of the difference to T_1 over the contrast of T_1 (weighted), more contrast than T_1 forgiven; 0 = same,
    /// ≥ 0.8 = gone.
    pub brightness_ratio: Option<f64>,
    /// Grey level of the brightest spot at the tip, blurred as the template is, 0…255; falls with the distance to the plane.
    pub tip_level: Option<f64>,
    /// Iterations of the optimiser, summed over its runs in this image.
    pub iterations: u32,
    /// Smaller over larger eigenvalue of the normal equations, 0…1; 0 = unconstrained.
    pub conditioning: Option<f64>,
}

impl Estimate {
    /// An estimate that says nothing but its state.
    pub fn bare(state: TrackState, reason: Reason, tip_px: Option<[f64; 2]>) -> Self {
        Self {
            state,
            reason,
            tip_px,
            ncc_previous: None,
            ncc_anchor: None,
            brightness_ratio: None,
            tip_level: None,
            iterations: 0,
            conditioning: None,
        }
    }
}
