//! Transverse: keep the plane on the tip of a needle that crosses it.
//!
//! The plane is carried along the needle by the measured depth; what the depth does not tell (errors of the
//! calibration, bending, a slip of the probe) is estimated from the tip's grey level while the plane dithers along the
//! needle. Behind the tip the shaft is cut and present, ahead of it nothing is. The level over the plane's distance
//! e ahead of the tip, amplitudes in nepers of the display with `G` grey levels each,
//!
//!   L(e) = ½G ln( t²·exp(−e²/σ²) + s²·Φ(√2(h − e/σ))² + f² ),
//!
//! has the tip's own echo `t`, the shaft `s` behind it, and the floor `f` of what is taken for the spot where there is
//! none. `σ` is that of the beam in elevation, widened by the size of the tip's echo, which comes from the facet and lies
//! `hσ` behind the shaft's end. How far the shaft is below the tip is not known: a few contrasts are carried along as
//! hypotheses, among them a tip no brighter than its shaft, which leaves a plain step, of which `e = 0` is the shoulder. A
//! Bayes filter on a grid holds where the tip is and which contrast it has; each cell carries its own estimate of the
//! tip's level (a bank of Kalman filters of one state), so that a tip that dims is not taken for one that is left, nor the
//! other way round: only the dither tells them apart.

use serde::{Deserialize, Serialize};
use sonoloop_types::{Pose, ServoSettings, Vector};

use crate::hold::GREY_PER_NEPER;

/// Distance between the cells of the grid.
const CELL_M: f64 = 0.1e-3;
/// Cells to either side of the middle: a slip farther than that is a loss, and a search's affair.
const HALF_CELLS: usize = 40;
const CELLS: usize = 2 * HALF_CELLS + 1;
/// Hypotheses of the shaft's level below the tip's, grey levels. Rendered cross-sections 15, 22 and 30 mm deep, in gelatin-agar and
/// agar, have 60 to 75. [measured]
const CONTRASTS: [f64; 3] = [0.0, 35.0, 70.0];
/// The floor's level below the tip's, the brightest speckle about the spot; 95 to 115 in the same pictures. [measured]
const FLOOR_BELOW: f64 = 105.0;
/// h: the shaft's end lies this many σ ahead of the tip's echo.
const END_AHEAD: f64 = 0.8;
/// Share of images in which something has happened that no model foresees: the probe has slipped.
const SLIP_SHARE: f64 = 2e-3;
/// Share of levels that mean nothing (a bright inclusion, a reverberation).
const OUTLIER_SHARE: f64 = 0.02;
/// Spread of the belief at the start and after a recovery: the operator, or a search, has centred the plane.
const CENTRED_SIGMA_M: f64 = 0.25e-3;
/// The estimate is the mean of the belief this near to its peak …
const PEAK_HALF_CELLS: usize = 4;
/// … when this share of the belief lies there.
const LEAST_CONFIDENCE: f64 = 0.5;
/// Share of the belief on the other side up to which a plane may set out without a peak to go to.
const OTHER_SIDE: f64 = 0.05;
/// What the tip's level may change from image to image, grey levels, standard deviation. A tip brightens and dims by a few a picture
/// where beam and pulse change with depth, in front of the lens's focus.
const LEVEL_WALK: f64 = 1.2;

/// Where the tip is thought to be, in the coordinate of the plane along the probe's y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Along {
    /// Probability by contrast and cell; empty before the first image, and where [`Self::found`] says so.
    belief: Vec<f64>,
    /// How likely each contrast is to begin with.
    contrasts: [f64; CONTRASTS.len()],
    /// The tip's level, by contrast and cell.
    levels: Vec<f64>,
    /// Variance of those levels; the same for all.
    level_variance: f64,
    /// Coordinate of the middle cell.
    middle_m: f64,
}

impl Default for Along {
    fn default() -> Self {
        Self {
            belief: Vec::new(),
            contrasts: [1.0; CONTRASTS.len()],
            levels: Vec::new(),
            level_variance: 0.0,
            middle_m: 0.0,
        }
    }
}

