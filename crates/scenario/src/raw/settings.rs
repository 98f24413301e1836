use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};

/// A named set of tracker settings.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawProfile {
    Paper,
    #[default]
    Robust,
}

/// What the optimiser minimises.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawSimilarity {
    Ssd,
    Scv,
}

/// How the template may move.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawWarp {
    Translation,
    Rigid,
    Affine,
}

/// How the template follows the target's appearance.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawUpdate {
    None,
    Naive,
    DriftCorrected,
}

/// How the tip is found from image to image.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawMethod {
    /// Templates.
    #[default]
    Template,
    /// The authors' earlier method: the needle is localised in every image. It has no use for `init` and the other settings.
    Baseline,
}

/// Where the first tip comes from.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawInit {
    /// The operator clicks on it in the first image.
    #[default]
    Click,
    /// The tracker looks for a needle until there is one; lateral view only.
    Localize,
}

/// Where the optimiser starts in the next image.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawGuess {
    /// Where the tip was.
    None,
    /// On by its smoothed velocity.
    ConstantVelocity,
    /// Where a Kalman filter predicts it.
    Kalman,
    /// On by the measured motion of needle and arm; by the smoothed velocity where there is none.
    Insertion,
}

/// The tracker: a profile, and any value of it that is to differ.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub(crate) struct RawTracker {
    /// The profile that all other values come from.
    pub profile: RawProfile,
    /// How the tip is found from image to image.
    pub method: RawMethod,
    /// Where the first tip comes from.
    pub init: RawInit,
    /// Side of the square template.
    #[garde(range(min = 8, max = 128))]
    pub template_px: u32,
    /// What is minimised.
    pub similarity: Option<RawSimilarity>,
    /// Order of the optimisation, 1 or 2.
    #[garde(range(min = 1, max = 2))]
    pub order: Option<u8>,
    /// How the template moves: two, three or six degrees of freedom. With `refine` a turn is measured only where the surroundings
    /// move along.
    pub warp: Option<RawWarp>,
    /// Template update.
    pub update: Option<RawUpdate>,
    /// Grey-level bins of the sum of conditional variances.
    #[garde(range(min = 2, max = 256))]
    pub scv_bins: Option<u32>,
    /// Gaussian blur before anything else, σ; 0 is none.
    #[garde(range(min = 0.0, max = 8.0))]
    pub blur_sigma_px: Option<f64>,
    /// Gaussian weight about the tip, σ; 0 is uniform, else at least 1.
    #[garde(range(min = 0.0, max = 64.0))]
    pub weight_sigma_px: Option<f64>,
    /// A second, unblurred and unweighted registration where the surroundings move with the tip.
    pub refine: Option<bool>,
    /// Where the optimiser starts in the next image.
    pub guess: Option<RawGuess>,
    /// Share of the last velocity that the smoothed velocity of the guess keeps.
    #[garde(range(min = 0.0, max = 1.0))]
    pub velocity_memory: Option<f64>,
    /// Resolutions at which a motion is registered: 1 is the full one, 2 begins at a half, 3 at a quarter.
    #[garde(range(min = 1, max = 3))]
    pub pyramid_levels: Option<u32>,
    /// Largest corner distance of the two registrations that accepts an update.
    #[garde(range(min = 0.0, max = 50.0))]
    pub drift_tolerance_px: Option<f64>,
    /// Most iterations per registration.
    #[garde(range(min = 1, max = 500))]
    pub max_iterations: Option<u32>,
    /// The iteration ends when the largest corner motion falls below this.
    #[garde(range(min = 0.000001, max = 1.0))]
    pub epsilon_px: Option<f64>,
    /// Lost below this NCC with the last template.
    #[garde(range(min = -1.0, max = 1.0))]
    pub loss_ncc_previous: Option<f64>,
    /// Lost below this NCC with the first template.
    #[garde(range(min = -1.0, max = 1.0))]
    pub loss_ncc_anchor: Option<f64>,
    /// Lost above this brightness ratio when less than nine tenths of the first template's contrast is left, and when less than
    /// half is; null turns both tests off.
    #[serde(deserialize_with = "nullable")]
    #[schemars(with = "Option<f64>", range(min = 0.01, max = 10.0))]
    #[garde(inner(range(min = 0.01, max = 10.0)))]
    pub loss_brightness_ratio: Option<Option<f64>>,
    /// NCC with the first template that a recovery needs.
    #[garde(range(min = -1.0, max = 1.0))]
    pub recovery_ncc: Option<f64>,
    /// Images in a row that confirm a recovery.
    #[garde(range(min = 1, max = 100))]
    pub confirmation_images: Option<u32>,
    /// Images lost after which the whole picture is searched, as far as `servo.candidate_reach_mm` goes.
    #[garde(range(min = 0, max = 10000))]
    pub whole_image_after: Option<u32>,
}

