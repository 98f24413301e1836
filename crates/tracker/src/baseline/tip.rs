//! The tip: how far along the line the picture is likelier to show needle than background.
//!
//! Every sample s of the profile is either needle or background. With N a normal density and ε the share of samples
//! that follow neither,
//!
//! ```text
//! p(c | needle) = (1 − ε) N(c; μ, σ_n) + ε/256,   p(c | background) = (1 − ε) N(c; 0, σ_b) + ε/256
//! ```
//!
//! where c is the contrast, cut to 0 … μ: brighter than the shaft, as tips are, is no less needle. μ and σ_n are
//! median and spread at the line's inliers, σ_b follows from the difference of the strips beside the line. With
//! every begin and every end equally likely beforehand, the most probable stretch of needle is the one with the
//! largest sum of log-likelihood ratios.
//!
//! The last sample of that stretch lies on the echo's flank, which log compression draws several pixels beyond the echo
//! (4.4 px on synthetic needles over a dim background). So the tip is put where the contrast last lies within one
//! spread of the shaft's level: on a sharp step that is the same place, on a blurred one it is nearer to the needle's
//! end.

use super::line::Fit;
use super::packing::Point;
use super::profile::Profile;

/// ε: shadows, crossing echoes.
const STRAY: f64 = 0.05;
/// Least spread of either state: neither display nor needle is even to better than this.
const LEAST_SPREAD_LEVELS: f64 = 6.0;
/// Half-normal medians to standard deviations.
const SIGMA_PER_MEDIAN: f64 = 1.4826;
/// A needle stands out by as many standard deviations of the background …
const LEAST_SEPARATION: f64 = 2.0;
/// … is seen over a stretch as long as this …
const LEAST_LENGTH_PX: usize = 48;
/// … and at least this share of its pieces, each as long as two cells of the packing, hold an inlier.
const LEAST_COVERAGE: f64 = 0.6;
const PIECE_PX: usize = 16;
/// The confidence asks how probable it is that the tip is within this of where it is said to be.
const NEAR_PX: usize = 4;

/// A tip with what speaks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tip {
    pub tip_px: [f64; 2],
    /// 0 … 1.
    pub confidence: f64,
}

/// Scratch of [`TipFinder::find`].
#[derive(Debug, Clone, Default)]
pub(crate) struct TipFinder {
    values: Vec<f64>,
    ratios: Vec<f64>,
    pieces: Vec<bool>,
}

impl TipFinder {
    /// The most probable tip on a profile; `None` when no needle lies there.
    pub fn find(&mut self, profile: &Profile, fit: &Fit, points: &[Point]) -> Option<Tip> {
        let members = || points.iter().filter(|p| fit.line.holds(p)).map(|p| profile.nearest(p.at_px));
        self.values.clear();
        self.values.extend(members().map(|sample| profile.contrast[sample]));
        let level = median(&mut self.values)?;
        self.values.iter_mut().for_each(|c| *c = (*c - level).abs());
        let spread = (SIGMA_PER_MEDIAN * median(&mut self.values)?).max(LEAST_SPREAD_LEVELS);
        self.values.clear();
        self.values.extend(profile.aside.iter().map(|d| d.abs()));
        // Strips of variance s² differ by 2 s²; the contrast has s² + ½ s² where there is no needle.
        let ground =
            (0.75_f64.sqrt() * SIGMA_PER_MEDIAN * median(&mut self.values)?).max(LEAST_SPREAD_LEVELS);
        if level < LEAST_SEPARATION * ground {
            return None;
        }

        let density = |c: f64, middle: f64, sigma: f64| {
            let z = (c - middle) / sigma;
            let normal = libm::exp(-0.5 * z * z) / (sigma * std::f64::consts::TAU.sqrt());
            (1.0 - STRAY) * normal + STRAY / 256.0
        };
        self.ratios.clear();
        self.ratios.extend(profile.contrast.iter().map(|c| {
            let c = c.clamp(0.0, level);
            libm::log(density(c, level, spread) / density(c, 0.0, ground))
        }));
        let [begin, end] = likeliest_stretch(&self.ratios)?;
        let length = end + 1 - begin;
        if length < LEAST_LENGTH_PX {
            return None;
        }
        self.pieces.clear();
        // The rest that does not fill a piece belongs to the last one.
        let pieces = length / PIECE_PX;
        self.pieces.resize(pieces, false);
        for sample in members().filter(|sample| (begin..=end).contains(sample)) {
            self.pieces[((sample - begin) / PIECE_PX).min(pieces - 1)] = true;
        }
        let coverage = self.pieces.iter().filter(|held| **held).count() as f64 / self.pieces.len() as f64;
        if coverage < LEAST_COVERAGE {
            return None;
        }
        let tip_px = profile.at_px(last_above(&profile.contrast, [begin, end], level - spread));
        Some(Tip { tip_px, confidence: coverage * self.near(begin, end) })
    }

