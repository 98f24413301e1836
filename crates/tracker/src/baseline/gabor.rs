//! A bank of even Gabor filters: how much each pixel looks like a part of a needle, and in which direction.
//!
//! The filter of orientation θ (of the ridge, from the u axis towards v) is, at (x, y) from its middle,
//!
//! ```text
//! h(x, y) = 2 g(x) g(y) [cos(k·(y cos θ − x sin θ)) − d],   g(x) ∝ exp(−x²/2σ²),   k = 2π/λ
//! ```
//!
//! where d makes its sum zero (Daugman 1985, without the elongated envelope). With a round envelope the cosine of
//! the sum splits: cos(a + b) = cos a cos b − sin a sin b, so two passes along rows and columns each serve θ and −θ
//! at once. A wave of amplitude A that fits the filter answers with about A.

use super::half::{Half, LANE, Lane};

/// Orientations in the bank, evenly over half a turn.
pub(crate) const ORIENTATIONS: usize = 12;
/// Wavelength λ in half-resolution pixels: its positive half is a ridge 6 px wide in the picture.
const WAVELENGTH: f64 = 6.0;
/// Envelope σ in half-resolution pixels: half the wavelength, so a little over one octave wide. A wave that is
/// turned by the bank's spacing δ = 15° is answered with exp(−½(kσδ)²) = 71 % of its amplitude.
const SIGMA: f64 = 3.0;
/// Taps to either side of the middle, 2.7 σ.
const RADIUS: usize = 8;
const TAPS: usize = 2 * RADIUS + 1;

/// Direction in which the ridge of a filter runs, from the u axis towards v, in [0, π).
pub(crate) fn orientation_rad(index: u8) -> f64 {
    f64::from(index) * std::f64::consts::PI / ORIENTATIONS as f64
}

/// One axis of a filter.
#[derive(Debug, Clone, Copy)]
struct Wave {
    cos: [f32; TAPS],
    sin: [f32; TAPS],
}

impl Wave {
    /// Gaussian of sum one, times the waves of `k` radians per pixel.
    fn new(k: f64) -> Self {
        let at = |tap: usize| tap as f64 - RADIUS as f64;
        let bell = |tap: usize| libm::exp(-at(tap) * at(tap) / (2.0 * SIGMA * SIGMA));
        let sum: f64 = (0..TAPS).map(bell).sum();
        Self {
            cos: std::array::from_fn(|tap| (bell(tap) / sum * libm::cos(k * at(tap))) as f32),
            sin: std::array::from_fn(|tap| (bell(tap) / sum * libm::sin(k * at(tap))) as f32),
        }
    }
}

/// The filters of one |θ|.
#[derive(Debug, Clone, Copy)]
struct Pair {
    along_u: Wave,
    along_v: Wave,
    /// Share d of the Gaussian mean that is taken off, so that the filter's sum is zero.
    mean: f32,
    /// Numbers of the orientations θ and −θ; the same one when they are one.
    indices: [u8; 2],
}

/// The bank with its scratch.
#[derive(Debug, Clone)]
pub(crate) struct Gabor {
    pairs: Vec<Pair>,
    blur: Wave,
    padded: Vec<f32>,
    rows_cos: Vec<Lane>,
    rows_sin: Vec<Lane>,
    mean: Vec<Lane>,
    response: Vec<Lane>,
    orientation: Vec<[u8; LANE]>,
    width: usize,
    stride: usize,
}

impl Gabor {
    pub fn new() -> Self {
        let k = std::f64::consts::TAU / WAVELENGTH;
        let pair = |index: usize| {
            let angle_rad = orientation_rad(index as u8);
            let along_u = Wave::new(k * libm::sin(angle_rad));
            let along_v = Wave::new(k * libm::cos(angle_rad));
            let mean = along_u.cos.iter().sum::<f32>() * along_v.cos.iter().sum::<f32>();
            Pair {
                along_u,
                along_v,
                mean,
                indices: [index as u8, ((ORIENTATIONS - index) % ORIENTATIONS) as u8],
            }
        };
        Self {
            pairs: (0..=ORIENTATIONS / 2).map(pair).collect(),
            blur: Wave::new(0.0),
            padded: Vec::new(),
            rows_cos: Vec::new(),
            rows_sin: Vec::new(),
            mean: Vec::new(),
            response: Vec::new(),
            orientation: Vec::new(),
            width: 0,
            stride: 0,
        }
    }

    /// Filters a picture; beyond its border its edge is repeated.
    pub fn run(&mut self, half: &Half) {
        self.width = half.width;
        let lanes = half.width.div_ceil(LANE);
        self.stride = lanes * LANE;
        for buffer in [&mut self.rows_cos, &mut self.rows_sin, &mut self.mean, &mut self.response] {
            buffer.clear();
            buffer.resize(lanes * half.height, [0.0; LANE]);
        }
        self.orientation.clear();
        self.orientation.resize(lanes * half.height, [0; LANE]);
        self.pad(half);

        let padded_stride = self.stride + TAPS - 1;
        along_rows(&self.padded, padded_stride, &self.blur.cos, &mut self.rows_cos, lanes);
        for v in 0..half.height {
            for lane in 0..lanes {
                self.mean[v * lanes + lane] =
                    along_column(&self.rows_cos, lanes, half.height, v, lane, &self.blur.cos);
            }
        }
        for pair in &self.pairs {
            along_rows(&self.padded, padded_stride, &pair.along_u.cos, &mut self.rows_cos, lanes);
            along_rows(&self.padded, padded_stride, &pair.along_u.sin, &mut self.rows_sin, lanes);
            for v in 0..half.height {
                for lane in 0..lanes {
                    let even = along_column(&self.rows_cos, lanes, half.height, v, lane, &pair.along_v.cos);
                    let odd = along_column(&self.rows_sin, lanes, half.height, v, lane, &pair.along_v.sin);
                    let at = v * lanes + lane;
                    let (mean, best) = (&self.mean[at], &mut self.response[at]);
                    let index = &mut self.orientation[at];
                    for i in 0..LANE {
                        let flat = even[i] - pair.mean * mean[i];
                        let turn = if odd[i] >= 0.0 { pair.indices[0] } else { pair.indices[1] };
                        let answer = 2.0 * (flat + odd[i].abs());
                        index[i] = if answer > best[i] { turn } else { index[i] };
                        best[i] = best[i].max(answer);
                    }
                }
            }
        }
    }

