use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sonoloop_types::Image;

use super::needle::echo;
use super::speckle::{SPARE, decibel, fresh_db, grey, speckle};
use super::{HEIGHT, WIDTH};

/// Room that a rigid scene has to walk in.
const MARGIN: usize = 64;

/// Needle and speckle that move together.
pub struct RigidScene {
    base: Vec<f32>,
    fresh_db: Vec<f32>,
    rng: ChaCha8Rng,
    shift: [f64; 2],
    step_px: f64,
    /// Added to every image before the log compression.
    pub gain_db: f32,
}

impl RigidScene {
    /// Moves by up to `step_px` on either axis from one image to the next.
    pub fn by(seed: u64, step_px: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (width, height) = (WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN);
        let mut base = speckle(&mut rng, width, height);
        let tip = [(WIDTH / 2 + MARGIN) as f32, (HEIGHT / 2 + MARGIN) as f32];
        let (cos, sin) = (0.45_f32.cos(), 0.45_f32.sin());
        for v in 0..height {
            for u in 0..width {
                base[v * width + u] += echo(u as f32, v as f32, tip, cos, sin);
            }
        }
        let fresh_db = fresh_db(&mut rng);
        Self { base, fresh_db, rng, shift: [0.0; 2], step_px, gain_db: 0.0 }
    }

    /// The next image and its true tip; `still` keeps the scene where it is.
    pub fn next(&mut self, still: bool) -> (Image, [f64; 2]) {
        let mut shift = self.shift;
        loop {
            if still {
                break;
            }
            let steps_px = -self.step_px..self.step_px;
            let step = [self.rng.random_range(steps_px.clone()), self.rng.random_range(steps_px)];
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
pub fn cubic(t: f32) -> [f32; 4] {
    [
        0.5 * (-t + 2.0 * t * t - t * t * t),
        0.5 * (2.0 - 5.0 * t * t + 3.0 * t * t * t),
        0.5 * (t + 4.0 * t * t - 3.0 * t * t * t),
        0.5 * (-t * t + t * t * t),
    ]
}
