//! How alike two patches are: weighted correlation and brightness ratio.

use sonoloop_simd::{Instructions, wide};

use crate::window::{LANES, Part, Window, lanes, total};

/// Contrast (weighted variance, grey levels squared) below which a patch counts as flat.
const FLAT: f64 = 1e-3;
/// Largest gain in contrast that still counts as the same target.
const MAX_GAIN: f64 = 2.0;

/// Weighted sums over the part of the window that lies inside the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    /// Weighted mean of the first patch.
    pub mean_a: f64,
    /// Weighted mean of the second patch.
    pub mean_b: f64,
    /// Weighted variance of the first patch.
    pub var_a: f64,
    /// Weighted variance of the second patch.
    pub var_b: f64,
    /// Weighted covariance.
    pub cov: f64,
}

impl Moments {
    /// Of two padded patches under weights that are zero outside of `part`; `None` when no weight is left.
    pub fn of(
        instructions: Instructions,
        window: Window,
        part: Part,
        weights: &[f32],
        a: &[f32],
        b: &[f32],
    ) -> Option<Self> {
        let [weight, sum_a, sum_b] = sums(instructions, window, part, weights, a, b);
        if weight <= 0.0 {
            return None;
        }
        let (mean_a, mean_b) = (sum_a / weight, sum_b / weight);
        let means = [mean_a as f32, mean_b as f32];
        let [var_a, var_b, cov] =
            squares(instructions, window, part, weights, a, b, means).map(|s| s / weight);
        Some(Self { mean_a, mean_b, var_a, var_b, cov })
    }

    /// Normalised cross-correlation, −1 (inverted) … 0 (unrelated) … 1; `None` when a patch is flat.
    pub fn ncc(&self) -> Option<f64> {
        (self.var_a > FLAT && self.var_b > FLAT)
            .then(|| (self.cov / (self.var_a * self.var_b).sqrt()).clamp(-1.0, 1.0))
    }

    /// rms of a − Δ − b over the contrast of b; 0 = the same, 1 = as far off as a flat patch.
    ///
    /// Correlation ignores contrast; this does not, so a needle that fades is told from the speckle that takes
    /// its place. Only fading counts: where the patch is the *more* contrasted one (a tip that comes into focus), b
    /// is first stretched by the regression's gain g, 1 ≤ g ≤ 2, about `ground`, the grey level of its surroundings; and
    /// where the patch is brighter on the whole (a tip in a brighter layer), that does not count either.
    /// `None` when b is flat.
    pub fn brightness_ratio(&self, change: f64, ground: f64) -> Option<f64> {
        if self.var_b <= FLAT {
            return None;
        }
        let gain = (self.cov / self.var_b).clamp(1.0, MAX_GAIN);
        let offset = (self.mean_a - change - ground - gain * (self.mean_b - ground)).min(0.0);
        let mean_square = self.var_a + gain * gain * self.var_b - 2.0 * gain * self.cov + offset * offset;
        Some((mean_square.max(0.0) / self.var_b).sqrt() / gain)
    }

    /// How much of b's contrast the first patch has: 1 = all, 0 = none of it; `None` when b is flat.
    ///
    /// The least-squares factor g in a ≈ g·b + constant. Speckle that happens to have the template's shape has little of
    /// its height, and a brighter or darker surrounding does not count.
    pub fn presence(&self) -> Option<f64> {
        (self.var_b > FLAT).then(|| self.cov / self.var_b)
    }

    /// Whether the second patch is too flat to be looked for.
    pub fn b_is_flat(&self) -> bool {
        self.var_b <= FLAT
    }
}

wide! {
    /// Σ w·[1, a, b].
    fn sums(window: Window, part: Part, weights: &[f32], a: &[f32], b: &[f32]) -> [f64; 3] {
        let mut sums = [[0.0_f32; LANES]; 3];
        for y in part.first..part.end {
            for x in part.vectors() {
                let weight = lanes(weights, y * window.stride() + x);
                let at = (y + 1) * window.padded_stride() + x + 1;
                let (a, b) = (lanes(a, at), lanes(b, at));
                for k in 0..LANES {
                    sums[0][k] += weight[k];
                    sums[1][k] += weight[k] * a[k];
                    sums[2][k] += weight[k] * b[k];
                }
            }
        }
        sums.map(|lanes| total(&lanes))
    }
}

