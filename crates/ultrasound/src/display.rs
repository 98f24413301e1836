//! From the complex field to grey levels: noise, time-gain compensation, logarithm.

use sonoloop_types::{ProbeSpec, Slice};

use crate::{
    beam::{Beam, NEPER_PER_DB, amplitude_from_db, pulse_loss_np},
    fast::{exp_minus, power_db},
    instructions::wide,
    lattice::mix,
    paths::Paths,
    tape::gaussian_tape,
};

/// Samples of electronic noise that all pictures share, read at a hashed offset per row.
const NOISE_LENGTH: usize = 1 << 16;
/// Pixels that go through the steps together.
const PASS: usize = 64;
/// Ringing in the lens under a blind element: level over unit speckle, decay, width of a band. [assumed]
const RINGING_LEVEL_DB: f64 = 28.0;
const RINGING_DECAY_DB_M: f64 = 5.5e3;
const RINGING_SIGMA_M: f32 = 0.15e-3;
/// Ringing is below the noise beyond this depth.
const RINGING_DEPTH_M: f64 = 15e-3;

/// The receiver and the screen.
pub struct Display {
    seed: u64,
    noise: [Vec<f32>; 2],
    /// Noise rms over unit speckle.
    noise_amplitude: f32,
    /// One-way loss that is compensated, neper per metre, and the variance of the pulse's relative spectrum.
    tgc_np_m: f64,
    spread: f32,
    /// Gain by depth, evenly from the face to the bottom.
    sliders_db: Vec<f64>,
    deepest_m: f64,
    /// Grey level of 0 dB over unit speckle, and levels per dB.
    white_db: f32,
    grey_per_db: f32,
}

/// The settings of one picture.
#[derive(Debug, Clone, Copy)]
pub struct Exposure {
    sequence: u64,
    gain_db: f64,
    /// Noise over the probe's own.
    noise_gain: f32,
    spacing_m: f64,
}

impl Exposure {
    /// The settings that a slice asks for; what is no number changes nothing.
    pub fn new(slice: &Slice, spacing_m: f64) -> Self {
        let sound = |db: f64| if db.is_finite() { db.clamp(-200.0, 200.0) } else { 0.0 };
        Self {
            sequence: slice.sequence,
            gain_db: sound(slice.gain_db),
            noise_gain: amplitude_from_db(sound(slice.noise_gain_db)) as f32,
            spacing_m,
        }
    }
}

impl Display {
    pub fn new(beam: &Beam, probe: &ProbeSpec, seed: u64) -> Self {
        let noise = gaussian_tape(seed, 2, NOISE_LENGTH);
        Self {
            seed: mix(seed ^ 0x6e6f_6973_6500_0000),
            noise: [0, 1].map(|part| noise.iter().map(|v| v[part]).collect()),
            noise_amplitude: if probe.effects.noise {
                amplitude_from_db(probe.noise_level_db) as f32
            } else {
                0.0
            },
            tgc_np_m: 100.0 * probe.tgc_db_cm_mhz * probe.centre_frequency_hz * 1e-6 * NEPER_PER_DB,
            spread: if probe.effects.downshift { beam.relative_spread_squared() } else { 0.0 },
            sliders_db: probe.tgc_sliders_db.clone(),
            deepest_m: probe.geometry.height_px as f64 * probe.geometry.spacing_m,
            white_db: probe.speckle_level_db as f32,
            grey_per_db: (255.0 / probe.dynamic_range_db) as f32,
        }
    }

    /// Two-way gain at a depth: what the assumed attenuation takes from the pulse, and the sliders.
    fn compensation_db(&self, z_m: f64) -> f64 {
        let loss_np = pulse_loss_np((self.tgc_np_m * z_m) as f32, self.spread);
        let loss_db = 2.0 * f64::from(loss_np) / NEPER_PER_DB;
        let Some(last) = self.sliders_db.len().checked_sub(1) else { return loss_db };
        let place = (z_m / self.deepest_m).clamp(0.0, 1.0) * last as f64;
        let below = (place as usize + 1).min(last);
        let above = self.sliders_db[place as usize];
        loss_db + above + (self.sliders_db[below] - above) * (place - place.floor())
    }
}

