//! Widths and wavelengths of the two-way beam.

use core::f64::consts::PI;

use sonoloop_types::{Precision, ProbeSpec};

use crate::lens::Lens;

/// Full width at half maximum of a Gaussian over its σ, 2·√(2·ln 2).
const FWHM_PER_SIGMA: f64 = 2.354_820_045;
/// Step of the table of slice thickness: fine enough to take the nearest entry.
const DEPTH_STEP_M: f64 = 0.02e-3;
/// The beam is never taken wider than this many times its constant-F# width.
const MAX_WIDENING: f64 = 4.0;
/// Active aperture at no depth, in elements.
const MIN_APERTURE_ELEMENTS: f64 = 4.0;
/// [`Beam::steady_sigma_m`] grows by a factor of e over this many σ of the pulse.
const STEADY_SIGMAS: f64 = 100.0;
/// Slice thickness at which the levels of a needle are stated. [assumed] A point stands out over speckle by
/// the inverse root of the thickness; levels need one thickness to refer to.
const LEVEL_REFERENCE_THICKNESS_M: f64 = 1e-3;

/// Lines per column of the picture at most, which bounds the grid's memory: half a gigabyte for the widest array. It is met
/// where σ of the lateral beam is a tenth of a pixel, in fine pictures a fifth.
const MAX_LINES_PER_PX: usize = 16;

/// The centre frequency's fall over itself, 2b²c, beyond which [`pulse_loss_np`] is a straight line.
const MAX_SHIFT: f32 = 0.25;

/// Neper per decibel, ln 10/20.
pub const NEPER_PER_DB: f64 = core::f64::consts::LN_10 / 20.0;

/// Axial and lateral profiles are cut at this many σ for speckle: amplitude 0.1 %.
pub const PROFILE_REACH: f64 = 3.7;

/// Numbers that trade exactness for time.
#[derive(Debug, Clone, Copy)]
pub struct Grain {
    /// Elevation profiles are cut at this many σ. At 2.5 the amplitude is 4 %, and 4e-4 of the energy is beyond; at 3.3
    /// 0.4 % and 3e-6.
    pub elevation_reach: f64,
    /// Lateral filters are cut at this many σ. At 2.75 the amplitude is 2 %, at 3.25 0.5 %.
    pub lateral_reach: f64,
    /// Width of a bin of e′. A fifteenth of the thinnest σ is at most 1.4 % of the field's rms, at the focus only.
    pub elevation_bin_m: f64,
    /// Delays per row step at which the tape is kept.
    pub sub_delays: usize,
    /// Rows of the grid per scatterer of moved tissue, which goes onto rows twice: onto those that follow it, and from there
    /// onto the grid's.
    pub rows_per_scatterer: f64,
    /// Strains at which the tape of moved tissue is kept.
    pub strain_step: f64,
    /// By how many rows, over a stride of moved scatterers in the middle of the slice, the last may drift from where the tape
    /// has it; three times as many where the slice ends.
    pub drift_rows: f32,
    /// Lines of the working grid per column of the picture, for [`Self::new`]'s lines per σ of the lateral beam: two lines
    /// stand for what lies between them, and by how much they miss it is a matter of their distance over σ.
    pub lines_per_px: usize,
    /// Columns that share one beam width: few, as it changes quickly at the array's ends. Four instead of eight give 0.2 %
    /// less error, and rows take a fifth more time.
    pub columns_per_width: usize,
}

impl Grain {
    /// `px_per_sigma` is the distance of the picture's columns over σ of the lateral beam.
    fn new(precision: Precision, px_per_sigma: f64) -> Self {
        let lines_per_sigma = match precision {
            Precision::Usual => 1.5,
            Precision::Fine => 3.0,
        };
        let lines_per_px = ((lines_per_sigma * px_per_sigma).ceil() as usize).clamp(1, MAX_LINES_PER_PX);
        match precision {
            Precision::Usual => Self {
                elevation_reach: 2.5,
                lateral_reach: 2.75,
                elevation_bin_m: 0.02e-3,
                sub_delays: 24,
                rows_per_scatterer: 1.0,
                strain_step: 0.03,
                drift_rows: 0.17,
                lines_per_px,
                columns_per_width: 8,
            },
            Precision::Fine => Self {
                elevation_reach: 3.3,
                lateral_reach: 3.25,
                elevation_bin_m: 0.01e-3,
                sub_delays: 64,
                rows_per_scatterer: 1.25,
                strain_step: 0.005,
                drift_rows: 0.03,
                lines_per_px,
                columns_per_width: 4,
            },
        }
    }
}

