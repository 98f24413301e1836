//! Speckle, and its way to grey levels.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::{HEIGHT, WIDTH};

/// The fresh speckle of an image is a random cut of one larger field.
pub const SPARE: usize = 64;

/// Rayleigh speckle of unit rms: a blurred complex Gaussian field (σ 2 px lateral, 1 px axial).
pub fn speckle(rng: &mut ChaCha8Rng, width: usize, height: usize) -> Vec<f32> {
    let mut part = || {
        let field: Vec<f32> = (0..width * height).map(|_| rng.sample(StandardNormal)).collect();
        blur(&field, width, height, 2.0, 1.0)
    };
    let (re, im) = (part(), part());
    let power: Vec<f32> = re.iter().zip(&im).map(|(a, b)| a * a + b * b).collect();
    let mean = power.iter().map(|p| f64::from(*p)).sum::<f64>() / power.len() as f64;
    power.iter().map(|p| (p / mean as f32).sqrt()).collect()
}

fn blur(field: &[f32], width: usize, height: usize, sigma_u: f64, sigma_v: f64) -> Vec<f32> {
    let taps = |sigma: f64| -> Vec<f32> {
        let radius = (4.0 * sigma) as i32;
        let raw: Vec<f64> =
            (-radius..=radius).map(|k| (-f64::from(k * k) / (2.0 * sigma * sigma)).exp()).collect();
        let sum: f64 = raw.iter().sum();
        raw.iter().map(|t| (t / sum) as f32).collect()
    };
    let (tu, tv) = (taps(sigma_u), taps(sigma_v));
    let mut rows = vec![0.0; field.len()];
    for v in 0..height {
        let line = &field[v * width..][..width];
        for (k, tap) in tu.iter().enumerate() {
            let shift = k as isize - (tu.len() / 2) as isize;
            for u in 0..width {
                rows[v * width + u] += tap * line[(u as isize + shift).rem_euclid(width as isize) as usize];
            }
        }
    }
    let mut out = vec![0.0; field.len()];
    for v in 0..height {
        for (k, tap) in tv.iter().enumerate() {
            let from =
                (v as isize + k as isize - (tv.len() / 2) as isize).rem_euclid(height as isize) as usize;
            for u in 0..width {
                out[v * width + u] += tap * rows[from * width + u];
            }
        }
    }
    out
}

pub fn decibel(amplitude: f32) -> f32 {
    20.0 * libm::log10f(amplitude.max(1e-6) / 8.0)
}

/// The grey level of a level in decibel below an amplitude of 8: 50 dB on 255 grey levels.
pub fn grey(db: f32) -> u8 {
    // A number added to 2²³ is rounded to a whole one, which then stands in the last bits. A cast looks for numbers that do
    // not fit, one pixel at a time.
    const WHOLE: f32 = 8_388_608.0;
    let level = ((db + 50.0) * (255.0 / 50.0)).clamp(0.0, 255.0);
    (level + WHOLE).to_bits() as u8
}

/// The fresh speckle's factors, in decibel: 1 + 8 % of (speckle − 1).
pub fn fresh_db(rng: &mut ChaCha8Rng) -> Vec<f32> {
    let field = speckle(rng, WIDTH + SPARE, HEIGHT + SPARE);
    field.iter().map(|s| 20.0 * libm::log10f(1.0 + 0.08 * (s - 1.0))).collect()
}