wide! {
    /// Grey levels of one display row from its field before losses.
    pub fn draw_row(
        display: &Display,
        exposure: &Exposure,
        paths: &Paths,
        row: usize,
        field: (&[f32], &[f32]),
        pixels: &mut [u8],
    ) {
        let columns = pixels.len();
        let z_m = row as f64 * exposure.spacing_m;
        let hash = mix(display.seed ^ mix(exposure.sequence ^ mix(row as u64)));
        let first = (hash % (NOISE_LENGTH - columns.min(NOISE_LENGTH)) as u64) as usize;
        let level_db = (display.compensation_db(z_m) + exposure.gain_db) as f32 - display.white_db;
        let noise_amplitude = display.noise_amplitude * exposure.noise_gain;
        let contact = &paths.contact;
        let ringing = if contact.any_blind { ringing_level(z_m) } else { 0.0 };
        let (above, below, share) = paths.row(row);
        let noise = display.noise.each_ref().map(|part| &part[first..]);
        // In short passes over a few pixels: the logarithm is one long chain, and several must be under way.
        for (pass, pixels) in pixels.chunks_mut(PASS).enumerate() {
            let here = pass * PASS..pass * PASS + pixels.len();
            let mut level = [0.0f32; PASS];
            let (re, im) = (&field.0[here.clone()], &field.1[here.clone()]);
            let (above, below) = (&above[here.clone()], &below[here.clone()]);
            let noise = noise.map(|part| &part[here.clone()]);
            let mut ring = [0.0f32; PASS];
            if ringing > 0.0 {
                let (blind, shift_m) = (&contact.blind[here.clone()], &contact.ringing_shift_m[here.clone()]);
                let lenses = blind.iter().zip(shift_m).zip(&contact.band_spacing_m[here.clone()]);
                for (ring, ((blind, shift_m), spacing_m)) in ring.iter_mut().zip(lenses) {
                    *ring = ringing * blind * band(z_m as f32 - shift_m, *spacing_m);
                }
            }
            for (x, level) in level.iter_mut().enumerate().take(pixels.len()) {
                let a = above[x] + share * (below[x] - above[x]);
                let r = re[x] * a + noise[0][x] * noise_amplitude + ring[x];
                let i = im[x] * a + noise[1][x] * noise_amplitude;
                *level = r * r + i * i;
            }
            for level in &mut level {
                *level = power_db(*level);
            }
            for (pixel, level) in pixels.iter_mut().zip(&level) {
                let grey = 255.0 + display.grey_per_db * (level_db + level);
                // Adding 2²³ rounds to the nearest whole number and leaves it in the low bits.
                *pixel = (grey.clamp(0.0, 255.0) + 8_388_608.0).to_bits() as u8;
            }
        }
    }
}

/// Amplitude of the ringing at a depth; real, as the lens does not move.
fn ringing_level(z_m: f64) -> f32 {
    if z_m > RINGING_DEPTH_M {
        return 0.0;
    }
    amplitude_from_db(RINGING_LEVEL_DB - RINGING_DECAY_DB_M * z_m) as f32
}

/// Its bands: one per passage through the lens and the gel on it.
#[inline(always)]
fn band(z_m: f32, spacing_m: f32) -> f32 {
    // Adding 1.5·2²³ rounds to the nearest whole number.
    const WHOLE: f32 = 12_582_912.0;
    let from_band_m = z_m - ((z_m / spacing_m + WHOLE) - WHOLE) * spacing_m;
    let u = from_band_m / RINGING_SIGMA_M;
    0.15 + 0.85 * exp_minus(0.5 * u * u)
}
