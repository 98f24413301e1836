//! Synthetic B-mode sequences with known tips: speckle, a bright needle, log compression.
//!
//! *Needle* scenes: the needle moves over speckle that stands still, the case in which trackers slide onto the
//! background. *Rigid* scenes: needle and speckle move together by a random walk. Amplitudes are in units of the
//! speckle's rms; fresh multiplicative speckle of 8 % goes over every image.
#![allow(dead_code, reason = "every test binary uses its own part")]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sonoloop_types::Image;

pub const WIDTH: usize = 640;
pub const HEIGHT: usize = 480;
/// The fresh speckle of an image is a random cut of one larger field.
const SPARE: usize = 64;
const NEEDLE_AMPLITUDE: f32 = 6.0;
/// Room that a rigid scene has to walk in.
const MARGIN: usize = 64;

/// Rayleigh speckle of unit rms: a blurred complex Gaussian field (σ 2 px lateral, 1 px axial).
fn speckle(rng: &mut ChaCha8Rng, width: usize, height: usize) -> Vec<f32> {
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

/// Envelope of a needle that comes along `angle_rad` (from the u axis towards v) and ends at the tip.
fn needle(u: f32, v: f32, tip: [f32; 2], cos: f32, sin: f32) -> f32 {
    let (du, dv) = (u - tip[0], v - tip[1]);
    let along = du * cos + dv * sin;
    let across = dv * cos - du * sin;
    if across.abs() > 10.0 || along > 16.0 {
        return 0.0;
    }
    let shaft = 0.55 * (-across * across / (2.0 * 1.6 * 1.6)).exp() / (1.0 + (along / 1.2).exp());
    let bead =
        (-((along + 2.0) * (along + 2.0) / (2.0 * 3.0 * 3.0) + across * across / (2.0 * 2.2 * 2.2))).exp();
    NEEDLE_AMPLITUDE * (shaft + bead)
}

fn decibel(amplitude: f32) -> f32 {
    20.0 * libm::log10f(amplitude.max(1e-6) / 8.0)
}

/// The grey level of a level in decibel below an amplitude of 8: 50 dB on 255 grey levels.
fn grey(db: f32) -> u8 {
    (((db + 50.0) / 50.0).clamp(0.0, 1.0) * 255.0) as u8
}

/// The fresh speckle's factors, in decibel: 1 + 8 % of (speckle − 1).
fn fresh_db(rng: &mut ChaCha8Rng) -> Vec<f32> {
    let field = speckle(rng, WIDTH + SPARE, HEIGHT + SPARE);
    field.iter().map(|s| 20.0 * libm::log10f(1.0 + 0.08 * (s - 1.0))).collect()
}

/// A needle over speckle that stands still.
pub struct NeedleScene {
    still: Vec<f32>,
    still_db: Vec<f32>,
    fresh_db: Vec<f32>,
    rng: ChaCha8Rng,
    angle_rad: f32,
    /// Added to every image before the log compression.
    pub gain_db: f32,
}

impl NeedleScene {
    pub fn new(seed: u64, background: f32, angle_rad: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut still = speckle(&mut rng, WIDTH, HEIGHT);
        still.iter_mut().for_each(|s| *s *= background);
        let still_db = still.iter().map(|s| decibel(*s)).collect();
        let fresh_db = fresh_db(&mut rng);
        Self { still, still_db, fresh_db, rng, angle_rad: angle_rad as f32, gain_db: 0.0 }
    }

    /// Where the tip begins, and its motion of 2.2 px per image.
    pub fn path(&self) -> ([f64; 2], [f64; 2]) {
        let angle = f64::from(self.angle_rad);
        ([120.0, if angle < 0.0 { 340.0 } else { 120.0 }], [2.2 * angle.cos(), 2.2 * angle.sin()])
    }

    /// One image; `strength` scales the needle, 0 = out of the plane.
    pub fn image(&mut self, tip_px: [f64; 2], strength: f64) -> Image {
        let (dx, dy) = (self.rng.random_range(0..SPARE), self.rng.random_range(0..SPARE));
        let tip = tip_px.map(|c| c as f32);
        let (cos, sin) = (self.angle_rad.cos(), self.angle_rad.sin());
        let mut image = Image::black(WIDTH as u32, HEIGHT as u32);
        for v in 0..HEIGHT {
            let fresh_db = &self.fresh_db[(v + dy) * (WIDTH + SPARE) + dx..][..WIDTH];
            for (u, fresh_db) in fresh_db.iter().enumerate() {
                let at = v * WIDTH + u;
                let bright = strength as f32 * needle(u as f32, v as f32, tip, cos, sin);
                let db = if bright == 0.0 { self.still_db[at] } else { decibel(self.still[at] + bright) };
                image.pixels[at] = grey(db + fresh_db + self.gain_db);
            }
        }
        image
    }
}

/// Needle and speckle that move together, at random on either axis.
pub struct RigidScene {
    base: Vec<f32>,
    fresh_db: Vec<f32>,
    rng: ChaCha8Rng,
    shift: [f64; 2],
    /// Added to every image before the log compression.
    pub gain_db: f32,
    /// Largest motion per axis and image.
    pub step_px: f64,
}

impl RigidScene {
    pub fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (width, height) = (WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN);
        let mut base = speckle(&mut rng, width, height);
        let tip = [(WIDTH / 2 + MARGIN) as f32, (HEIGHT / 2 + MARGIN) as f32];
        let (cos, sin) = (0.45_f32.cos(), 0.45_f32.sin());
        for v in 0..height {
            for u in 0..width {
                base[v * width + u] += needle(u as f32, v as f32, tip, cos, sin);
            }
        }
        let fresh_db = fresh_db(&mut rng);
        Self { base, fresh_db, rng, shift: [0.0; 2], gain_db: 0.0, step_px: 3.0 }
    }

    /// The next image and its true tip; `still` keeps the scene where it is.
    pub fn next(&mut self, still: bool) -> (Image, [f64; 2]) {
        let mut shift = self.shift;
        loop {
            if still {
                break;
            }
            let step = [0; 2].map(|_| self.rng.random_range(-self.step_px..self.step_px));
            shift = [self.shift[0] + step[0], self.shift[1] + step[1]];
            if shift.iter().all(|s: &f64| s.abs() < 40.0) {
                break;
            }
        }
        self.shift = shift;
        let image = self.render();
        (image, [(WIDTH / 2) as f64 + self.shift[0], (HEIGHT / 2) as f64 + self.shift[1]])
    }

    fn render(&mut self) -> Image {
        let (dx, dy) = (self.rng.random_range(0..SPARE), self.rng.random_range(0..SPARE));
        let width = WIDTH + 2 * MARGIN;
        // Image pixel u shows base pixel u + MARGIN − shift.
        let first = self.shift.map(|s| MARGIN as f64 - s);
        let whole = first.map(f64::floor);
        let taps = [0, 1].map(|axis| cubic((first[axis] - whole[axis]) as f32));
        let [x0, y0] = whole.map(|w| w as usize - 1);
        let mut image = Image::black(WIDTH as u32, HEIGHT as u32);
        let mut column = vec![0.0_f32; WIDTH + 3];
        for v in 0..HEIGHT {
            for (i, sum) in column.iter_mut().enumerate() {
                *sum = (0..4).map(|k| taps[1][k] * self.base[(y0 + v + k) * width + x0 + i]).sum();
            }
            let fresh_db = &self.fresh_db[(v + dy) * (WIDTH + SPARE) + dx..][..WIDTH];
            for (u, fresh_db) in fresh_db.iter().enumerate() {
                let amplitude: f32 = (0..4).map(|k| taps[0][k] * column[u + k]).sum();
                image.pixels[v * WIDTH + u] = grey(decibel(amplitude) + fresh_db + self.gain_db);
            }
        }
        image
    }
}

/// Catmull–Rom taps for a fraction of a pixel.
fn cubic(t: f32) -> [f32; 4] {
    [
        0.5 * (-t + 2.0 * t * t - t * t * t),
        0.5 * (2.0 - 5.0 * t * t + 3.0 * t * t * t),
        0.5 * (t + 4.0 * t * t - 3.0 * t * t * t),
        0.5 * (-t * t + t * t * t),
    ]
}

pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt()
}

pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// `work` for every item, on as many threads as there are cores, results in the items' order.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let chunk = items.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        let jobs: Vec<_> = items
            .chunks(chunk)
            .map(|part| scope.spawn(|| part.iter().map(&work).collect::<Vec<_>>()))
            .collect();
        jobs.into_iter().flat_map(|job| job.join().expect("a worker panicked")).collect()
    })
}
