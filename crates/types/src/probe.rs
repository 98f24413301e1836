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
    /// Slice thickness over depth, by ascending depth, at least two entries.
    pub elevation: Vec<ElevationSample>,
    /// Sound speed the scanner assumes to turn time into depth.
    pub assumed_sound_speed_m_s: f64,
    /// Attenuation that the time-gain compensation undoes.
    pub tgc_db_cm_mhz: f64,
    /// Dynamic range of the log compression.
    pub dynamic_range_db: f64,
    /// Grey level of unit-backscatter speckle's rms amplitude, as dB below white.
    pub speckle_level_db: f64,
    /// Electronic noise before TGC, rms, in dB relative to unit-backscatter speckle at no depth.
    pub noise_level_db: f64,
    /// Picture layout.
    pub geometry: ImageGeometry,
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
