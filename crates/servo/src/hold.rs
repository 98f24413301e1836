//! Keep the plane on the tip: extremum seeking on the tip's grey level.
//!
//! Brightness is even in elevation, so one picture gives the distance to the plane but not its side. A small
//! dither gives the side: regress the level on the measured elevation of the probe (and on time, for the level's own
//! drift); the slope's sign points to the tip. With amplitude weight exp(−e²/2σ²) and a log display of `G` grey
//! levels per neper, level(e) = L₀ − G·e²/2σ², so slope = −G·e/σ² and e = −slope·σ²/G. The level must be that of the tip alone: in
//! recorded insertions the slope of its brightest spot was 0.7 to 1.3 of this (eight), that of a mean over the template 0.4 to 0.7 (six).

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Grey levels per neper of amplitude on a display of 60 dB: 8.686·255/60. The scanner's true dynamic range is not
/// known here; a wrong one only scales the loop's gain.
pub(crate) const GREY_PER_NEPER: f64 = 8.686 * 255.0 / 60.0;
/// A window has room for so many pictures, in whole periods of the dither: what is older is late.
const WINDOW_IMAGES: f64 = 10.0;
/// Fewest samples for a fit: some of a window's pictures may be missing.
const LEAST_SAMPLES: usize = 8;

/// One picture's level and where the probe stood.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Sample {
    time_s: f64,
    elevation_m: f64,
    level: f64,
}

/// The last few samples of the dither.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Hold {
    samples: Vec<Sample>,
}

impl Hold {
    /// Forgets everything, after a loss or a jump of the plane.
    pub fn reset(&mut self) {
        self.samples.clear();
    }

    /// Adds a picture's level at the measured elevation. What is older than some whole periods of the dither is forgotten;
    /// pictures come every `dt_s`.
    pub fn push(&mut self, time_s: f64, elevation_m: f64, level: f64, dither_period_s: f64, dt_s: f64) {
        let periods = (WINDOW_IMAGES * dt_s / dither_period_s - 1e-9).ceil();
        let window_s = dither_period_s * periods;
        // Half a picture less: of two that lie a window apart one counts.
        self.samples.retain(|s| time_s - s.time_s < window_s - 0.5 * dt_s);
        self.samples.push(Sample { time_s, elevation_m, level });
    }

    /// Estimated elevation at which the plane would meet the tip, in the coordinate of the samples, metres.
    ///
    /// `sigma_m` is the beam's σ at the tip's depth; the answer lies within ±σ of the samples' mean. `None` while
    /// there is too little data or no dither in it.
    pub fn centre_m(&self, sigma_m: f64) -> Option<f64> {
        if self.samples.len() < LEAST_SAMPLES {
            return None;
        }
        let count = self.samples.len() as f64;
        let mean = |of: fn(&Sample) -> f64| self.samples.iter().map(of).sum::<f64>() / count;
        let (time_s, elevation_m) = (mean(|s| s.time_s), mean(|s| s.elevation_m));
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for s in &self.samples {
            let row = Vector3::new(1.0, s.time_s - time_s, (s.elevation_m - elevation_m) / sigma_m);
            normal += row * row.transpose();
            right += row * s.level;
        }
        // Without a dither of at least σ/50 rms the slope is noise.
        if normal[(2, 2)] / count < 4e-4 {
            return None;
        }
        let slope_per_sigma = (normal.cholesky()?.solve(&right)).z;
        Some(elevation_m + (slope_per_sigma / GREY_PER_NEPER).clamp(-1.0, 1.0) * sigma_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_offset_of_a_parabolic_level_is_found_with_its_side() {
        let (sigma_m, true_offset_m) = (0.36e-3, 0.2e-3);
        let mut hold = Hold::default();
        for k in 0..40 {
            let time_s = f64::from(k) * 0.04;
            let elevation_m = 0.1e-3 * (time_s * 7.85).sin();
            let e = (elevation_m + true_offset_m) / sigma_m;
            hold.push(time_s, elevation_m, 180.0 + 3.0 * time_s - GREY_PER_NEPER * e * e / 2.0, 0.8, 0.04);
        }
        let centre_m = hold.centre_m(sigma_m).unwrap();
        assert!((centre_m + true_offset_m).abs() < 0.02e-3, "{centre_m}");
    }

    #[test]
    fn every_fifth_picture_may_be_missing() {
        for period_s in [0.3, 0.4, 0.5, 0.8] {
            let (sigma_m, true_offset_m) = (0.36e-3, 0.2e-3);
            let mut hold = Hold::default();
            for k in (0..80).filter(|k| k % 5 != 2) {
                let time_s = f64::from(k) * 0.04;
                let elevation_m = 0.1e-3 * (std::f64::consts::TAU * time_s / period_s).sin();
                let e = (elevation_m + true_offset_m) / sigma_m;
                let level = 180.0 - GREY_PER_NEPER * e * e / 2.0;
                hold.push(time_s, elevation_m, level, period_s, 0.04);
                if k >= 20 {
                    let centre_m = hold.centre_m(sigma_m).expect("a fit");
                    assert!(
                        (centre_m + true_offset_m).abs() < 0.04e-3,
                        "{period_s} s, image {k}: {centre_m}"
                    );
                }
            }
        }
    }

    #[test]
    fn without_dither_there_is_no_side() {
        let mut hold = Hold::default();
        for k in 0..40 {
            hold.push(f64::from(k) * 0.04, 1e-3, 180.0, 0.4, 0.04);
        }
        assert_eq!(hold.centre_m(0.3e-3), None);
    }
}