    /// Probability that the needle ends near `end`, given that it begins at `begin`.
    fn near(&self, begin: usize, end: usize) -> f64 {
        let best: f64 = self.ratios[begin..=end].iter().sum();
        let (mut sum, mut near, mut all) = (0.0, 0.0, 0.0);
        for (sample, ratio) in self.ratios.iter().enumerate().skip(begin) {
            sum += ratio;
            let weight = libm::exp(sum - best);
            all += weight;
            if sample.abs_diff(end) <= NEAR_PX {
                near += weight;
            }
        }
        near / all
    }
}

/// First and last sample of the stretch with the largest sum; `None` when no sample is positive.
fn likeliest_stretch(ratios: &[f64]) -> Option<[usize; 2]> {
    let (mut sum, mut begin, mut highest, mut stretch) = (0.0, 0, 0.0, None);
    for (sample, ratio) in ratios.iter().enumerate() {
        if sum <= 0.0 {
            (sum, begin) = (0.0, sample);
        }
        sum += ratio;
        if sum > highest {
            highest = sum;
            stretch = Some([begin, sample]);
        }
    }
    stretch
}

/// Where a stretch, followed back from its end, first comes to `floor`, to a fraction of a sample.
fn last_above(contrast: &[f64], [begin, end]: [usize; 2], floor: f64) -> f64 {
    let last = (begin..=end).rev().find(|sample| contrast[*sample] >= floor).unwrap_or(end);
    let here = contrast[last];
    // At the picture's border there is no next sample.
    let beyond = contrast
        .get(last + 1)
        .filter(|next| **next < floor)
        .map_or(0.0, |next| ((here - floor) / (here - next)).clamp(0.0, 1.0));
    last as f64 + beyond
}

/// The middle value; reorders them.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::line::Line;
    use rand::{RngExt, SeedableRng};

    /// Needle up to sample `end` of 400, with noise on everything.
    fn step(seed: u64, end: usize, height: f64, noise: f64) -> (Profile, Fit, Vec<Point>) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || rng.random_range(-noise..=noise);
        let contrast = (0..400).map(|s| if s <= end { height } else { 0.0 } + draw()).collect();
        let aside = (0..400).map(|_| draw() - draw()).collect();
        let profile = Profile { from_px: [0.0, 50.0], axis_px: [1.0, 0.0], contrast, aside };
        let line = Line { at_px: [100.0, 50.0], along: [1.0, 0.0] };
        let point = |s: usize| Point { at_px: [s as f64, 50.0], response: 50.0, along: [1.0, 0.0] };
        let points: Vec<_> = (0..=end).step_by(8).map(point).collect();
        (profile, Fit { line, inliers: points.len(), residual_px: 0.0 }, points)
    }

    #[test]
    fn truth_a_step_ends_where_it_ends() {
        let errors_px: Vec<_> = (0..50)
            .map(|seed| {
                let end = 60 + 5 * seed as usize;
                let (profile, fit, points) = step(seed, end, 80.0, 20.0);
                let tip = TipFinder::default().find(&profile, &fit, &points).unwrap();
                assert_eq!(tip.tip_px[1], 50.0);
                assert!(tip.confidence > 0.9 && tip.confidence <= 1.0, "{tip:?}");
                (tip.tip_px[0] - (end as f64 + 0.5)).abs()
            })
            .collect();
        // One sample of the shaft in six lies below the floor, so now and then the last two do.
        let near = errors_px.iter().filter(|error| **error < 2.0).count();
        assert!(near >= 45 && errors_px.iter().all(|error| *error < 4.0), "{errors_px:?}");
    }

    #[test]
    fn a_dim_or_short_or_spotty_needle_is_none() {
        let find = |(profile, fit, points): (Profile, Fit, Vec<Point>)| {
            TipFinder::default().find(&profile, &fit, &points)
        };
        assert_eq!(find(step(1, 200, 15.0, 30.0)), None);
        assert_eq!(find(step(1, 20, 80.0, 30.0)), None);
        let (profile, fit, mut points) = step(1, 200, 80.0, 30.0);
        points.truncate(8);
        assert_eq!(find((profile, fit, points)), None);
    }

    #[test]
    fn a_gap_in_the_shaft_is_bridged() {
        let (mut profile, fit, points) = step(3, 200, 80.0, 20.0);
        profile.contrast[90..110].fill(0.0);
        let tip = TipFinder::default().find(&profile, &fit, &points).unwrap();
        assert!((tip.tip_px[0] - 200.5).abs() < 2.0, "{tip:?}");
    }

    #[test]
    fn truth_a_ramp_ends_where_it_comes_to_the_floor() {
        let ramp = [9.0, 9.0, 8.0, 4.0, 0.0];
        assert_eq!(last_above(&ramp, [0, 3], 6.0), 2.5);
        assert_eq!(last_above(&ramp, [0, 1], 6.0), 1.0, "what lies beyond the stretch is not looked at");
        assert_eq!(last_above(&ramp[..2], [0, 1], 6.0), 1.0, "the border");
    }

    #[test]
    fn truth_the_stretch_of_largest_sum() {
        assert_eq!(likeliest_stretch(&[-1.0, 2.0, -1.0, 3.0, -5.0, 1.0]), Some([1, 3]));
        assert_eq!(likeliest_stretch(&[-1.0, -2.0]), None);
        assert_eq!(likeliest_stretch(&[]), None);
    }
}