impl Along {
    /// A search has found the tip with the plane at `plane_m`. Where no cell of the grid is there (what was seen during the
    /// search has led it elsewhere), what was believed of the place is void, and the next image is taken as one of the tip, as
    /// the first was; what was believed of its contrast holds.
    pub fn found(&mut self, plane_m: f64) {
        if self.belief.is_empty() || (plane_m - self.middle_m).abs() <= HALF_CELLS as f64 * CELL_M {
            return;
        }
        for (contrast, row) in self.contrasts.iter_mut().zip(self.belief.chunks_exact(CELLS)) {
            *contrast = row.iter().sum();
        }
        self.belief.clear();
    }

    /// The operator, or a search, has centred the plane at `plane_m` on the tip, and it has this level.
    fn begin(&mut self, plane_m: f64, level: f64, sigma_m: f64, noise: f64) {
        self.middle_m = plane_m;
        self.level_variance = noise * noise;
        self.levels.clear();
        for (contrast, share) in CONTRASTS.into_iter().zip(self.contrasts) {
            for cell in 0..CELLS {
                let ahead_m = plane_m - coordinate(plane_m, cell);
                let z = ahead_m / CENTRED_SIGMA_M;
                self.belief.push(share * libm::exp(-0.5 * z * z));
                self.levels.push(level - profile(ahead_m / sigma_m, contrast));
            }
        }
        self.normalise();
    }

    /// Takes one image: the plane stood at `plane_m`, the spot had `level`.
    ///
    /// `sigma_m` is the beam's σ along the coordinate at the spot's depth; `walk_m` the standard deviation of what the tip
    /// may have strayed since the last image. The first image is taken as one of the tip.
    pub fn observe(&mut self, settings: &ServoSettings, plane_m: f64, level: f64, sigma_m: f64, walk_m: f64) {
        // Beam and echo, both Gaussian, make a wider Gaussian.
        let sigma_m = sigma_m.hypot(settings.tip_size_m);
        let noise = settings.level_noise;
        if self.belief.is_empty() {
            self.begin(plane_m, level, sigma_m, noise);
            return;
        }
        self.stray(walk_m);
        self.level_variance += LEVEL_WALK * LEVEL_WALK;
        let scatter = libm::sqrt(self.level_variance + noise * noise);
        let gain = self.level_variance / (scatter * scatter);
        self.level_variance *= 1.0 - gain;
        for (row, contrast) in CONTRASTS.into_iter().enumerate() {
            for cell in 0..CELLS {
                let ahead_m = plane_m - coordinate(self.middle_m, cell);
                let index = row * CELLS + cell;
                let surprise = level - self.levels[index] - profile(ahead_m / sigma_m, contrast);
                let z = surprise / scatter;
                let likelihood = libm::exp(-0.5 * z * z);
                // A level that means nothing teaches nothing.
                self.levels[index] += gain * surprise * likelihood / (likelihood + OUTLIER_SHARE);
                self.belief[index] *= likelihood + OUTLIER_SHARE;
            }
        }
        self.normalise();
        if let Some(tip_m) = self.tip_m(plane_m) {
            self.recentre(tip_m);
        }
    }

    /// The tip may have moved, and with a small probability anything may have happened. Its level goes with it.
    fn stray(&mut self, walk_m: f64) {
        // A step of one cell to either side with this probability has the variance asked for.
        let step = (0.5 * (walk_m / CELL_M).powi(2)).min(0.3);
        let anywhere = SLIP_SHARE / (CELLS * CONTRASTS.len()) as f64;
        for (row, levels) in self.belief.chunks_exact_mut(CELLS).zip(self.levels.chunks_exact_mut(CELLS)) {
            let (old, old_levels) = (row.to_vec(), levels.to_vec());
            let sum: f64 = old.iter().sum();
            let mean: f64 = old.iter().zip(&old_levels).map(|(p, level)| p * level).sum::<f64>() / sum;
            for cell in 0..CELLS {
                let (below, above) = (cell.saturating_sub(1), (cell + 1).min(CELLS - 1));
                let parts = [
                    ((1.0 - 2.0 * step) * (1.0 - SLIP_SHARE) * old[cell], old_levels[cell]),
                    (step * (1.0 - SLIP_SHARE) * old[below], old_levels[below]),
                    (step * (1.0 - SLIP_SHARE) * old[above], old_levels[above]),
                    (anywhere, mean),
                ];
                row[cell] = parts.iter().map(|(p, _)| p).sum();
                levels[cell] = parts.iter().map(|(p, level)| p * level).sum::<f64>() / row[cell];
            }
        }
    }

