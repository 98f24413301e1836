use serde::{Deserialize, Serialize};

use crate::ImageGeometry;

/// Measured thickness of the slice at one depth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ElevationSample {
    /// Depth below the transducer's face.
    pub depth_m: f64,
    /// Two-way −6 dB width of the elevational beam there.
    pub width_m: f64,
}

/// How closely a picture follows the sum over its scatterers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Within 5 % RMS of the complex field; some 12 % where sound is slower or faster than assumed.
    #[default]
    Usual,
    /// Within 2 %, in about twice the time (`benches/README.md`). In pictures deeper than 70 mm the array's ends are farther off, as much
    /// as brings the whole of one of 120 mm to 2.3 %: there four columns share a beam width.
    Fine,
}

/// Which effects a picture has; all of them unless they are switched off, to see what each does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Effects {
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

impl Default for Effects {
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

/// A linear array and the settings of the scanner behind it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeSpec {
    /// Name shown in reports.
    pub name: String,
    /// Number of elements along x.
    pub elements: u32,
    /// Distance between neighbouring elements.
    pub pitch_m: f64,
    /// Transmit centre frequency.
    pub centre_frequency_hz: f64,
    /// −6 dB bandwidth over the centre frequency (two-way pulse).
    pub fractional_bandwidth: f64,
    /// Depth over active aperture; fixes the lateral beam, 0.886·λ·F#.
    pub f_number: f64,
    /// Depth at which the transmitted beam is focused; `None`: at every depth, as by several shots or synthetically.
    pub transmit_focus_m: Option<f64>,
    /// Length of the elements in elevation.
    pub element_height_m: f64,
    /// Depth of the lens's focus in elevation. Pulse and lateral beam are stated there.
    pub elevation_focus_m: f64,
    /// Slice thickness over depth, by ascending depth, at least two entries.
    pub elevation: Vec<ElevationSample>,
    /// Sound speed the scanner assumes to turn time into depth.
    pub assumed_sound_speed_m_s: f64,
    /// Attenuation that the time-gain compensation undoes.
    pub tgc_db_cm_mhz: f64,
    /// Further gain by depth, evenly spaced from the face to the bottom; none for none.
    pub tgc_sliders_db: Vec<f64>,
    /// Dynamic range of the log compression.
    pub dynamic_range_db: f64,
    /// Grey level of unit-backscatter speckle's rms amplitude, as dB below white.
    pub speckle_level_db: f64,
    /// Electronic noise before TGC, rms, in dB relative to unit-backscatter speckle at no depth.
    pub noise_level_db: f64,
    /// Picture layout.
    pub geometry: ImageGeometry,
    /// What the picture is made of.
    pub effects: Effects,
    /// How exact it is.
    pub precision: Precision,
}

impl ProbeSpec {
    /// Length of the array along x.
    pub fn aperture_m(&self) -> f64 {
        f64::from(self.elements) * self.pitch_m
    }

    /// Two-way −6 dB width of the elevational beam at a depth; linear in the table, constant beyond.
    pub fn slice_thickness_m(&self, depth_m: f64) -> f64 {
        let table = &self.elevation;
        let above = table.partition_point(|s| s.depth_m <= depth_m);
        if above == 0 {
            return table[0].width_m;
        }
        if above == table.len() {
            return table[above - 1].width_m;
        }
        let (a, b) = (table[above - 1], table[above]);
        let share = (depth_m - a.depth_m) / (b.depth_m - a.depth_m);
        a.width_m + share * (b.width_m - a.width_m)
    }

    /// Two-way −6 dB lateral width 0.886·λ·F# (uniform aperture, Rayleigh criterion), in metres.
    pub fn lateral_width_m(&self) -> f64 {
        0.886 * self.assumed_sound_speed_m_s / self.centre_frequency_hz * self.f_number
    }
}
