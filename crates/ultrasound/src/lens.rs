//! How the pulse and the beam widen where the array's lens is out of focus.
//!
//! The elements are h high and their lens is focused at z_f. On the axis, at depth z, sound from the height y comes late by
//! y²/2·(1/z − 1/z_f), so a frequency arrives with the amplitude
//!
//! ```text
//! A(f, z) = ∫₀¹ exp(−i·u·s²) ds,    u = π·f·h²/(4·c)·(1/z − 1/z_f)
//! ```
//!
//! (Fresnel; each way). In front of the focus that stretches or splits the pulse and takes its high frequencies, by which the
//! lateral beam is wider too. The product of three Gaussians that a beam is here has that as two factors over depth, one for
//! the length of speckle's grain and one for the mean wavelength, both 1 at the focus.

use core::f64::consts::{LN_2, PI};

use sonoloop_types::ProbeSpec;

/// Distance of the depths in the table.
const STEP_M: f64 = 0.05e-3;
/// σ, in such steps, over which factors are smoothed: a line of echoes that sums to nothing must meet no kinks.
const SMOOTHING: f64 = 5.0;
/// Vergences 1/z − 1/z_f that are worked out; depths between them are interpolated.
const VERGENCES: usize = 48;
/// Frequencies of the spectrum, from no frequency to twice the centre.
const FREQUENCIES: usize = 64;
/// Step of the lag at which the echo's autocovariance is looked at, in periods of the centre frequency, and the most of them.
const PERIODS_PER_LAG: f64 = 0.05;
const LAGS: usize = 64;
/// Points of the integral over half the element's height, at least; more where neighbours would differ by more than a radian.
const HEIGHTS: usize = 32;
/// A two-way spectrum is flatter on top than a Gaussian: exp(−ln 2·|2·Δf/B|^4). [assumed]
const FLATNESS: f64 = 4.0;
/// Width of that band over a Gaussian's with the same variance, √(Γ(¼)/Γ(¾)·√(ln 2)/(2·ln 2)).
const FLAT_OVER_GAUSSIAN: f64 = 1.333;
/// In front of this many element heights factors are held: pulses come apart there, and nothing was compared with them.
const NEAREST_HEIGHTS: f64 = 1.6;
/// Neither factor is ever taken beyond these.
const FACTORS: [f64; 2] = [0.75, 1.5];

/// Both factors over depth.
#[derive(Debug, Clone)]
pub struct Lens {
    /// Length of the pulse, and width of the lateral beam, over those at the focus, every [`STEP_M`].
    factors: Vec<[f64; 2]>,
    /// The most of either factor, asked for with every picture, and in the direct sum with every scatterer.
    pub most: [f64; 2],
}

impl Lens {
    pub fn new(probe: &ProbeSpec, deepest_m: f64) -> Self {
        let at_focus = measure(probe, 0.0);
        let vergence_per_m = |depth_m: f64| 1.0 / depth_m - 1.0 / probe.elevation_focus_m;
        let nearest_m = NEAREST_HEIGHTS * probe.element_height_m;
        let (most_per_m, least_per_m) =
            (vergence_per_m(nearest_m), vergence_per_m(deepest_m.max(2.0 * nearest_m)));
        let step_per_m = (most_per_m - least_per_m) / (VERGENCES - 1) as f64;
        let by_vergence: Vec<[f64; 2]> = (0..VERGENCES)
            .map(|i| {
                let here = measure(probe, least_per_m + i as f64 * step_per_m);
                core::array::from_fn(|k| (here[k] / at_focus[k]).clamp(FACTORS[0], FACTORS[1]))
            })
            .collect();
        let sharp: Vec<[f64; 2]> = (0..=(deepest_m / STEP_M) as usize + 1)
            .map(|i| {
                let depth_m = (i as f64 * STEP_M).max(nearest_m);
                let place = ((vergence_per_m(depth_m) - least_per_m) / step_per_m).max(0.0);
                let first = (place as usize).min(VERGENCES - 2);
                let share = (place - first as f64).min(1.0);
                core::array::from_fn(|k| {
                    by_vergence[first][k] + share * (by_vergence[first + 1][k] - by_vergence[first][k])
                })
            })
            .collect();
        let factors = smoothed(&sharp);
        let most = factors.iter().fold([1.0; 2], |most: [f64; 2], f| [most[0].max(f[0]), most[1].max(f[1])]);
        Self { factors, most }
    }

