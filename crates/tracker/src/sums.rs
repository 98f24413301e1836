//! The sums of one Gauss–Newton iteration over a window: vectors of eight pixels, column of vectors by column.

use sonoloop_simd::wide;

use crate::warp::Moments;
use crate::window::{LANES, Lanes, Part, Window, lanes, total};

/// What an iteration compares: patch P under weights with the reference T̂.
pub(crate) struct Comparison<'a> {
    pub window: Window,
    pub part: Part,
    /// Weights of the window; zero outside of the part and of the picture.
    pub weights: &'a [f32],
    /// P, padded.
    pub patch: &'a [f32],
    /// T̂, padded, and its gradient.
    pub padded: &'a [f32],
    pub grad_u: &'a [f32],
    pub grad_v: &'a [f32],
    /// Added to the reference's grey levels: the change of the whole image.
    pub change: f32,
    /// Share of the reference's gradient in the mean gradient g: ½ or 0.
    pub share: f32,
}

/// What eight pixels add: w, g_u, g_v and e.
struct Pixels {
    weight: Lanes,
    gu: Lanes,
    gv: Lanes,
    e: Lanes,
}

impl Comparison<'_> {
    /// The pixels of row y of the window from column x on.
    #[inline(always)]
    fn pixels(&self, x: usize, y: usize) -> Pixels {
        let (plain, padded) = (y * self.window.stride() + x, y * self.window.padded_stride() + x);
        let next = self.window.padded_stride();
        let weight = *lanes(self.weights, plain);
        let (grad_u, grad_v) = (lanes(self.grad_u, plain), lanes(self.grad_v, plain));
        let (above, below) = (lanes(self.patch, padded + 1), lanes(self.patch, padded + 2 * next + 1));
        let here = padded + next;
        let (left, middle, right) =
            (lanes(self.patch, here), lanes(self.patch, here + 1), lanes(self.patch, here + 2));
        let wanted = lanes(self.padded, here + 1);
        let own = (1.0 - self.share) * 0.5;
        let mut pixels = Pixels { weight, gu: [0.0; LANES], gv: [0.0; LANES], e: [0.0; LANES] };
        for k in 0..LANES {
            pixels.gu[k] = own * (right[k] - left[k]) + self.share * grad_u[k];
            pixels.gv[k] = own * (below[k] - above[k]) + self.share * grad_v[k];
            pixels.e[k] = middle[k] - (wanted[k] + self.change);
        }
        pixels
    }
}

wide! {
    /// Σ w·[1, g_u², g_u·g_v, g_v², e·g_u, e·g_v]: all that a translation needs.
    pub(crate) fn translation_sums(of: &Comparison) -> [f64; 6] {
        let mut sums = [[0.0_f32; LANES]; 6];
        for x in of.part.vectors() {
            for y in of.part.first..of.part.end {
                let Pixels { weight, gu, gv, e } = of.pixels(x, y);
                for k in 0..LANES {
                    let (wu, wv) = (weight[k] * gu[k], weight[k] * gv[k]);
                    sums[0][k] += weight[k];
                    sums[1][k] += wu * gu[k];
                    sums[2][k] += wu * gv[k];
                    sums[3][k] += wv * gv[k];
                    sums[4][k] += wu * e[k];
                    sums[5][k] += wv * e[k];
                }
            }
        }
        sums.map(|lanes| total(&lanes))
    }
}

/// Sums of one column of vectors: w, w·e²; for 1, y, y² those with g_u², g_u·g_v, g_v²; for 1, y those with e·g_u, e·g_v.
const COLUMN_SUMS: usize = 2 + 9 + 4;

