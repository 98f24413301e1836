//! Where the tip should appear in the next picture, from measured depth and measured probe pose.
//!
//! Only differences since the last picture enter, so the hidden errors of the calibrations (millimetres and a
//! degree) cost a few hundredths of a pixel. The prediction is a first guess for the tracker, never a measurement.

use sonoloop_types::{ImageGeometry, Point, Pose, Vector, View};

/// Pixel motion of the tip between two pictures.
///
/// `tip_px` was seen from `base_from_probe_before`; since then the needle went `fed_m` along `axis_in_base` and
/// the probe moved to `base_from_probe_now`. Lateral: the moved tip is projected onto the new picture.
/// Transverse: the needle's line is cut with the new plane. `None` when the needle lies in the transverse plane.
pub fn motion_px(
    view: View,
    geometry: &ImageGeometry,
    axis_in_base: &Vector,
    tip_px: [f64; 2],
    base_from_probe_before: &Pose,
    base_from_probe_now: &Pose,
    fed_m: f64,
) -> Option<[f64; 2]> {
    let seen_in_base = base_from_probe_before * geometry.probe_from_px(tip_px);
    let probe_now_from_base = base_from_probe_now.inverse();
    let point_in_probe: Point = match view {
        View::Lateral => probe_now_from_base * (seen_in_base + axis_in_base * fed_m),
        View::Transverse => {
            let point = probe_now_from_base * seen_in_base;
            let axis = probe_now_from_base * axis_in_base;
            if axis.y.abs() < 0.1 {
                return None;
            }
            point - axis * (point.y / axis.y)
        }
    };
    let px = geometry.px_from_probe(&point_in_probe);
    Some([px[0] - tip_px[0], px[1] - tip_px[1]])
}

/// Direction in which the needle points in the picture, unit length; `None` when it stands (nearly) across the plane.
pub fn axis_px(axis_in_base: &Vector, base_from_probe: &Pose) -> Option<[f64; 2]> {
    let axis = base_from_probe.inverse() * axis_in_base;
    let length = (axis.x * axis.x + axis.z * axis.z).sqrt();
    (length > 0.5).then(|| [axis.x / length, axis.z / length])
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoloop_types::ImageGeometry;

    #[test]
    fn truth_lateral_feed_moves_the_tip_along_the_axis() {
        let geometry = ImageGeometry::default();
        let axis = Vector::new(0.6, 0.0, 0.8);
        let still = Pose::identity();
        let motion =
            motion_px(View::Lateral, &geometry, &axis, [300.0, 100.0], &still, &still, 1e-3).unwrap();
        assert!((motion[0] - 6.0).abs() < 1e-9 && (motion[1] - 8.0).abs() < 1e-9);
    }

    #[test]
    fn truth_transverse_plane_advance_moves_the_cut_along_the_slope() {
        let geometry = ImageGeometry::default();
        let axis = Vector::new(0.0, 0.8, 0.6);
        let before = Pose::identity();
        let now = Pose::translation(0.0, 2e-3, 0.0);
        let motion =
            motion_px(View::Transverse, &geometry, &axis, [320.0, 150.0], &before, &now, 0.0).unwrap();
        // 2 mm of plane advance on a slope of 0.6/0.8 is 1.5 mm of depth.
        assert!(motion[0].abs() < 1e-9 && (motion[1] - 15.0).abs() < 1e-9);
    }
}