wide! {
    /// Σ w·[a², b², a·b] about means.
    fn squares(
        window: Window,
        part: Part,
        weights: &[f32],
        a: &[f32],
        b: &[f32],
        means: [f32; 2],
    ) -> [f64; 3] {
        let mut sums = [[0.0_f32; LANES]; 3];
        for y in part.first..part.end {
            for x in part.vectors() {
                let weight = lanes(weights, y * window.stride() + x);
                let at = (y + 1) * window.padded_stride() + x + 1;
                let (a, b) = (lanes(a, at), lanes(b, at));
                for k in 0..LANES {
                    let (a, b) = (a[k] - means[0], b[k] - means[1]);
                    sums[0][k] += weight[k] * a * a;
                    sums[1][k] += weight[k] * b * b;
                    sums[2][k] += weight[k] * a * b;
                }
            }
        }
        sums.map(|lanes| total(&lanes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::Weights;
    use crate::template::Template;

    const SIDE: usize = 20;

    fn texture(seed: u32) -> Vec<f32> {
        let mut x = seed;
        (0..(SIDE + 2) * (SIDE + 2))
            .map(|_| {
                x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (x >> 24) as f32
            })
            .collect()
    }

    fn moments(a: &[f32], b: &[f32], sigma_px: f64) -> Moments {
        let weights = Weights::new(SIDE, sigma_px);
        let [a, b] = [a, b].map(|pixels| Template::from_pixels(SIDE, pixels, None).padded);
        let of = |set| Moments::of(set, weights.window, weights.part, weights.values(), &a, &b).unwrap();
        let [plain, widest] = [Instructions::PLAIN, Instructions::widest()].map(of);
        assert_eq!(plain, widest);
        plain
    }

    #[test]
    fn truth_ncc_is_one_under_an_affine_grey_change_and_minus_one_inverted() {
        let b = texture(1);
        let brighter: Vec<f32> = b.iter().map(|g| 0.4 * g + 31.0).collect();
        let inverted: Vec<f32> = b.iter().map(|g| 255.0 - g).collect();
        for sigma_px in [0.0, 3.0] {
            assert!((moments(&brighter, &b, sigma_px).ncc().unwrap() - 1.0).abs() < 1e-6);
            assert!((moments(&inverted, &b, sigma_px).ncc().unwrap() + 1.0).abs() < 1e-6);
        }
        // Unrelated: the standard error of a correlation over 400 pixels is 0.05.
        assert!(moments(&texture(2), &b, 0.0).ncc().unwrap().abs() < 0.2);
        assert_eq!(moments(&vec![7.0; b.len()], &b, 3.0).ncc(), None);
    }

    #[test]
    fn truth_ncc_of_two_waves_is_the_cosine_of_their_phase() {
        // Whole periods (20 px) under uniform weight: the correlation of cos x and cos(x + φ) is cos φ.
        let wave = |phase: f64| -> Vec<f32> {
            let at =
                |x: usize| (100.0 + 50.0 * libm::cos(std::f64::consts::TAU * x as f64 / 20.0 + phase)) as f32;
            (0..SIDE + 2).flat_map(|_| (0..SIDE + 2).map(at)).collect()
        };
        for phase in [0.3, 1.0, 2.0, 3.0] {
            let ncc = moments(&wave(phase), &wave(0.0), 0.0).ncc().unwrap();
            assert!((ncc - libm::cos(phase)).abs() < 1e-5, "{phase}: {ncc}");
        }
    }

    #[test]
    fn truth_brightness_ratio_knows_contrast_and_forgives_the_change_of_the_whole_image() {
        let b = texture(3);
        let b_mean = moments(&b, &b, 3.0).mean_b as f32;
        let offset: Vec<f32> = b.iter().map(|g| g + 12.0).collect();
        let faded: Vec<f32> = b.iter().map(|g| b_mean + 0.3 * (g - b_mean)).collect();
        assert!(moments(&offset, &b, 3.0).brightness_ratio(12.0, 60.0).unwrap() < 1e-3);
        // A brighter surrounding takes nothing away; a darker patch has lost something.
        assert!(moments(&offset, &b, 3.0).brightness_ratio(0.0, 60.0).unwrap() < 1e-3);
        let m = moments(&b.iter().map(|g| g - 12.0).collect::<Vec<_>>(), &b, 3.0);
        assert!((m.brightness_ratio(0.0, 60.0).unwrap() - 12.0 / m.var_b.sqrt()).abs() < 1e-3);
        // rms of (0.3 − 1)(b − mean) over the contrast of b is 0.7.
        assert!((moments(&faded, &b, 3.0).brightness_ratio(0.0, 60.0).unwrap() - 0.7).abs() < 1e-3);
        assert!((moments(&faded, &b, 3.0).ncc().unwrap() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn truth_presence_is_the_share_of_the_contrast_that_is_left() {
        let b = texture(5);
        let faded: Vec<f32> = b.iter().map(|g| 60.0 + 0.4 * (g - 60.0) + 7.0).collect();
        assert!((moments(&faded, &b, 3.0).presence().unwrap() - 0.4).abs() < 1e-4);
    }

    #[test]
    fn truth_more_contrast_about_the_ground_is_not_fading() {
        let b = texture(4);
        let ground = 60.0_f32;
        let focused: Vec<f32> = b.iter().map(|g| ground + 1.6 * (g - ground)).collect();
        assert!(moments(&focused, &b, 3.0).brightness_ratio(0.0, 60.0).unwrap() < 1e-3);
        // Beyond the largest gain the rest of the contrast counts: (3 − 2)(b − mean) over twice the contrast of b.
        let other: Vec<f32> = b.iter().map(|g| ground + 3.0 * (g - ground)).collect();
        let m = moments(&other, &b, 3.0);
        assert!((m.brightness_ratio(0.0, 60.0).unwrap() - 0.5).abs() < 1e-3);
    }
}