wide! {
    /// The sums that an affine warp needs.
    ///
    /// A vector's x are the same in every row: each column of vectors is summed over 1, y and y², and then weighted with x,
    /// fifteen sums per pixel instead of the twenty-seven of H and b.
    pub(crate) fn affine_sums(of: &Comparison) -> Moments {
        let half = of.window.half_px() as f32;
        // For [1, x, y, x², xy, y²] and for [1, x, y].
        let mut gradients = [[[0.0_f32; LANES]; 3]; 6];
        let mut residuals = [[[0.0_f32; LANES]; 2]; 3];
        let mut plain = [[0.0_f32; LANES]; 2];
        for first in of.part.vectors() {
            let mut sums = [[0.0_f32; LANES]; COLUMN_SUMS];
            for row in of.part.first..of.part.end {
                let y = (row as f32 - half) / half;
                let Pixels { weight, gu, gv, e } = of.pixels(first, row);
                for k in 0..LANES {
                    let (wu, wv) = (weight[k] * gu[k], weight[k] * gv[k]);
                    let products = [wu * gu[k], wu * gv[k], wv * gv[k], wu * e[k], wv * e[k]];
                    sums[0][k] += weight[k];
                    sums[1][k] += weight[k] * e[k] * e[k];
                    for i in 0..3 {
                        sums[2 + i][k] += products[i];
                        sums[5 + i][k] += y * products[i];
                        sums[8 + i][k] += y * y * products[i];
                    }
                    for i in 0..2 {
                        sums[11 + i][k] += products[3 + i];
                        sums[13 + i][k] += y * products[3 + i];
                    }
                }
            }
            for k in 0..LANES {
                let x = ((first + k) as f32 - half) / half;
                plain[0][k] += sums[0][k];
                plain[1][k] += sums[1][k];
                for i in 0..3 {
                    let [one, y, yy] = [sums[2 + i][k], sums[5 + i][k], sums[8 + i][k]];
                    for (sum, term) in gradients.iter_mut().zip([one, x * one, y, x * x * one, x * y, yy]) {
                        sum[i][k] += term;
                    }
                }
                for i in 0..2 {
                    let [one, y] = [sums[11 + i][k], sums[13 + i][k]];
                    for (sum, term) in residuals.iter_mut().zip([one, x * one, y]) {
                        sum[i][k] += term;
                    }
                }
            }
        }
        Moments {
            gradients: gradients.map(|sums| sums.map(|lanes| total(&lanes))),
            residuals: residuals.map(|sums| sums.map(|lanes| total(&lanes))),
            weight: total(&plain[0]),
            squares: total(&plain[1]),
        }
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_simd::Instructions;

    use super::*;
    use crate::gaussian::Weights;
    use crate::template::Template;

    /// The sums written out pixel by pixel in double precision.
    fn slow(weights: &Weights, patch: &[f32], template: &[f32], change: f64, share: f64) -> Moments {
        let mut sums = Moments::default();
        let side = weights.window.side;
        let half = (side as f64 - 1.0) / 2.0;
        let at = |pixels: &[f32], x: usize, y: usize| f64::from(pixels[y * (side + 2) + x]);
        for k in 0..side {
            for i in 0..side {
                let (x, y) = ((i as f64 - half) / half, (k as f64 - half) / half);
                let gradient = |pixels: &[f32]| {
                    [
                        0.5 * (at(pixels, i + 2, k + 1) - at(pixels, i, k + 1)),
                        0.5 * (at(pixels, i + 1, k + 2) - at(pixels, i + 1, k)),
                    ]
                };
                let (own, its) = (gradient(patch), gradient(template));
                let g = [0, 1].map(|axis| (1.0 - share) * own[axis] + share * its[axis]);
                let e = at(patch, i + 1, k + 1) - at(template, i + 1, k + 1) - change;
                let w = f64::from(weights.values()[k * weights.window.stride() + i]);
                sums.weight += w;
                sums.squares += w * e * e;
                for (sum, phi) in sums.gradients.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum = [
                        sum[0] + w * phi * g[0] * g[0],
                        sum[1] + w * phi * g[0] * g[1],
                        sum[2] + w * phi * g[1] * g[1],
                    ];
                }
                for (sum, phi) in sums.residuals.iter_mut().zip([1.0, x, y]) {
                    *sum = [sum[0] + w * phi * e * g[0], sum[1] + w * phi * e * g[1]];
                }
            }
        }
        sums
    }

    fn noise(side: usize, seed: u32) -> Vec<f32> {
        let mut x = seed;
        (0..(side + 2) * (side + 2))
            .map(|_| {
                x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (x >> 24) as f32
            })
            .collect()
    }

    #[test]
    fn truth_sums_are_those_of_every_pixel_whatever_the_instructions() {
        for (side, sigma_px) in [(11, 3.0), (20, 0.0), (61, 3.0), (64, 0.0)] {
            let (patch, template) = (noise(side, 1), noise(side, 2));
            let weights = Weights::new(side, sigma_px);
            let [p, t] = [&patch, &template].map(|pixels| Template::from_pixels(side, pixels, None));
            let comparison = Comparison {
                window: weights.window,
                part: weights.part,
                weights: weights.values(),
                patch: &p.padded,
                padded: &t.padded,
                grad_u: &t.grad_u,
                grad_v: &t.grad_v,
                change: 3.0,
                share: 0.5,
            };
            let exact = slow(&weights, &patch, &template, 3.0, 0.5);
            let close = |a: f64, b: f64| (a - b).abs() <= 1e-5 * (exact.squares + exact.gradients[0][0]);
            let all = Instructions::available();
            let sums = all.iter().map(|set| affine_sums(*set, &comparison)).collect::<Vec<_>>();
            let moved = all.iter().map(|set| translation_sums(*set, &comparison)).collect::<Vec<_>>();
            assert!(
                sums.iter().all(|other| *other == sums[0]) && moved.iter().all(|other| *other == moved[0])
            );
            assert!(close(sums[0].weight, exact.weight) && close(sums[0].squares, exact.squares));
            for (a, b) in sums[0].gradients.as_flattened().iter().zip(exact.gradients.as_flattened()) {
                assert!(close(*a, *b), "{a} {b}");
            }
            for (a, b) in sums[0].residuals.as_flattened().iter().zip(exact.residuals.as_flattened()) {
                assert!(close(*a, *b), "{a} {b}");
            }
            let [uu, uv, vv] = exact.gradients[0];
            let [eu, ev] = exact.residuals[0];
            for (a, b) in moved[0].iter().zip([exact.weight, uu, uv, vv, eu, ev]) {
                assert!(close(*a, b), "{a} {b}");
            }
        }
    }
}