/// The two-way beam of one probe: Gaussian amplitude profiles in elevation, laterally and axially.
#[derive(Debug, Clone)]
pub struct Beam {
    probe: ProbeSpec,
    pub grain: Grain,
    /// 2k = 4π/λ: phase per metre of depth.
    pub two_k_rad_m: f64,
    /// σ of the pulse's amplitude along depth, at the lens's focus.
    pub sigma_axial_m: f64,
    /// σ of the lateral amplitude profile with a full aperture, at the lens's focus.
    pub sigma_lateral_m: f64,
    /// Half the array's length.
    pub half_aperture_m: f64,
    /// σ of the elevational profile every [`DEPTH_STEP_M`].
    elevation_sigma_m: Vec<f64>,
    /// The same where it changes slowly, and less where it changes quickly, see [`Self::steady_sigma_m`].
    steady_sigma_m: Vec<f64>,
    /// What the lens does away from its focus.
    lens: Lens,
}

impl Beam {
    pub fn new(probe: &ProbeSpec) -> Self {
        let (c, f) = (probe.assumed_sound_speed_m_s, probe.centre_frequency_hz);
        // σ_f = B·f/2.355, σ_t = 1/(2π·σ_f), σ_z = c·σ_t/2: Gaussian pulse with −6 dB bandwidth B.
        let sigma_frequency_hz = probe.fractional_bandwidth * f / FWHM_PER_SIGMA;
        let deepest_m = probe.elevation.last().map_or(0.0, |s| s.depth_m);
        let depths = (0..=(deepest_m / DEPTH_STEP_M) as usize + 1).map(|i| i as f64 * DEPTH_STEP_M);
        let sigma_lateral_m = probe.lateral_width_m() / FWHM_PER_SIGMA;
        let sigma_axial_m = c / (4.0 * PI * sigma_frequency_hz);
        let elevation_sigma_m: Vec<f64> =
            depths.map(|z_m| probe.slice_thickness_m(z_m) / FWHM_PER_SIGMA).collect();
        Self {
            probe: probe.clone(),
            grain: Grain::new(probe.precision, probe.geometry.spacing_m / sigma_lateral_m),
            two_k_rad_m: 4.0 * PI * f / c,
            sigma_axial_m,
            sigma_lateral_m,
            half_aperture_m: probe.aperture_m() / 2.0,
            lens: Lens::new(
                probe,
                deepest_m.max(f64::from(probe.geometry.height_px) * probe.geometry.spacing_m),
            ),
            steady_sigma_m: steady(&elevation_sigma_m, DEPTH_STEP_M / (STEADY_SIGMAS * sigma_axial_m)),
            elevation_sigma_m,
        }
    }

    pub fn wavelength_m(&self) -> f64 {
        4.0 * PI / self.two_k_rad_m
    }

    pub fn centre_frequency_hz(&self) -> f64 {
        self.probe.centre_frequency_hz
    }

    /// σ of the elevational amplitude profile at a depth.
    pub fn sigma_elevation_m(&self, depth_m: f64) -> f64 {
        next_to(&self.elevation_sigma_m, depth_m)
    }

    /// The most that is nowhere more than [`Self::sigma_elevation_m`], and e times as much no sooner than [`STEADY_SIGMAS`] of the
    /// pulse farther on: what follows it changes little within the stretches of tape that go as one.
    pub fn steady_sigma_m(&self, depth_m: f64) -> f64 {
        next_to(&self.steady_sigma_m, depth_m)
    }

    /// σ of the pulse's amplitude along depth, at a depth.
    pub fn sigma_axial_at_m(&self, depth_m: f64) -> f64 {
        self.sigma_axial_m * self.lens.axial(depth_m)
    }

    /// The longest pulse's σ.
    pub fn most_sigma_axial_m(&self) -> f64 {
        self.sigma_axial_m * self.lens.most[0]
    }

    /// Two-way −6 dB thickness of the slice at a depth.
    pub fn thickness_m(&self, depth_m: f64) -> f64 {
        FWHM_PER_SIGMA * self.sigma_elevation_m(depth_m)
    }

    /// Half the active aperture over its depth.
    pub fn half_cone(&self) -> f64 {
        0.5 / self.probe.f_number
    }

    /// Variance of the pulse's spectrum over its centre frequency squared.
    pub fn relative_spread_squared(&self) -> f32 {
        (self.probe.fractional_bandwidth / FWHM_PER_SIGMA).powi(2) as f32
    }