/// Tells a key that is null from one that is not there.
fn nullable<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<f64>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

impl Default for RawTracker {
    fn default() -> Self {
        Self {
            profile: RawProfile::Robust,
            method: RawMethod::Template,
            init: RawInit::Click,
            template_px: 20,
            similarity: None,
            order: None,
            warp: None,
            update: None,
            scv_bins: None,
            blur_sigma_px: None,
            weight_sigma_px: None,
            refine: None,
            guess: None,
            velocity_memory: None,
            pyramid_levels: None,
            drift_tolerance_px: None,
            max_iterations: None,
            epsilon_px: None,
            loss_ncc_previous: None,
            loss_ncc_anchor: None,
            loss_brightness_ratio: None,
            recovery_ncc: None,
            confirmation_images: None,
            whole_image_after: None,
        }
    }
}

/// How a search moves the plane.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawSearchPattern {
    /// To and fro in elevation, wider each time.
    Elevation,
    /// To and fro in yaw about the last tip, wider each time.
    Yaw,
    /// In elevation, then in yaw.
    ElevationThenYaw,
    /// Round and round in the plane of elevation and yaw, wider each time.
    Spiral,
}

/// How the arm and the needle are steered.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub(crate) struct RawServo {
    /// Feed while the tip is tracked.
    #[garde(range(min = 0.1, max = 200.0))]
    pub feed_mm_s: f64,
    /// Distance before the target over which the feed slows down.
    #[garde(range(min = 0.0, max = 50.0))]
    pub approach_mm: f64,
    /// The target counts as reached this close before it.
    #[garde(range(min = 0.0, max = 5.0))]
    pub arrived_mm: f64,
    /// The needle is never fed farther than this beyond the nominal depth of the target.
    #[garde(range(min = 0.0, max = 50.0))]
    pub depth_margin_mm: f64,
    /// Lateral: how far the tip may wander from the picture's middle before the probe slides.
    #[garde(range(min = 0.0, max = 32.0))]
    pub lateral_deadband_mm: f64,
    /// Lateral: speed of the slide per distance beyond that band, per second.
    #[garde(range(min = 0.0, max = 50.0))]
    pub slide_gain: f64,
    /// Fastest slide while following.
    #[garde(range(min = 0.0, max = 200.0))]
    pub slide_speed_mm_s: f64,
    /// Lateral: gain of the elevational hold, share of the estimated offset corrected per second; 0 is off.
    #[garde(range(min = 0.0, max = 50.0))]
    pub elevation_gain: f64,
    /// Transverse: gain of the correction along the needle, share of the estimated distance corrected per second; 0 is off.
    #[garde(range(min = 0.0, max = 50.0))]
    pub along_gain: f64,
    /// Transverse: how far the tip is thought to stray from the measured depth in one image, standard deviation.
    #[garde(range(min = 0.0, max = 2.0))]
    pub along_walk_mm: f64,
    /// Transverse: size of the tip's echo along the needle, standard deviation; it widens the beam's profile.
    #[garde(range(min = 0.0, max = 10.0))]
    pub tip_size_mm: f64,
    /// Transverse: scatter of the tip's grey level from image to image, standard deviation of the 0 to 255.
    #[garde(range(min = 0.5, max = 100.0))]
    pub level_noise: f64,
    /// Transverse: by how much the plane leads the tip, in time, before the arm's lag has been measured.
    #[garde(range(min = 0.0, max = 1000.0))]
    pub lead_ms: f64,
    /// Amplitude of the elevational dither; 0 is off.
    #[garde(range(min = 0.0, max = 5.0))]
    pub dither_mm: f64,
    /// Period of the dither.
    #[garde(range(min = 0.08, max = 60.0))]
    pub dither_period_s: f64,
    /// How a search after a loss moves the plane. In a transverse view elevation leads along the needle.
    pub search: RawSearchPattern,
    /// Time that the plane stands still after a loss before it is moved.
    #[garde(range(min = 0.0, max = 60.0))]
    pub look_s: f64,
    /// Longest wait for the confirmation of a candidate.
    #[garde(range(min = 0.04, max = 60.0))]
    pub confirm_s: f64,
    /// A candidate has passed its brightest when it fell by this many grey levels.
    #[garde(range(min = 1.0, max = 200.0))]
    pub crest_levels: f64,
    /// In the picture a lost tip is sought no farther than this from its last place, carried along by the measured motion. In a
    /// hand, whose way is not measured, from all that lies up to 10 mm, and what it was asked for since, ahead of its last place
    /// (lateral views).
    #[garde(range(min = 0.0, max = 100.0))]
    pub candidate_reach_mm: f64,
    /// Lateral: the needle is fed no more after that much of it in one search, to see which candidates go with it (what is on its way
    /// when a picture is delayed comes on top); 0: they are believed without. A hand is asked for no more, at 1 mm/s.
    #[garde(range(min = 0.0, max = 50.0))]
    pub max_jog_mm: f64,
    /// Speed of the elevational sweep after a loss.
    #[garde(range(min = 0.1, max = 200.0))]
    pub sweep_speed_mm_s: f64,
    /// Farthest the sweep goes to either side.
    #[garde(range(min = 0.0, max = 50.0))]
    pub sweep_reach_mm: f64,
    /// Yaw about the last tip that is searched, to either side.
    #[garde(range(min = 0.0, max = 60.0))]
    pub yaw_reach_deg: f64,
    /// Speed of that yaw.
    #[garde(range(min = 0.1, max = 180.0))]
    pub yaw_speed_deg_s: f64,
    /// Most distance that the probe travels in one search.
    #[garde(range(min = 0.0, max = 1000.0))]
    pub max_search_travel_mm: f64,
    /// Most time that one search takes.
    #[garde(range(min = 0.1, max = 600.0))]
    pub max_search_s: f64,
    /// The plane is not moved in a search while the contact force is above this; when left out, three quarters of
    /// `limits.max_contact_force_n`.
    #[garde(range(min = 0.1, max = 50.0))]
    pub max_search_force_n: Option<f64>,
}

