use serde::{Deserialize, Serialize};

/// A named set of tracker settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// What the paper says, for comparison.
    Paper,
    /// Narrow weights, brightness test, strict recovery; the default.
    Robust,
}

/// What the optimiser minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Similarity {
    /// Sum of squared differences, paper (2).
    Ssd,
    /// Sum of conditional variances, paper (11).
    Scv,
}

/// Which Jacobian the optimiser uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Optimisation {
    /// Gauss–Newton on the image's gradient, paper (6).
    FirstOrder,
    /// Mean of image and template gradient, paper (8).
    SecondOrder,
}

/// How a template may move, paper (3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Warp {
    /// Two degrees of freedom.
    Translation,
    /// Three: it turns too.
    Rigid,
    /// Six.
    Affine,
}

/// How the template follows the target's appearance, paper section III.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UpdateStrategy {
    /// Strategy 1: the first template for ever.
    None,
    /// Strategy 2: the last image's patch.
    Naive,
    /// Strategy 3 with the acceptance test of Matthews, Ishikawa and Baker (2004).
    DriftCorrected,
}

/// Where the optimiser starts in the next image. It moves that start alone, never what is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Guess {
    /// Where the tip was.
    None,
    /// On by its smoothed velocity, v ← m·v + (1 − m)·d after a motion d, with m = `velocity_memory`.
    ConstantVelocity,
    /// Where a constant-velocity Kalman filter of the tracked tips predicts it.
    Kalman,
    /// On by the motion that the needle robot and the arm have measured; by the smoothed velocity where there is none.
    Insertion,
}

/// How the needle's tip is found from image to image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Templates: the paper's method and what was made of it.
    Template,
    /// The authors' earlier method: the needle is localised in every image, its tip smoothed. It has no first tip, no
    /// templates and no use for most of the settings.
    Baseline,
}

/// Where the first tip of the template method comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Init {
    /// The operator's click in the first image.
    Click,
    /// The end of a needle that is found in the picture; until there is one, the search goes on.
    Localize,
}

/// Every setting of the tracker.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackerSettings {
    /// The profile the other values came from.
    pub profile: Profile,
    /// Which kind of tracker there is to be.
    pub method: Method,
    /// Where its first tip comes from.
    pub init: Init,
    /// What is minimised.
    pub similarity: Similarity,
    /// Which Jacobian.
    pub optimisation: Optimisation,
    /// How the template moves. With `refine` a turn is measured only where the surroundings move along. On a tip over speckle six degrees of freedom drift by tens of pixels where two hold it.
    pub warp: Warp,
    /// Template update.
    pub update: UpdateStrategy,
    /// Side S of the square template, 8–128 px.
    pub template_px: u32,
    /// Grey-level bins of the SCV (16 for 20×20, 32 for 61×61).
    pub scv_bins: u32,
    /// Gaussian blur of image and template before anything else, σ; 0 = none.
    pub blur_sigma_px: f64,
    /// Gaussian weight about the tip in sums and NCCs, σ; 0 = uniform.
    pub weight_sigma_px: f64,
    /// Register once more, unblurred and unweighted, where the surroundings move with the tip; not under naive updates.
    pub refine: bool,
    /// Where the optimiser starts.
    pub guess: Guess,
    /// m, the share of the last velocity that a smoothed velocity keeps.
    pub velocity_memory: f64,
    /// Resolutions at which the motion is registered, 1–3: 1 is the full one alone, 2 begins at half of it, 3 at a quarter.
    pub pyramid_levels: u32,
    /// Largest corner distance between the two registrations that accepts the update, ε_d.
    pub drift_tolerance_px: f64,
    /// Most iterations per registration.
    pub max_iterations: u32,
    /// The iteration ends when the largest corner motion falls below this.
    pub epsilon_px: f64,
    /// LOST when NCC with T_n falls below.
    pub loss_ncc_previous: f64,
    /// LOST when NCC with T_1 falls below.
    pub loss_ncc_anchor: f64,
    /// LOST when less than nine tenths of the first template's contrast is left and the brightness ratio rises above this, or when
    /// less than half is left; `None` = neither test.
    pub loss_brightness_ratio: Option<f64>,
    /// A recovery candidate needs this NCC with T_1.
    pub recovery_ncc: f64,
    /// Images in a row that confirm a candidate.
    pub confirmation_images: u32,
    /// Images lost after which the whole picture is searched, as far as the tip may be there.
    pub whole_image_after: u32,
}

impl TrackerSettings {
    /// The settings of a profile for templates of side `template_px`.
    pub fn profile(profile: Profile, template_px: u32) -> Self {
        let robust = Self {
            profile,
            method: Method::Template,
            init: Init::Click,
            similarity: Similarity::Scv,
            optimisation: Optimisation::SecondOrder,
            warp: Warp::Translation,
            update: UpdateStrategy::DriftCorrected,
            template_px,
            scv_bins: if template_px < 40 { 16 } else { 32 },
            blur_sigma_px: 1.5,
            weight_sigma_px: 3.0,
            refine: true,
            guess: Guess::Insertion,
            velocity_memory: 0.7,
            pyramid_levels: 1,
            drift_tolerance_px: 3.0,
            max_iterations: 50,
            epsilon_px: 0.01,
            loss_ncc_previous: 0.80,
            loss_ncc_anchor: 0.70,
            loss_brightness_ratio: Some(0.80),
            recovery_ncc: 0.85,
            confirmation_images: 3,
            whole_image_after: 10,
        };
        match profile {
            Profile::Robust => robust,
            Profile::Paper => Self {
                blur_sigma_px: 0.0,
                weight_sigma_px: 0.0,
                refine: false,
                guess: Guess::None,
                loss_ncc_anchor: -1.0,
                loss_brightness_ratio: None,
                recovery_ncc: 0.75,
                confirmation_images: 1,
                whole_image_after: 0,
                ..robust
            },
        }
    }
}