    fn normalise(&mut self) {
        let sum: f64 = self.belief.iter().sum();
        self.belief.iter_mut().for_each(|p| *p /= sum);
    }

    /// Probability of a cell, whatever the contrast.
    fn of_cell(&self, cell: usize) -> f64 {
        self.belief.iter().skip(cell).step_by(CELLS).sum()
    }

    /// Where the tip is thought to be, as seen from a plane at `plane_m`; `None` before the first image of it, and in doubt.
    ///
    /// The mean about the belief's peak when most of the belief is there; else the mean of all of it when it could be
    /// anywhere, but on one side.
    pub fn tip_m(&self, plane_m: f64) -> Option<f64> {
        if self.belief.is_empty() {
            return None;
        }
        let cells: Vec<f64> = (0..CELLS).map(|cell| self.of_cell(cell)).collect();
        let mut peak = 0;
        for cell in 1..CELLS {
            if cells[cell] > cells[peak] {
                peak = cell;
            }
        }
        let mass = |around: &std::ops::Range<usize>| cells[around.clone()].iter().sum::<f64>();
        let mut around = peak.saturating_sub(PEAK_HALF_CELLS)..(peak + PEAK_HALF_CELLS + 1).min(CELLS);
        if mass(&around) < LEAST_CONFIDENCE {
            let beyond = self.beyond(plane_m);
            if beyond.min(1.0 - beyond) > OTHER_SIDE {
                return None;
            }
            around = 0..CELLS;
        }
        let moment: f64 = around.clone().map(|cell| cells[cell] * coordinate(self.middle_m, cell)).sum();
        Some(moment / mass(&around))
    }

    /// Probability that the tip lies on the far side of a plane at `plane_m`, along the coordinate.
    pub fn beyond(&self, plane_m: f64) -> f64 {
        if self.belief.is_empty() {
            return 0.5;
        }
        (0..CELLS)
            .filter(|&cell| coordinate(self.middle_m, cell) > plane_m)
            .map(|cell| self.of_cell(cell))
            .sum()
    }

    /// Moves the grid by whole cells so that the tip stays near its middle.
    fn recentre(&mut self, tip_m: f64) {
        let shift = libm::round((tip_m - self.middle_m) / CELL_M);
        if shift.abs() < HALF_CELLS as f64 / 4.0 {
            return;
        }
        self.middle_m += shift * CELL_M;
        let shift = shift as isize;
        for values in [&mut self.belief, &mut self.levels] {
            for row in values.chunks_exact_mut(CELLS) {
                let old = row.to_vec();
                for (cell, value) in row.iter_mut().enumerate() {
                    // What comes in at an edge is what was at the edge.
                    let from = (cell as isize + shift).clamp(0, CELLS as isize - 1);
                    *value = old[from as usize];
                }
            }
        }
        self.normalise();
    }
}

fn coordinate(middle_m: f64, cell: usize) -> f64 {
    middle_m + (cell as f64 - HALF_CELLS as f64) * CELL_M
}

/// Level relative to that at the tip for a plane `ahead` beam σ ahead of it, with a shaft `contrast` grey levels
/// below the tip.
fn profile(ahead: f64, contrast: f64) -> f64 {
    raw_profile(ahead, contrast) - raw_profile(0.0, contrast)
}

fn raw_profile(ahead: f64, contrast: f64) -> f64 {
    let power = |levels: f64| libm::exp(2.0 * levels / GREY_PER_NEPER);
    let behind = 0.5 * libm::erfc(ahead - END_AHEAD);
    // A tip as bright as its shaft is the end of the shaft, and has no echo of its own.
    let tip = (1.0 - power(-contrast)) * libm::exp(-ahead * ahead);
    let sum = tip + power(-contrast) * behind * behind + power(-FLOOR_BELOW);
    0.5 * GREY_PER_NEPER * libm::log(sum)
}

/// Elevational advance of a plane that follows a tip fed by `fed_m`, along the probe's y, metres.
///
/// The plane is carried along the *nominal* axis; the error of its direction enters as 1 − cos.
pub fn advance_m(base_from_probe: &Pose, axis_in_base: &Vector, fed_m: f64) -> f64 {
    (base_from_probe.inverse() * axis_in_base).y * fed_m
}

