//! Gaussian tables: the blur's taps and the weight about the tip.

use crate::region::Inside;
use crate::window::{Part, Window};

/// A weight beyond this many σ, exp(−4²/2) = 3·10⁻⁴, is taken for zero, and its pixel is left out.
const REACH_SIGMAS: f64 = 4.0;

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

/// Weights of a window's pixels: the product of [`axis_weights`] of both axes.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    pub window: Window,
    /// Where they are not zero.
    pub part: Part,
    whole: Vec<f32>,
    /// Those of the pixels inside the picture, and which these are.
    cut: Vec<f32>,
    cut_to: Inside,
    is_cut: bool,
}

impl Weights {
    /// Weights of a window of `side` pixels, σ `sigma_px`; uniform when that is zero.
    pub fn new(side: usize, sigma_px: f64) -> Self {
        let window = Window { side };
        let reach = REACH_SIGMAS * sigma_px;
        let first =
            if sigma_px == 0.0 { 0.0 } else { libm::ceil(window.half_px() - reach).max(0.0) } as usize;
        let part = Part { first, end: side - first };
        let axis = axis_weights(side, sigma_px);
        let mut whole = vec![0.0; window.len()];
        for (y, row) in whole.chunks_exact_mut(window.stride()).enumerate().take(part.end).skip(part.first) {
            for (x, weight) in row.iter_mut().enumerate().take(part.end).skip(part.first) {
                *weight = axis[x] * axis[y];
            }
        }
        let (cut, cut_to) = (vec![0.0; whole.len()], Inside { x: [0; 2], y: [0; 2] });
        Self { window, part, cut, cut_to, is_cut: false, whole }
    }

    /// Leaves out what lies outside of the picture, until the next call.
    pub fn cut(&mut self, inside: Inside) {
        self.is_cut = inside != Inside::all(self.window.side);
        if self.is_cut && inside != self.cut_to {
            self.cut_to = inside;
            self.cut.fill(0.0);
            let stride = self.window.stride();
            for y in inside.y[0]..inside.y[1] {
                let row = y * stride + inside.x[0]..y * stride + inside.x[1];
                self.cut[row.clone()].copy_from_slice(&self.whole[row]);
            }
        }
    }

    /// One weight for every value of the window.
    pub fn values(&self) -> &[f32] {
        if self.is_cut { &self.cut } else { &self.whole }
    }
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
    fn truth_weights_follow_the_bell_and_end_at_four_sigma() {
        let weights = Weights::new(61, 3.0);
        let at = |x: usize, y: usize| weights.values()[y * weights.window.stride() + x];
        assert_eq!(at(30, 30), 1.0);
        assert!((at(33, 30) - 0.606_530_7).abs() < 1e-6);
        assert!((at(33, 33) - 0.367_879_4).abs() < 1e-6);
        assert_eq!(weights.part, Part { first: 18, end: 43 });
        assert!(at(42, 30) > 0.0 && at(43, 30) == 0.0 && at(17, 30) == 0.0 && at(18, 30) > 0.0);
        let uniform = Weights::new(20, 0.0);
        assert_eq!(uniform.values().iter().sum::<f32>(), 400.0);
    }

    #[test]
    fn weights_outside_of_the_picture_are_zero() {
        let mut weights = Weights::new(20, 0.0);
        let inside = Inside { x: [4, 20], y: [0, 3] };
        for (inside, sum) in [(inside, 48.0), (Inside::all(20), 400.0), (inside, 48.0)] {
            weights.cut(inside);
            assert_eq!(weights.values().iter().sum::<f32>(), sum);
        }
        assert_eq!(weights.values()[3..5], [0.0, 1.0]);
    }
}
