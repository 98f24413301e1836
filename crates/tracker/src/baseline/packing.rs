//! Bin packing: few points instead of many pixels, so that the line is found in bounded time.

use super::gabor::orientation_rad;

/// Side of a cell in half-resolution pixels; each gives its strongest pixel.
const CELL: usize = 4;
/// The strongest points that are kept. A needle across a picture of 640 × 480 px crosses at most 140 cells.
pub(crate) const MAX_POINTS: usize = 256;

/// A pixel that stands for its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// Its place (u, v) in the picture.
    pub at_px: [f64; 2],
    /// Response of the filter bank, grey levels.
    pub response: f64,
    /// Direction of its ridge, of unit length; the sign means nothing.
    pub along: [f64; 2],
}

/// The strongest pixel above `limit` of every cell, strongest first.
pub(crate) fn pack<'a>(
    rows: impl Iterator<Item = (&'a [f32], &'a [u8])>,
    limit: f32,
    strongest: &mut Vec<(f32, [usize; 2], u8)>,
    points: &mut Vec<Point>,
) {
    points.clear();
    strongest.clear();
    let mut first = 0;
    for (v, (responses, orientations)) in rows.enumerate() {
        if v % CELL == 0 {
            first = strongest.len();
            strongest.resize(first + responses.len().div_ceil(CELL), (limit, [0; 2], 0));
        }
        for (u, (response, orientation)) in responses.iter().zip(orientations).enumerate() {
            let cell = &mut strongest[first + u / CELL];
            if *response > cell.0 {
                *cell = (*response, [u, v], *orientation);
            }
        }
    }
    strongest.retain(|(response, ..)| *response > limit);
    // The place decides between equals, so that the order is one and the same everywhere.
    strongest.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    points.extend(strongest.iter().take(MAX_POINTS).map(|(response, at, orientation)| {
        let angle_rad = orientation_rad(*orientation);
        Point {
            at_px: at.map(|c| 2.0 * c as f64 + 0.5),
            response: f64::from(*response),
            along: [libm::cos(angle_rad), libm::sin(angle_rad)],
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(width: usize, responses: &[f32], limit: f32) -> Vec<Point> {
        let orientations = vec![3; responses.len()];
        let (mut scratch, mut points) = (Vec::new(), Vec::new());
        let rows = responses.chunks(width).zip(orientations.chunks(width));
        pack(rows, limit, &mut scratch, &mut points);
        points
    }

    #[test]
    fn truth_every_cell_gives_its_strongest_pixel() {
        let mut responses = vec![0.0; 6 * 5];
        responses[6 + 1] = 10.0;
        responses[2 * 6 + 3] = 12.0;
        responses[4 * 6 + 5] = 11.0;
        responses[4] = 2.0;
        let points = packed(6, &responses, 5.0);
        let places: Vec<_> = points.iter().map(|p| p.at_px).collect();
        assert_eq!(places, [[6.5, 4.5], [10.5, 8.5]]);
        assert!((points[0].along[0] - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
    }

    #[test]
    fn there_are_never_more_than_the_bound() {
        let responses: Vec<f32> = (0..200 * 200).map(|k| 1.0 + (k % 97) as f32).collect();
        assert_eq!(packed(200, &responses, 0.5).len(), MAX_POINTS);
        assert!(packed(200, &responses, 1e3).is_empty());
    }
}
