//! Where a candidate is brightest.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Level of a candidate, and where the plane stood, in the unit of the axis it is moved along.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Sample {
    pub at: f64,
    pub level: f64,
}

/// Where the level is highest: crest of a parabola through all samples when they have one inside, else the best.
pub(super) fn crest_at(samples: &[Sample]) -> f64 {
    let first = samples.iter().map(|s| s.at).fold(f64::INFINITY, f64::min);
    let last = samples.iter().map(|s| s.at).fold(f64::NEG_INFINITY, f64::max);
    let Some(best) = brightest(samples) else { return 0.0 };
    let half = (last - first) / 2.0;
    if samples.len() < 5 || half <= 0.0 {
        return best.at;
    }
    let middle = (first + last) / 2.0;
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for s in samples {
        let x = (s.at - middle) / half;
        let row = Vector3::new(1.0, x, x * x);
        normal += row * row.transpose();
        right += row * s.level;
    }
    match normal.cholesky().map(|c| c.solve(&right)) {
        Some(c) if c.z < 0.0 && (c.y / (2.0 * c.z)).abs() <= 1.0 => middle - half * c.y / (2.0 * c.z),
        _ => best.at,
    }
}

/// The first of the brightest.
pub(super) fn brightest(samples: &[Sample]) -> Option<Sample> {
    samples.iter().copied().reduce(|best, s| if s.level > best.level { s } else { best })
}
