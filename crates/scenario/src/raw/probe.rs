use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// A linear array and the settings of the scanner behind it. The picture is 640×480.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawProbe {
    /// Name shown in reports.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// Number of elements.
    #[garde(range(min = 16, max = 1024))]
    pub elements: u32,
    /// Distance between neighbouring elements.
    #[garde(range(min = 0.05, max = 1.0))]
    pub pitch_mm: f64,
    /// Transmit centre frequency.
    #[garde(range(min = 1.0, max = 25.0))]
    pub centre_frequency_mhz: f64,
    /// −6 dB bandwidth of the two-way pulse over the centre frequency.
    #[garde(range(min = 0.1, max = 1.5))]
    pub fractional_bandwidth: f64,
    /// Depth over active aperture.
    #[garde(range(min = 0.5, max = 8.0))]
    pub f_number: f64,
    /// Depth of the transmit focus; without it every depth is in focus, as with several shots.
    #[garde(inner(range(min = 2.0, max = 200.0)))]
    #[serde(default)]
    pub transmit_focus_mm: Option<f64>,
    /// Length of the elements in elevation.
    #[garde(range(min = 1.0, max = 30.0))]
    pub element_height_mm: f64,
    /// Depth at which the lens focuses in elevation; bandwidth and F# are those of the echo there.
    #[garde(range(min = 5.0, max = 200.0))]
    pub elevation_focus_mm: f64,
    /// Slice thickness over depth, by ascending depth.
    #[garde(length(min = 2, max = 64), dive)]
    pub elevation: Vec<RawElevation>,
    /// Sound speed that the scanner assumes.
    #[garde(range(min = 1300.0, max = 1800.0))]
    pub assumed_sound_speed_m_s: f64,
    /// Attenuation that the time-gain compensation undoes.
    #[garde(range(min = 0.0, max = 3.0))]
    pub tgc_db_cm_mhz: f64,
    /// Gain sliders, evenly spaced from the face to the bottom of the picture.
    #[garde(length(max = 16), inner(range(min = -40.0, max = 40.0)))]
    #[serde(default)]
    pub tgc_sliders_db: Vec<f64>,
    /// Dynamic range of the log compression.
    #[garde(range(min = 20.0, max = 100.0))]
    pub dynamic_range_db: f64,
    /// How far below white the speckle of unit backscatter lies.
    #[garde(range(min = 0.0, max = 100.0))]
    pub speckle_level_db: f64,
    /// Electronic noise before time-gain compensation, over unit-backscatter speckle at no depth.
    #[garde(range(min = -120.0, max = 0.0))]
    pub noise_level_db: f64,
    /// Depth of the picture's bottom; 480 square pixels make it.
    #[garde(range(min = 20.0, max = 120.0))]
    #[serde(default = "default_depth_mm")]
    pub depth_mm: f64,
    /// Effects to switch off, to see what each does.
    #[serde(default)]
    pub effects: RawEffects,
    /// How closely the picture follows the sum over its scatterers: within 5 %, or within 2 % in more time.
    #[serde(default)]
    pub precision: RawPrecision,
}

fn default_depth_mm() -> f64 {
    48.0
}

/// How exact a picture is.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawPrecision {
    /// Within 5 % RMS of the complex field; some 12 % where sound is slower or faster than assumed.
    #[default]
    Usual,
    /// Within 2 %.
    Fine,
}

/// Which effects a picture has; all of them by default.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawEffects {
    /// Loss along each line through what lies on it.
    pub attenuation: bool,
    /// The pulse's centre frequency falls with depth: it loses less, and the beam widens.
    pub downshift: bool,
    /// Echoes are drawn where their time says, by the assumed sound speed.
    pub sound_speed: bool,
    /// Surfaces between materials reflect.
    pub boundaries: bool,
    /// Echoes go to and fro inside steel and strongly reflecting layers.
    pub reverberation: bool,
    /// The needle stands in the way of the sound.
    pub needle_shadow: bool,
    /// Strong echoes of the needle are seen beside it.
    pub side_lobes: bool,
    /// Scatterers of the materials echo. Surfaces and the needle stay.
    pub speckle: bool,
    /// The needle's wall is a mirror, apart from its roughness.
    pub specular: bool,
    /// Elements without contact are blind and ring.
    pub contact: bool,
    /// Electronic noise.
    pub noise: bool,
}

impl Default for RawEffects {
    fn default() -> Self {
        Self {
            attenuation: true,
            downshift: true,
            sound_speed: true,
            boundaries: true,
            reverberation: true,
            needle_shadow: true,
            side_lobes: true,
            speckle: true,
            specular: true,
            contact: true,
            noise: true,
        }
    }
}

/// Measured thickness of the slice at one depth.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawElevation {
    /// Depth below the transducer's face.
    #[garde(range(min = 0.1, max = 200.0))]
    pub depth_mm: f64,
    /// Two-way −6 dB width of the elevational beam there.
    #[garde(range(min = 0.1, max = 20.0))]
    pub width_mm: f64,
}