impl Default for RawServo {
    fn default() -> Self {
        Self {
            feed_mm_s: 10.0,
            approach_mm: 1.5,
            arrived_mm: 0.15,
            depth_margin_mm: 8.0,
            lateral_deadband_mm: 10.0,
            slide_gain: 5.0,
            slide_speed_mm_s: 12.0,
            elevation_gain: 2.0,
            along_gain: 4.0,
            along_walk_mm: 0.03,
            tip_size_mm: 0.35,
            level_noise: 4.0,
            lead_ms: 60.0,
            dither_mm: 0.15,
            dither_period_s: 0.4,
            search: RawSearchPattern::ElevationThenYaw,
            look_s: 0.2,
            confirm_s: 0.8,
            crest_levels: 18.0,
            candidate_reach_mm: 6.0,
            max_jog_mm: 4.0,
            sweep_speed_mm_s: 5.0,
            sweep_reach_mm: 7.0,
            yaw_reach_deg: 8.0,
            yaw_speed_deg_s: 10.0,
            max_search_travel_mm: 60.0,
            max_search_s: 15.0,
            max_search_force_n: None,
        }
    }
}

/// Bounds that every command must keep.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawLimits {
    /// Fastest feed.
    #[garde(range(min = 0.1, max = 200.0))]
    pub max_feed_mm_s: f64,
    /// Fastest probe motion.
    #[garde(range(min = 0.1, max = 500.0))]
    pub max_probe_speed_mm_s: f64,
    /// Farthest from the probe's pose at the start.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub max_probe_travel_mm: f64,
    /// Largest turn from the probe's pose at the start.
    #[garde(range(min = 0.0, max = 90.0))]
    pub max_probe_turn_deg: f64,
    /// Contact force that must never be exceeded.
    #[garde(range(min = 0.1, max = 50.0))]
    pub max_contact_force_n: f64,
}

impl Default for RawLimits {
    fn default() -> Self {
        Self {
            max_feed_mm_s: 12.0,
            max_probe_speed_mm_s: 30.0,
            max_probe_travel_mm: 80.0,
            max_probe_turn_deg: 25.0,
            max_contact_force_n: 8.0,
        }
    }
}
