//! The needle's axis: RANSAC over the packed points, then least squares.
//!
//! Fischler and Bolles (1981): a line through two points drawn at random is scored by the points near it; the best of
//! a fixed number of draws is refined over its inliers. A point is an inlier when it lies near the line and its ridge
//! runs along it. The score is the sum of the inliers' responses, so bright ridges count for more than many dim ones.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::packing::Point;

/// Of every image, so that it gives the same line on every machine and in every order of images.
const SEED: u64 = 0x0067_6162_6f72;
/// With only 20 of 256 points on the needle (one that just came in), all draws miss it in less than one image of 10⁴.
const DRAWS: u32 = 2000;
/// Farthest an inlier may lie from the line: a cell's strongest pixel is somewhere on a ridge up to 6 px wide.
const TOLERANCE_PX: f64 = 3.0;
/// cos 20°: half the bank's spacing, and as much again and more for speckle's pull.
const LEAST_COS: f64 = 0.94;
/// Points closer together than this give no direction.
const LEAST_APART_PX: f64 = 16.0;
/// A line needs so many inliers.
const LEAST_INLIERS: usize = 5;
/// Rounds of least squares, each with the inliers of the last.
const ROUNDS: usize = 3;

/// A straight line in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    /// A point of it: the weighted centre of its inliers.
    pub at_px: [f64; 2],
    /// Its direction, of unit length; the sign means nothing yet.
    pub along: [f64; 2],
}

impl Line {
    /// Signed distance of a point from the line.
    pub fn across(&self, at_px: [f64; 2]) -> f64 {
        self.along[0] * (at_px[1] - self.at_px[1]) - self.along[1] * (at_px[0] - self.at_px[0])
    }

    /// Angle from the u axis towards v, in [−π/2, π/2].
    pub fn angle_rad(&self) -> f64 {
        let sign = if self.along[0] < 0.0 { -1.0 } else { 1.0 };
        libm::atan2(sign * self.along[1], sign * self.along[0])
    }

    /// Whether a point belongs to it.
    pub fn holds(&self, point: &Point) -> bool {
        let cos = self.along[0] * point.along[0] + self.along[1] * point.along[1];
        self.across(point.at_px).abs() <= TOLERANCE_PX && cos.abs() >= LEAST_COS
    }
}

/// A fitted line and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit {
    pub line: Line,
    /// Points that belong to it.
    pub inliers: usize,
    /// Weighted rms distance of those points from it.
    pub residual_px: f64,
}

/// The best line whose angle lies in `angle_rad`; `None` when too few points agree on one.
pub(crate) fn fit(points: &[Point], angle_rad: [f64; 2]) -> Option<Fit> {
    if points.len() < LEAST_INLIERS {
        return None;
    }
    let allowed = |line: &Line| (angle_rad[0]..=angle_rad[1]).contains(&line.angle_rad());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut best: Option<(f64, Line)> = None;
    for _ in 0..DRAWS {
        let [a, b] = [0; 2].map(|_| &points[rng.random_range(0..points.len() as u32) as usize]);
        let Some(line) = through(a, b).filter(|line| line.holds(a) && line.holds(b) && allowed(line)) else {
            continue;
        };
        let score = points.iter().filter(|p| line.holds(p)).map(|p| p.response).sum();
        if best.is_none_or(|(highest, _)| score > highest) {
            best = Some((score, line));
        }
    }
    let mut fit = refine(points, best?.1)?;
    for _ in 1..ROUNDS {
        fit = refine(points, fit.line)?;
    }
    allowed(&fit.line).then_some(fit)
}

fn through(a: &Point, b: &Point) -> Option<Line> {
    let apart = [b.at_px[0] - a.at_px[0], b.at_px[1] - a.at_px[1]];
    let length = libm::hypot(apart[0], apart[1]);
    (length >= LEAST_APART_PX).then(|| Line { at_px: a.at_px, along: apart.map(|c| c / length) })
}

/// Least squares of the distances across the line, weighted by response: the axis of largest spread of the inliers,
/// at ½ atan2(2 s_uv, s_uu − s_vv).
fn refine(points: &[Point], line: Line) -> Option<Fit> {
    let members = || points.iter().filter(|p| line.holds(p));
    let inliers = members().count();
    if inliers < LEAST_INLIERS {
        return None;
    }
    let weight: f64 = members().map(|p| p.response).sum();
    let mean = [0, 1].map(|axis| members().map(|p| p.response * p.at_px[axis]).sum::<f64>() / weight);
    let mut spread = [0.0; 3];
    for point in members() {
        let [u, v] = [point.at_px[0] - mean[0], point.at_px[1] - mean[1]];
        for (sum, term) in spread.iter_mut().zip([u * u, u * v, v * v]) {
            *sum += point.response * term;
        }
    }
    let [uu, uv, vv] = spread;
    let angle_rad = 0.5 * libm::atan2(2.0 * uv, uu - vv);
    let line = Line { at_px: mean, along: [libm::cos(angle_rad), libm::sin(angle_rad)] };
    let squares: f64 = members().map(|p| p.response * line.across(p.at_px) * line.across(p.at_px)).sum();
    Some(Fit { line, inliers, residual_px: (squares / weight).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVERY_ANGLE: [f64; 2] = [-2.0, 2.0];

    fn scattered(seed: u64, angle_rad: f64, outliers: usize) -> Vec<Point> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let on = (0..40).map(|k| f64::from(k) * 5.0 - 100.0).collect::<Vec<_>>();
        let [cos, sin] = [libm::cos(angle_rad), libm::sin(angle_rad)];
        let mut points: Vec<_> = on
            .iter()
            .map(|s| {
                let across = rng.random_range(-1.0..1.0);
                Point {
                    at_px: [300.0 + s * cos - across * sin, 200.0 + s * sin + across * cos],
                    response: rng.random_range(20.0..60.0),
                    along: [cos, sin],
                }
            })
            .collect();
        points.extend((0..outliers).map(|_| {
            let turn = rng.random_range(0.0..3.0);
            Point {
                at_px: [rng.random_range(0.0..640.0), rng.random_range(0.0..480.0)],
                response: rng.random_range(20.0..60.0),
                along: [libm::cos(turn), libm::sin(turn)],
            }
        }));
        points
    }

    #[test]
    fn truth_a_line_among_as_many_outliers() {
        for seed in 0..20 {
            for angle_rad in [0.0, 0.4, -0.6, 1.3, -1.3] {
                let fit = fit(&scattered(seed, angle_rad, 40), EVERY_ANGLE).unwrap();
                assert!((fit.line.angle_rad() - angle_rad).abs() < f64::to_radians(1.0), "{fit:?}");
                assert!(fit.line.across([300.0, 200.0]).abs() < 0.5, "{fit:?}");
                assert!(fit.inliers >= 40 && fit.residual_px < 1.0, "{fit:?}");
            }
        }
    }

    #[test]
    fn ridges_that_run_elsewhere_do_not_count() {
        let mut points = scattered(1, 0.3, 0);
        points.iter_mut().for_each(|p| p.along = [-p.along[1], p.along[0]]);
        assert_eq!(fit(&points, EVERY_ANGLE), None);
        assert_eq!(fit(&scattered(1, 0.3, 0), [0.5, 1.0]), None, "an angle that is not allowed");
        assert_eq!(fit(&[], EVERY_ANGLE), None);
    }
}