/// Lead of the plane's set point over the tip that makes up for the arm's lag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lead {
    /// Time by which the arm lags behind.
    lag_s: f64,
    last_m_s: f64,
    /// Images in a row with the same speed.
    even_images: u32,
}

/// Longest lag that is made up for: beyond it the plane would be carried ahead of a needle that has stopped.
const MAX_LAG_S: f64 = 0.4;
/// Share of the lag seen in one image that is learnt.
const LAG_GAIN: f64 = 0.05;
/// Below this speed of the plane its lag says nothing.
const LEAST_SPEED_M_S: f64 = 2e-3;

/// A motion is even while its speed changes by less than this share between images, …
const EVEN_SHARE: f64 = 0.1;
/// … for so many of them: until then the arm is still settling.
const EVEN_IMAGES: u32 = 8;

impl Lead {
    /// Before anything has been measured.
    pub fn new(settings: &ServoSettings) -> Self {
        Self { lag_s: settings.lead_s, last_m_s: 0.0, even_images: 0 }
    }

    /// Learns from a plane that stood `behind_m` behind where it was wanted while the tip went at `speed_m_s`. Only an even
    /// motion tells a lag.
    pub fn learn(&mut self, behind_m: f64, speed_m_s: f64) {
        let change_m_s = (speed_m_s - std::mem::replace(&mut self.last_m_s, speed_m_s)).abs();
        if speed_m_s.abs() >= LEAST_SPEED_M_S && change_m_s < EVEN_SHARE * speed_m_s.abs() {
            self.even_images += 1;
        } else {
            self.even_images = 0;
        }
        if self.even_images >= EVEN_IMAGES {
            self.lag_s = (self.lag_s + LAG_GAIN * behind_m / speed_m_s).clamp(0.0, MAX_LAG_S);
        }
    }

