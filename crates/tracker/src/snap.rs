//! A click, moved onto the echo it was meant for.

use sonoloop_types::Image;

/// Blur under which the echo is one peak, σ in pixels.
const SIGMA_PX: f64 = 1.5;
/// Taps of that blur to either side.
const TAPS: i32 = 4;

/// The brightest place of the blurred image within `radius_px` of a click, to a fraction of a pixel.
///
/// An operator clicks a pixel or two beside the tip; a template cut there carries the tip off its centre, where the
/// narrow weight hardly sees it. The click comes back unchanged where there is no peak (a flat or empty image, a peak
/// on the rim of the search: then it belongs to something else).
pub fn snap_to_peak(image: &Image, click_px: [f64; 2], radius_px: f64) -> [f64; 2] {
    if !(click_px[0].is_finite() && click_px[1].is_finite() && (0.0..=32.0).contains(&radius_px)) {
        return click_px;
    }
    let (u0, v0) = (click_px[0].round(), click_px[1].round());
    if u0.abs() > 1e6 || v0.abs() > 1e6 {
        return click_px;
    }
    let (u0, v0, reach) = (u0 as i32, v0 as i32, radius_px.ceil() as i32 + 1);
    let mut best = (f64::NEG_INFINITY, u0, v0);
    for v in v0 - reach..=v0 + reach {
        for u in u0 - reach..=u0 + reach {
            let (du, dv) = (f64::from(u) - click_px[0], f64::from(v) - click_px[1]);
            let level = blurred(image, u, v);
            if du * du + dv * dv <= radius_px * radius_px && level > best.0 {
                best = (level, u, v);
            }
        }
    }
    let (level, u, v) = best;
    let vertex = |before: f64, after: f64| {
        let curvature = before - 2.0 * level + after;
        (before < level && after < level).then(|| 0.5 * (before - after) / curvature)
    };
    let along_u = vertex(blurred(image, u - 1, v), blurred(image, u + 1, v));
    let along_v = vertex(blurred(image, u, v - 1), blurred(image, u, v + 1));
    match (along_u, along_v) {
        (Some(du), Some(dv)) => [f64::from(u) + du, f64::from(v) + dv],
        _ => click_px,
    }
}

/// Gaussian mean about a pixel; pixels outside the image count as black.
fn blurred(image: &Image, u: i32, v: i32) -> f64 {
    let mut sum = 0.0;
    for dv in -TAPS..=TAPS {
        for du in -TAPS..=TAPS {
            let (x, y) = (u + du, v + dv);
            let inside = x >= 0 && y >= 0 && (x as u32) < image.width_px && (y as u32) < image.height_px;
            if inside {
                let weight = libm::exp(-f64::from(du * du + dv * dv) / (2.0 * SIGMA_PX * SIGMA_PX));
                sum += weight * f64::from(image.row(y as u32)[x as usize]);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(centre_px: [f64; 2]) -> Image {
        let mut image = Image::black(64, 64);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let (u, v) = ((index % 64) as f64 - centre_px[0], (index / 64) as f64 - centre_px[1]);
            *pixel = (40.0 + 200.0 * libm::exp(-(u * u + v * v) / 8.0)) as u8;
        }
        image
    }

    #[test]
    fn truth_a_click_two_pixels_off_lands_on_the_blob() {
        for centre in [[30.0, 30.0], [30.4, 29.7], [31.5, 30.5]] {
            let snapped = snap_to_peak(&blob(centre), [centre[0] + 1.5, centre[1] - 1.5], 3.0);
            let error = ((snapped[0] - centre[0]).powi(2) + (snapped[1] - centre[1]).powi(2)).sqrt();
            assert!(error < 0.1, "{snapped:?} for {centre:?}");
        }
    }

    #[test]
    fn where_there_is_no_peak_the_click_stays() {
        let flat = Image::from_pixels(32, 32, vec![90; 1024]).unwrap();
        for click in [[16.0, 16.0], [-5.0, 3.0], [f64::NAN, 1.0], [1e9, 1e9]] {
            let same = snap_to_peak(&flat, click, 3.0);
            assert!(same == click || click[0].is_nan() && same[0].is_nan());
        }
        // A blob beyond the radius is somebody else's.
        assert_eq!(snap_to_peak(&blob([30.0, 30.0]), [38.0, 30.0], 3.0), [38.0, 30.0]);
    }
}