/// How a search moves the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchPattern {
    /// To and fro in elevation, wider each time.
    Elevation,
    /// To and fro in yaw about the last tip, wider each time.
    Yaw,
    /// In elevation, then in yaw.
    ElevationThenYaw,
    /// Round and round in the plane of elevation and yaw, wider each time.
    Spiral,
}

/// Every setting of the servo.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ServoSettings {
    /// Feed while the tip is tracked.
    pub feed_m_s: f64,
    /// Distance before the target over which the feed is slowed down.
    pub approach_m: f64,
    /// The target counts as reached this close before it.
    pub arrived_m: f64,
    /// The needle is never fed farther than this beyond the nominal depth of the target.
    pub depth_margin_m: f64,
    /// Lateral: the tip may wander this far from the picture's middle before the probe slides.
    pub lateral_deadband_m: f64,
    /// Gain from the excess over that band to the speed of the slide.
    pub slide_gain_per_s: f64,
    /// Fastest slide of the probe while following.
    pub slide_speed_m_s: f64,
    /// Lateral: gain of the elevational hold (share of the estimated offset corrected per second); 0 = off.
    pub elevation_gain_per_s: f64,
    /// Transverse: gain of the correction along the needle (share of the estimated distance per second); 0 = off.
    pub along_gain_per_s: f64,
    /// Transverse: how far the tip is thought to stray from the measured depth in one image, standard deviation.
    pub along_walk_m: f64,
    /// Transverse: size of the tip's echo along the needle, standard deviation; it widens the beam's profile.
    pub tip_size_m: f64,
    /// Transverse: scatter of the tip's grey level from image to image, standard deviation.
    pub level_noise: f64,
    /// Transverse: by how much the plane leads the tip, in time, before the arm's lag has been measured.
    pub lead_s: f64,
    /// Amplitude of the elevational dither while tracking; 0 = off.
    pub dither_m: f64,
    /// Period of that dither.
    pub dither_period_s: f64,
    /// How a search moves the plane.
    pub search: SearchPattern,
    /// Time that the plane stands still after a loss before it is moved.
    pub look_s: f64,
    /// Longest wait for the confirmation of a candidate.
    pub confirm_s: f64,
    /// A candidate has passed its brightest when it fell by this many grey levels.
    pub crest_levels: f64,
    /// In the picture a lost tip is sought no farther than this from its last place, carried along by the measured motion. In a
    /// hand, whose way is not measured, from all that lies up to 10 mm, and what it was asked for since, ahead of its last place
    /// (lateral views).
    pub candidate_reach_m: f64,
    /// Lateral: the needle is fed no more after that much of it in one search, to see which candidates go with it (what is on its way
    /// when a picture is delayed comes on top); 0: they are believed without. A hand is asked for no more, at 1 mm/s.
    pub max_jog_m: f64,
    /// Speed of the elevational sweep after a loss.
    pub sweep_speed_m_s: f64,
    /// Farthest the sweep goes to either side; it widens in thirds.
    pub sweep_reach_m: f64,
    /// Yaw about the last tip that is searched, to either side.
    pub yaw_reach_rad: f64,
    /// Speed of that yaw.
    pub yaw_speed_rad_s: f64,
    /// Most distance the probe travels in one search.
    pub max_search_travel_m: f64,
    /// Most time one search takes.
    pub max_search_s: f64,
    /// The plane is not moved in a search while the contact force is above this.
    pub max_search_force_n: f64,
}

/// What a scenario has that says nothing.
impl Default for ServoSettings {
    fn default() -> Self {
        Self {
            feed_m_s: 10e-3,
            approach_m: 1.5e-3,
            arrived_m: 0.15e-3,
            depth_margin_m: 8e-3,
            lateral_deadband_m: 10e-3,
            slide_gain_per_s: 5.0,
            slide_speed_m_s: 12e-3,
            elevation_gain_per_s: 2.0,
            along_gain_per_s: 4.0,
            along_walk_m: 0.03 / 1000.0,
            tip_size_m: 0.35e-3,
            level_noise: 4.0,
            lead_s: 0.06,
            dither_m: 0.15e-3,
            dither_period_s: 0.4,
            search: SearchPattern::ElevationThenYaw,
            look_s: 0.2,
            confirm_s: 0.8,
            crest_levels: 18.0,
            candidate_reach_m: 6e-3,
            max_jog_m: 4e-3,
            sweep_speed_m_s: 5e-3,
            sweep_reach_m: 7e-3,
            yaw_reach_rad: 8.0_f64.to_radians(),
            yaw_speed_rad_s: 10.0_f64.to_radians(),
            max_search_travel_m: 60e-3,
            max_search_s: 15.0,
            max_search_force_n: 6.0,
        }
    }
}
