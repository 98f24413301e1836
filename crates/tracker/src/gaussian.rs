//! Gaussian tables: the blur's taps and the weight about the tip.

/// Taps of a Gaussian blur, normalised to a sum of one; a single tap when `sigma_px` is zero.
///
/// Cut at 3σ, where the taps have fallen to 1 % of the middle.
pub(crate) fn blur_taps(sigma_px: f64) -> Vec<f32> {
    let radius = libm::ceil(3.0 * sigma_px) as i32;
    let raw: Vec<f64> = (-radius..=radius).map(|k| bell(k.into(), sigma_px)).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|tap| (tap / sum) as f32).collect()
}

/// Weights along one axis of a window of `side` pixels, about its middle; all one when `sigma_px` is zero.
pub(crate) fn axis_weights(side: usize, sigma_px: f64) -> Vec<f32> {
    let middle = (side as f64 - 1.0) / 2.0;
    (0..side).map(|k| if sigma_px == 0.0 { 1.0 } else { bell(k as f64 - middle, sigma_px) as f32 }).collect()
}

/// Weights of a square window, row by row: the product of [`axis_weights`] of both axes.
pub(crate) fn window_weights(side: usize, sigma_px: f64) -> Vec<f32> {
    let axis = axis_weights(side, sigma_px);
    axis.iter().flat_map(|y| axis.iter().map(move |x| x * y)).collect()
}

fn bell(distance_px: f64, sigma_px: f64) -> f64 {
    if sigma_px == 0.0 {
        return if distance_px == 0.0 { 1.0 } else { 0.0 };
    }
    libm::exp(-distance_px * distance_px / (2.0 * sigma_px * sigma_px))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_sum_to_one_and_mirror() {
        for sigma_px in [0.0, 0.75, 1.5, 4.0] {
            let taps = blur_taps(sigma_px);
            assert_eq!(taps.len() % 2, 1);
            assert!((taps.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert!(taps.iter().zip(taps.iter().rev()).all(|(a, b)| a == b));
        }
        assert_eq!(blur_taps(0.0), [1.0]);
    }

    #[test]
    fn truth_weights_follow_the_bell() {
        let weights = window_weights(21, 3.0);
        assert_eq!(weights[10 * 21 + 10], 1.0);
        assert!((weights[10 * 21 + 13] - 0.606_530_7).abs() < 1e-6);
        assert!((weights[13 * 21 + 13] - 0.367_879_4).abs() < 1e-6);
        assert!(window_weights(20, 0.0).iter().all(|w| *w == 1.0));
    }
}