    /// Distance by which to lead at a speed.
    pub fn lead_m(&self, speed_m_s: f64) -> f64 {
        self.lag_s * speed_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_profile_at_its_limits() {
        // Far behind: the shaft; far ahead: the floor.
        for contrast in [35.0, 70.0] {
            let tip = raw_profile(0.0, contrast);
            let shaft = 0.5
                * GREY_PER_NEPER
                * libm::log(
                    libm::exp(-2.0 * contrast / GREY_PER_NEPER)
                        + libm::exp(-2.0 * FLOOR_BELOW / GREY_PER_NEPER),
                );
            assert!((profile(-9.0, contrast) + tip - shaft).abs() < 1e-9);
            assert!((profile(9.0, contrast) + tip + FLOOR_BELOW).abs() < 1e-9);
            assert_eq!(profile(0.0, contrast), 0.0);
        }
        // At the shaft's end half of the amplitude is cut: 20·log10(2) = 6.02 dB of 255/60 levels each. The floor adds a little.
        let fall = profile(END_AHEAD, 0.0) - profile(-9.0, 0.0);
        assert!((fall + 6.02 * 255.0 / 60.0).abs() < 0.3, "{fall}");
    }

    #[test]
    fn truth_advance_is_the_feed_times_the_cosine() {
        let axis = Vector::new(0.0, 0.8, 0.6);
        assert!((advance_m(&Pose::identity(), &axis, 0.01) - 0.008).abs() < 1e-15);
    }

    #[test]
    fn truth_a_lag_of_the_arm_is_made_up_for() {
        let settings = crate::servo::tests::settings();
        let mut lead = Lead::new(&settings);
        let (speed, true_lag_s) = (9e-3, 0.13);
        for _ in 0..200 {
            let behind_m = true_lag_s * speed - lead.lead_m(speed);
            lead.learn(behind_m, speed);
        }
        assert!((lead.lead_m(speed) - true_lag_s * speed).abs() < 1e-6);
        assert_eq!(lead.lead_m(0.0), 0.0);
    }

    /// Grey-level noise of the same spread everywhere, without a generator: sums of incommensurate sines.
    fn noise(k: u32) -> f64 {
        let k = f64::from(k);
        4.0 * (libm::sin(1.7 * k) + libm::sin(2.9 * k * k) + libm::sin(0.31 * k * k * k))
    }

    /// Follows a tip that drifts off its measured depth by `drift` per image for 400 images, and slips by `slip_m` in the
    /// middle; returns the rms distance over the last hundred.
    fn follow(contrast: f64, drift_m: f64, slip_m: f64) -> f64 {
        let settings = crate::servo::tests::settings();
        let sigma_m = 0.3e-3;
        let mut along = Along::default();
        let (mut plane_m, mut tip_m, mut sum) = (0.0, 0.1e-3, 0.0);
        for k in 0..400_u32 {
            tip_m += drift_m;
            if k == 200 {
                tip_m += slip_m;
            }
            let dithered_m = plane_m + 0.15e-3 * libm::sin(std::f64::consts::TAU * f64::from(k) / 10.0);
            let level = 120.0 + profile((dithered_m - tip_m) / sigma_m, contrast) + noise(k);
            along.observe(&settings, dithered_m, level, sigma_m, settings.along_walk_m);
            if let Some(believed_m) = along.tip_m(plane_m) {
                plane_m += 0.16 * (believed_m - plane_m);
            }
            if k >= 300 {
                sum += (dithered_m - tip_m).powi(2);
            }
        }
        (sum / 100.0).sqrt()
    }

    #[test]
    fn a_tip_that_strays_from_its_depth_is_followed_whatever_its_contrast() {
        for contrast in [0.0, 15.0, 50.0, 70.0] {
            for drift_m in [-5e-6, 0.0, 5e-6] {
                let rms_m = follow(contrast, drift_m, 0.0);
                assert!(rms_m < 0.35e-3, "contrast {contrast}, drift {drift_m}: {rms_m}");
            }
        }
    }

    #[test]
    fn after_a_slip_onto_the_shaft_the_plane_goes_to_the_tip() {
        // Steel on this scanner: 60 to 75. A shaft that is hardly dimmer than the tip does not tell.
        for contrast in [35.0, 50.0, 70.0, 85.0] {
            let rms_m = follow(contrast, 0.0, 1.5e-3);
            assert!(rms_m < 0.35e-3, "contrast {contrast}: {rms_m}");
        }
    }

    /// Seen in a transverse run whose probe had slipped: the belief was 8 mm off the tip that a search had found, no cell of
    /// its grid there, and the plane left the tip for it again and again.
    #[test]
    fn a_tip_found_where_the_belief_has_no_cell_is_believed() {
        let settings = crate::servo::tests::settings();
        let mut along = Along::default();
        let observe = |along: &mut Along, plane_m: f64, level: f64| {
            along.observe(&settings, plane_m, level, 0.33e-3, settings.along_walk_m);
        };
        observe(&mut along, 0.0, 130.0);
        // Nothing is seen where it was.
        for k in 0..60 {
            observe(&mut along, 2e-3 - 0.05e-3 * f64::from(k), 25.0 + 0.5 * noise(k));
        }
        let found_m = along.middle_m - 6e-3;
        along.found(found_m);
        for k in 0..4 {
            observe(&mut along, found_m, 130.0 + 0.2 * noise(k));
        }
        let tip_m = along.tip_m(found_m).expect("a belief");
        assert!((tip_m - found_m).abs() < 0.3e-3, "{tip_m}");
        // Where there are cells they know better than a search that may stand on the shaft.
        let before = along.clone();
        along.found(found_m + 1e-3);
        assert_eq!(along, before);
    }

    #[test]
    fn the_belief_tells_on_which_side_the_tip_is() {
        let settings = crate::servo::tests::settings();
        for slip_m in [-0.6e-3, 0.6e-3] {
            let mut along = Along::default();
            let observe = |along: &mut Along, plane_m: f64, tip_m: f64| {
                let level = 120.0 + profile((plane_m - tip_m) / 0.46e-3, 70.0);
                along.observe(&settings, plane_m, level, 0.3e-3, settings.along_walk_m);
            };
            for k in 0..40 {
                let dither_m = 0.15e-3 * libm::sin(f64::from(k));
                observe(&mut along, dither_m, 0.0);
            }
            for k in 40..50 {
                let dither_m = 0.15e-3 * libm::sin(f64::from(k));
                observe(&mut along, dither_m, slip_m);
            }
            let beyond = along.beyond(0.0);
            assert!(if slip_m > 0.0 { beyond > 0.9 } else { beyond < 0.1 }, "{slip_m}: {beyond}");
        }
    }
}
