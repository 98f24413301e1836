use serde::{Deserialize, Serialize};

use crate::Point;

/// Which way the picture lies to the needle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// The needle lies in the picture: shaft and tip are seen.
    Lateral,
    /// The needle crosses the picture: one cross-section is seen.
    Transverse,
}

/// How pixels lie in the `probe` frame: u right along the array, v down with depth.
///
/// Square pixels; the column `(width_px − 1) / 2` is the middle of the array and row 0 lies on the
/// transducer's face.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImageGeometry {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Side of a pixel in metres.
    pub spacing_m: f64,
}

impl Default for ImageGeometry {
    /// 640×480 at 0.1 mm: 48 mm of depth, a 38.4 mm aperture in the middle 384 columns.
    fn default() -> Self {
        Self { width_px: 640, height_px: 480, spacing_m: 1e-4 }
    }
}

impl ImageGeometry {
    /// Column of the middle of the array, in pixels.
    pub fn centre_column_px(&self) -> f64 {
        f64::from(self.width_px - 1) / 2.0
    }

    /// Pixel (u, v) under which a point given in the probe frame is drawn; its elevation is dropped.
    pub fn px_from_probe(&self, point_in_probe: &Point) -> [f64; 2] {
        [point_in_probe.x / self.spacing_m + self.centre_column_px(), point_in_probe.z / self.spacing_m]
    }

    /// Point of the image plane (y = 0 in the probe frame) that pixel (u, v) shows, in metres.
    pub fn probe_from_px(&self, px: [f64; 2]) -> Point {
        Point::new((px[0] - self.centre_column_px()) * self.spacing_m, 0.0, px[1] * self.spacing_m)
    }

    /// True when pixel (u, v) lies inside the picture by at least `margin_px`.
    pub fn contains(&self, px: [f64; 2], margin_px: f64) -> bool {
        px[0] >= margin_px
            && px[1] >= margin_px
            && px[0] <= f64::from(self.width_px - 1) - margin_px
            && px[1] <= f64::from(self.height_px - 1) - margin_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_pixel_and_probe_coordinates_are_inverse() {
        let geometry = ImageGeometry::default();
        assert_eq!(geometry.px_from_probe(&Point::new(0.0, 3.0, 0.0)), [319.5, 0.0]);
        assert_eq!(geometry.px_from_probe(&Point::new(1e-3, 0.0, 2e-3)), [329.5, 20.0]);
        let back = geometry.probe_from_px([12.25, 400.5]);
        let [u, v] = geometry.px_from_probe(&back);
        assert!((u - 12.25).abs() < 1e-9 && (v - 400.5).abs() < 1e-9 && back.y == 0.0);
    }
}