    /// Smallest and largest σ of the elevational profile over all depths.
    pub fn sigma_elevation_range_m(&self) -> [f64; 2] {
        let widths = self.probe.elevation.iter().map(|s| s.width_m);
        let [low, high] = widths.fold([f64::INFINITY, 0.0], |[a, b], w| [w.min(a), w.max(b)]);
        [low / FWHM_PER_SIGMA, high / FWHM_PER_SIGMA]
    }

    /// Active aperture that a constant F# asks for at a depth.
    pub fn wanted_aperture_m(&self, depth_m: f64) -> f64 {
        (depth_m / self.probe.f_number).max(MIN_APERTURE_ELEMENTS * self.probe.pitch_m)
    }

    /// How much wider than σ_l the beam is for the line at `x_m`: out of the lens's focus, and by wanted over available
    /// aperture. The array ends, so lines near its edge, and deep ones, have less than they want.
    pub fn widening(&self, x_m: f64, depth_m: f64) -> f64 {
        let (wanted, half) = (self.wanted_aperture_m(depth_m), self.half_aperture_m);
        if x_m.abs() + wanted / 2.0 <= half {
            return self.defocus(depth_m);
        }
        let available = (x_m + wanted / 2.0).min(half) - (x_m - wanted / 2.0).max(-half);
        let cut = if available * MAX_WIDENING <= wanted { MAX_WIDENING } else { wanted / available };
        cut * self.defocus(depth_m)
    }

    /// How much wider than at its foci the two-way beam is at a depth. Sending and receiving are equally wide where
    /// the aperture is focused, so each is √2 wider than both together. Away from its focus the sent beam is as wide as
    /// the aperture's cone, a uniform width of |z − z_f|/F#; what is received is in focus everywhere.
    fn defocus(&self, depth_m: f64) -> f64 {
        let lens = self.lens.lateral(depth_m);
        let Some(focus_m) = self.probe.transmit_focus_m else { return lens };
        let one_way_m = core::f64::consts::SQRT_2 * self.sigma_lateral_m;
        let cone_m = (depth_m - focus_m) / self.probe.f_number / 12.0f64.sqrt();
        let sent = 1.0 + (cone_m / one_way_m).powi(2);
        lens * (2.0 / (1.0 + 1.0 / sent)).sqrt()
    }

    /// The most that [`Self::widening`] can be.
    pub fn most_widening(&self, half_width_m: f64, deepest_m: f64) -> f64 {
        let focus = if self.probe.transmit_focus_m.is_some() { core::f64::consts::SQRT_2 } else { 1.0 };
        self.widening(half_width_m, deepest_m) / self.defocus(deepest_m) * focus * self.lens.most[1]
    }

    /// Factor from a level over speckle, as a needle states it, to the echo's peak at this place.
    pub fn level_scale(&self, x_m: f64, depth_m: f64) -> f64 {
        let spread = self.widening(x_m, depth_m) * self.lens.axial(depth_m);
        (LEVEL_REFERENCE_THICKNESS_M / self.thickness_m(depth_m) / spread).sqrt()
    }
}

/// The entry of a table by depth next to one.
#[inline]
fn next_to(table: &[f64], depth_m: f64) -> f64 {
    let index = (depth_m * (1.0 / DEPTH_STEP_M) + 0.5) as usize;
    table[index.min(table.len() - 1)]
}

/// The most that is nowhere more than some values, and changes by a factor of e^`rate` at most from one to the next.
fn steady(values: &[f64], rate: f64) -> Vec<f64> {
    let factor = libm::exp(rate);
    let mut steady = values.to_vec();
    for i in 1..steady.len() {
        steady[i] = steady[i].min(steady[i - 1] * factor);
    }
    for i in (1..steady.len()).rev() {
        steady[i - 1] = steady[i - 1].min(steady[i] * factor);
    }
    steady
}

/// Peak of a Gaussian amplitude profile of unit energy, (π·σ²)^(−1/4).
pub fn unit_energy_peak(sigma_m: f64) -> f64 {
    1.0 / (PI * sigma_m * sigma_m).sqrt().sqrt()
}

/// 10^(dB/20).
pub fn amplitude_from_db(db: f64) -> f64 {
    libm::exp(db * NEPER_PER_DB)
}

/// What a pulse loses where its centre frequency loses `loss_np`, one way: less, as its spectrum moves down. With the
/// relative variance b² of a Gaussian spectrum 2c neper both ways become 2c − 2b²c², as long as the spectrum stays away
/// from no frequency at all.
pub fn pulse_loss_np(loss_np: f32, spread: f32) -> f32 {
    loss_np - spread * loss_np * loss_np.min(MAX_SHIFT / spread.max(1e-9))
}