    /// Interpolated between the depths of the table.
    fn at(&self, depth_m: f64, factor: usize) -> f64 {
        let place = (depth_m * (1.0 / STEP_M)).clamp(0.0, (self.factors.len() - 2) as f64);
        let (first, share) = (place as usize, place - place.trunc());
        let [a, b] = [self.factors[first][factor], self.factors[first + 1][factor]];
        a + share * (b - a)
    }

    /// Length of the pulse at a depth over that at the focus.
    pub fn axial(&self, depth_m: f64) -> f64 {
        self.at(depth_m, 0)
    }

    /// Width of the lateral beam at a depth over that at the focus.
    pub fn lateral(&self, depth_m: f64) -> f64 {
        self.at(depth_m, 1)
    }
}

/// Gaussian means; the ends count on beyond themselves.
fn smoothed(sharp: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let reach = (3.0 * SMOOTHING) as i64;
    let weights: Vec<f64> =
        (-reach..=reach).map(|i| libm::exp(-0.5 * (i as f64 / SMOOTHING).powi(2))).collect();
    let total: f64 = weights.iter().sum();
    let last = sharp.len() as i64 - 1;
    let mean = |at: i64, factor: usize| {
        let sum: f64 = (-reach..=reach)
            .zip(&weights)
            .map(|(i, w)| w * sharp[(at + i).clamp(0, last) as usize][factor])
            .sum();
        sum / total
    };
    (0..=last).map(|at| [mean(at, 0), mean(at, 1)]).collect()
}

/// Length of the grain of speckle in seconds, and period of the echo's mean frequency, where the lens is off by
/// `vergence` = 1/z − 1/z_f. The length is the lag at which the echo's autocovariance, whose spectrum is |E(f)|², has fallen
/// to 1/√2: that of a Gaussian pulse has its −6 dB length.
fn measure(probe: &ProbeSpec, vergence_per_m: f64) -> [f64; 2] {
    let (f0, h, c) = (probe.centre_frequency_hz, probe.element_height_m, probe.assumed_sound_speed_m_s);
    let half_band_hz = 0.5 * FLAT_OVER_GAUSSIAN * probe.fractional_bandwidth * f0;
    let spectrum: [[f64; 2]; FREQUENCIES] = core::array::from_fn(|i| {
        let f = 2.0 * f0 * (i + 1) as f64 / FREQUENCIES as f64;
        let band = libm::exp(-LN_2 * libm::pow(((f - f0) / half_band_hz).abs(), FLATNESS));
        let [re, im] = one_way(PI * f * h * h / (4.0 * c) * vergence_per_m);
        [f, band * (re * re + im * im)]
    });
    let total: f64 = spectrum.iter().map(|[_, e]| e).sum();
    let mean_hz = spectrum.iter().map(|[f, e]| f * e).sum::<f64>() / total;
    let step_s = PERIODS_PER_LAG / f0;
    let covariance = |lag: usize| {
        let sum = spectrum.iter().fold([0.0; 2], |[re, im], [f, e]| {
            let (sin, cos) = libm::sincos(2.0 * PI * (f - mean_hz) * lag as f64 * step_s);
            [re + e * e * cos, im + e * e * sin]
        });
        libm::hypot(sum[0], sum[1])
    };
    let mut above = covariance(0);
    let level = above * core::f64::consts::FRAC_1_SQRT_2;
    for lag in 1..LAGS {
        let below = covariance(lag);
        if below < level {
            return [((lag - 1) as f64 + (above - level) / (above - below)) * step_s, 1.0 / mean_hz];
        }
        above = below;
    }
    [LAGS as f64 * step_s, 1.0 / mean_hz]
}

/// ∫₀¹ exp(−i·u·s²) ds by the midpoint rule.
fn one_way(u: f64) -> [f64; 2] {
    let heights = HEIGHTS.max((2.0 * u.abs()) as usize);
    let mut sum = [0.0; 2];
    for i in 0..heights {
        let s = (i as f64 + 0.5) / heights as f64;
        let (sin, cos) = libm::sincos(-u * s * s);
        sum = [sum[0] + cos, sum[1] + sin];
    }
    sum.map(|part| part / heights as f64)
}