    /// Rows of (best response, number of its orientation); a response is never negative.
    pub fn rows(&self) -> impl Iterator<Item = (&[f32], &[u8])> + Clone {
        let responses = self.response.as_flattened().chunks_exact(self.stride.max(1));
        let orientations = self.orientation.as_flattened().chunks_exact(self.stride.max(1));
        responses.zip(orientations).map(|(r, o)| (&r[..self.width], &o[..self.width]))
    }

    /// The picture's rows with their first and last pixels repeated to either side.
    fn pad(&mut self, half: &Half) {
        self.padded.clear();
        for row in half.levels.chunks_exact(half.width.max(1)) {
            let (first, last) = (row[0], row[half.width - 1]);
            self.padded.extend(std::iter::repeat_n(first, RADIUS));
            self.padded.extend_from_slice(row);
            self.padded.extend(std::iter::repeat_n(last, self.stride - half.width + RADIUS));
        }
    }
}

fn along_rows(padded: &[f32], padded_stride: usize, taps: &[f32; TAPS], out: &mut [Lane], lanes: usize) {
    for (row, out) in padded.chunks_exact(padded_stride).zip(out.chunks_exact_mut(lanes)) {
        for (lane, out) in out.iter_mut().enumerate() {
            let mut sum = [0.0; LANE];
            for (k, tap) in taps.iter().enumerate() {
                for (sum, level) in sum.iter_mut().zip(&row[lane * LANE + k..][..LANE]) {
                    *sum += tap * level;
                }
            }
            *out = sum;
        }
    }
}

fn along_column(
    rows: &[Lane],
    lanes: usize,
    height: usize,
    v: usize,
    lane: usize,
    taps: &[f32; TAPS],
) -> Lane {
    let mut sum = [0.0; LANE];
    for (k, tap) in taps.iter().enumerate() {
        let row = (v + k).saturating_sub(RADIUS).min(height - 1);
        for (sum, level) in sum.iter_mut().zip(&rows[row * lanes + lane]) {
            *sum += tap * level;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 80;

    fn filtered(level: impl Fn(f64, f64) -> f64) -> Gabor {
        let levels = (0..SIDE * SIDE).map(|i| level((i % SIDE) as f64, (i / SIDE) as f64) as f32);
        let half = Half { width: SIDE, height: SIDE, levels: levels.collect() };
        let mut gabor = Gabor::new();
        gabor.run(&half);
        gabor
    }

    fn at(gabor: &Gabor, u: usize, v: usize) -> (f32, u8) {
        let (responses, orientations) = gabor.rows().nth(v).unwrap();
        (responses[u], orientations[u])
    }

    #[test]
    fn truth_a_constant_gives_nothing() {
        assert!(filtered(|_, _| 0.0).rows().all(|(r, _)| r.iter().all(|r| *r == 0.0)));
        // The sum of a filter is zero to the rounding of its f32 taps.
        let largest = filtered(|_, _| 255.0).rows().flat_map(|(r, _)| r.to_vec()).fold(0.0, f32::max);
        assert!(largest < 1e-3, "{largest}");
    }

    #[test]
    fn truth_a_fitting_wave_answers_with_its_amplitude() {
        let gabor = filtered(|_, v| 50.0 * libm::cos(std::f64::consts::TAU / WAVELENGTH * (v - 42.0)));
        let (response, orientation) = at(&gabor, 40, 42);
        assert!((response - 50.0).abs() < 1.0, "{response}");
        assert_eq!(orientation, 0);
    }

    #[test]
    fn truth_a_ridge_answers_at_its_middle_and_in_its_direction() {
        for angle_deg in [0.0, 11.0, 26.0, 45.0, 70.0, 90.0, 118.0, 135.0, 172.0] {
            let angle_rad = f64::to_radians(angle_deg);
            let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
            let gabor = filtered(|u, v| {
                let across = (v - 40.0) * cos - (u - 40.0) * sin;
                100.0 * libm::exp(-across * across / (2.0 * 1.2 * 1.2))
            });
            let (middle, orientation) = at(&gabor, 40, 40);
            let off = (orientation_rad(orientation) - angle_rad + std::f64::consts::FRAC_PI_2)
                .rem_euclid(std::f64::consts::PI)
                - std::f64::consts::FRAC_PI_2;
            assert!(off.abs() <= 7.6_f64.to_radians(), "{angle_deg}°: {} rad off", off);
            for step in [-3.0, 3.0] {
                let beside =
                    at(&gabor, (40.0 - step * sin).round() as usize, (40.0 + step * cos).round() as usize);
                assert!(beside.0 < 0.5 * middle, "{angle_deg}°: {} beside {middle}", beside.0);
            }
        }
    }
}
