use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sonoloop_types::Image;

use super::rigid::cubic;
use super::speckle::{SPARE, decibel, fresh_db, grey, speckle};
use super::{HEIGHT, WIDTH};

/// Amplitude of the needle's tip over that of speckle of background 1.
const AMPLITUDE: f32 = 6.0;
/// Farther from the axis, and farther ahead of the tip, a needle has no echo.
const REACH_ACROSS_PX: f32 = 10.0;
const REACH_AHEAD_PX: f32 = 16.0;
/// Farther behind the tip there is shaft alone: the bead and the shaft's end have fallen below 10⁻⁷.
const SHAFT_ALONE_PX: f32 = -20.0;
/// The shaft behind the tip is drawn once, whenever the tip has come this much farther.
const RESETTLE_PX: f32 = 12.0;
/// Moving tissue is drawn at quarters of a pixel.
pub const PHASES: usize = 4;

/// Envelope of a needle of amplitude 6 that comes along an angle (from the u axis towards v) and ends at the tip.
pub fn echo(u: f32, v: f32, tip: [f32; 2], cos: f32, sin: f32) -> f32 {
    let (du, dv) = (u - tip[0], v - tip[1]);
    let along = du * cos + dv * sin;
    let across = dv * cos - du * sin;
    if across.abs() > REACH_ACROSS_PX || along > REACH_AHEAD_PX {
        return 0.0;
    }
    let shaft = 0.55 * libm::expf(-across * across / (2.0 * 1.6 * 1.6));
    if along < SHAFT_ALONE_PX {
        return AMPLITUDE * shaft;
    }
    let bead = (along + 2.0) * (along + 2.0) / (2.0 * 3.0 * 3.0) + across * across / (2.0 * 2.2 * 2.2);
    AMPLITUDE * (shaft / (1.0 + libm::expf(along / 1.2)) + libm::expf(-bead))
}

/// Still speckle of unit rms, and the fresh speckle of the images over it. Scenes may share it: making it takes as long
/// as drawing a hundred images.
pub struct Tissue {
    /// Amplitude, and the same in decibel, moved down by no, one, two and three quarters of a pixel.
    phases: Vec<[Vec<f32>; 2]>,
    fresh_db: Vec<f32>,
}

impl Tissue {
    /// Tissue that stands still.
    pub fn new(seed: u64) -> Self {
        Self::draw(&mut ChaCha8Rng::seed_from_u64(seed), 1)
    }

    /// Tissue that can move up and down.
    pub fn moving(seed: u64) -> Self {
        Self::draw(&mut ChaCha8Rng::seed_from_u64(seed), PHASES)
    }

    fn draw(rng: &mut ChaCha8Rng, phases: usize) -> Self {
        let field = speckle(rng, WIDTH, HEIGHT);
        let moved = |phase: usize| -> Vec<f32> {
            // The field is periodic. Row v shows row v − phase / 4.
            let taps = cubic(-(phase as f32) / PHASES as f32 + 1.0);
            let row = |v: usize, k: usize| &field[(v + HEIGHT + k - 2) % HEIGHT * WIDTH..][..WIDTH];
            let at = |v: usize, u: usize| (0..4).map(|k| taps[k] * row(v, k)[u]).sum();
            (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (v, u))).map(|(v, u)| at(v, u)).collect()
        };
        let phases = (0..phases).map(|phase| if phase == 0 { field.clone() } else { moved(phase) });
        let phases = phases.map(|a| {
            let db = a.iter().map(|a| decibel(*a)).collect();
            [a, db]
        });
        Self { phases: phases.collect(), fresh_db: fresh_db(rng) }
    }
}

/// A band of columns in which everything is darker: what lies below something that lets no sound through.
#[derive(Debug, Clone, Copy)]
pub struct Shadow {
    pub centre_u_px: f32,
    pub half_width_px: f32,
    pub depth_db: f32,
}

impl Shadow {
    /// Over what distance its edges rise.
    const EDGE_PX: f32 = 8.0;

    fn db(&self, u: f32) -> f32 {
        let inside = (self.half_width_px - (u - self.centre_u_px).abs()) / Self::EDGE_PX + 0.5;
        -self.depth_db * inside.clamp(0.0, 1.0)
    }
}

/// A needle over speckle that stands still.
pub struct NeedleScene {
    tissue: Arc<Tissue>,
    background: f32,
    rng: ChaCha8Rng,
    /// Cosine and sine of the needle's angle, from the u axis towards v.
    axis: [f32; 2],
    settled: Settled,
    /// Of the needle's tip, in units of the speckle's rms at background 1.
    pub amplitude: f32,
    /// Of the tip, where [`path`](Self::path) is asked.
    pub speed_px: f64,
    /// Added to every image before the log compression.
    pub gain_db: f32,
    /// Laid over everything.
    pub shadow: Option<Shadow>,
    /// The end of a second needle of amplitude 6, parallel to the first, that stands still.
    pub decoy_tip_px: Option<[f64; 2]>,
    /// How far the tissue has moved down, in quarters of a pixel.
    pub tissue_quarters: i32,
}

/// What the last image had of tissue, decoy and the shaft far behind the tip. The next image mostly has it too, and only the
/// surroundings of its tip are drawn anew.
#[derive(Default)]
struct Settled {
    db: Vec<f32>,
    /// The tip up to whose shaft the picture is drawn, and what else it was drawn from.
    tip: [f32; 2],
    strength: f32,
    decoy_tip_px: Option<[f64; 2]>,
    tissue_quarters: i32,
}

impl NeedleScene {
    pub fn new(seed: u64, background: f32, angle_rad: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let tissue = Arc::new(Tissue::draw(&mut rng, 1));
        Self::with(tissue, rng, background, angle_rad)
    }

    /// Over tissue that other scenes share; `stream` draws the images' fresh speckle.
    pub fn over(tissue: &Arc<Tissue>, stream: u64, background: f32, angle_rad: f64) -> Self {
        Self::with(tissue.clone(), ChaCha8Rng::seed_from_u64(stream), background, angle_rad)
    }

    fn with(tissue: Arc<Tissue>, rng: ChaCha8Rng, background: f32, angle_rad: f64) -> Self {
        assert!(angle_rad.abs() < 1.5, "needles come from the left");
        Self {
            tissue,
            background,
            rng,
            axis: [libm::cos(angle_rad) as f32, libm::sin(angle_rad) as f32],
            settled: Settled::default(),
            amplitude: AMPLITUDE,
            speed_px: 2.2,
            gain_db: 0.0,
            shadow: None,
            decoy_tip_px: None,
            tissue_quarters: 0,
        }
    }

    /// Where the tip begins, and its motion per image.
    pub fn path(&self) -> ([f64; 2], [f64; 2]) {
        let start = [120.0, if self.axis[1] < 0.0 { 340.0 } else { 120.0 }];
        (start, self.axis.map(|c| self.speed_px * f64::from(c)))
    }

    /// One image; `strength` scales the needle, 0 = out of the plane.
    pub fn image(&mut self, tip_px: [f64; 2], strength: f64) -> Image {
        let (dx, dy) = (self.rng.random_range(0..SPARE), self.rng.random_range(0..SPARE));
        let tip = tip_px.map(|c| c as f32);
        let strength = strength as f32 * self.amplitude / AMPLITUDE;
        self.settle(tip, strength);

        let column_db: Vec<f32> =
            (0..WIDTH).map(|u| self.gain_db + self.shadow.map_or(0.0, |s| s.db(u as f32))).collect();
        let fresh_db = &self.tissue.fresh_db[dy * (WIDTH + SPARE) + dx..];
        let mut image = Image::black(WIDTH as u32, HEIGHT as u32);
        let rows = image.pixels.chunks_exact_mut(WIDTH).zip(self.settled.db.chunks_exact(WIDTH));
        for ((pixels, settled_db), fresh_db) in rows.zip(fresh_db.chunks(WIDTH + SPARE)) {
            for (((pixel, settled), fresh), column) in
                pixels.iter_mut().zip(settled_db).zip(fresh_db).zip(&column_db)
            {
                *pixel = grey(settled + fresh + column);
            }
        }
        // The settled shaft ends where that of its own tip does; this tip is as far or farther.
        let [du, dv] = [tip[0] - self.settled.tip[0], tip[1] - self.settled.tip[1]];
        let behind = SHAFT_ALONE_PX - (du * self.axis[0] + dv * self.axis[1]);
        if strength > 0.0 {
            self.for_each_echo(tip, behind, |u, v| {
                let db = self.level_db(u, v, tip, strength);
                image.pixels[v * WIDTH + u] = grey(db + fresh_db[v * (WIDTH + SPARE) + u] + column_db[u]);
            });
        }
        image
    }

    /// Draws what the images from this one on have in common.
    fn settle(&mut self, tip: [f32; 2], strength: f32) {
        let mut settled = std::mem::take(&mut self.settled);
        let [du, dv] = [tip[0] - settled.tip[0], tip[1] - settled.tip[1]];
        let (along, across) = (du * self.axis[0] + dv * self.axis[1], dv * self.axis[0] - du * self.axis[1]);
        let is_same = settled.strength == strength
            && settled.decoy_tip_px == self.decoy_tip_px
            && settled.tissue_quarters == self.tissue_quarters
            && !settled.db.is_empty();
        // Single precision puts a tip on its path to some 10⁻⁴ px.
        let goes_on = is_same && along >= 0.0 && across.abs() < 1e-3;
        if goes_on && along < RESETTLE_PX {
            self.settled = settled;
            return;
        }
        if !goes_on {
            self.draw_tissue(&mut settled.db);
            if let Some(decoy) = self.decoy_tip_px {
                let decoy = decoy.map(|c| c as f32);
                self.for_each_echo(decoy, f32::NEG_INFINITY, |u, v| {
                    settled.db[v * WIDTH + u] = self.level_db(u, v, tip, 0.0);
                });
            }
        }
        if strength > 0.0 {
            let from = if goes_on { SHAFT_ALONE_PX - along } else { f32::NEG_INFINITY };
            self.for_each_echo(tip, from, |u, v| {
                if self.along(u, v, tip) < SHAFT_ALONE_PX {
                    settled.db[v * WIDTH + u] = self.level_db(u, v, tip, strength);
                }
            });
        }
        let (decoy_tip_px, tissue_quarters) = (self.decoy_tip_px, self.tissue_quarters);
        self.settled = Settled { db: settled.db, tip, strength, decoy_tip_px, tissue_quarters };
    }

    /// The tissue alone, moved down as far as it is.
    fn draw_tissue(&self, db: &mut Vec<f32>) {
        let background_db = 20.0 * libm::log10f(self.background);
        let ([_, still_db], first) = self.still();
        db.clear();
        for v in 0..HEIGHT {
            let row = &still_db[(v + first) % HEIGHT * WIDTH..][..WIDTH];
            db.extend(row.iter().map(|still| still + background_db));
        }
    }

    /// The tissue's phase, and which of its rows is the image's first.
    fn still(&self) -> (&[Vec<f32>; 2], usize) {
        let phases = PHASES as i32;
        let phase = self.tissue_quarters.rem_euclid(phases) as usize;
        let first = (-self.tissue_quarters.div_euclid(phases)).rem_euclid(HEIGHT as i32);
        (&self.tissue.phases[phase], first as usize)
    }

    /// Tissue, needle and decoy at one pixel.
    fn level_db(&self, u: usize, v: usize, tip: [f32; 2], strength: f32) -> f32 {
        let ([still, _], first) = self.still();
        let [cos, sin] = self.axis;
        let echo_of = |tip| echo(u as f32, v as f32, tip, cos, sin);
        let decoy = self.decoy_tip_px.map_or(0.0, |tip| echo_of(tip.map(|c| c as f32)));
        let needle = if strength > 0.0 { strength * echo_of(tip) } else { 0.0 };
        decibel(self.background * still[(v + first) % HEIGHT * WIDTH + u] + needle + decoy)
    }

    fn along(&self, u: usize, v: usize, tip: [f32; 2]) -> f32 {
        (u as f32 - tip[0]) * self.axis[0] + (v as f32 - tip[1]) * self.axis[1]
    }

    /// Every pixel (u, v) that a needle's echo reaches, from `from_px` (negative) behind its tip on.
    fn for_each_echo(&self, tip: [f32; 2], from_px: f32, mut act: impl FnMut(usize, usize)) {
        let [cos, sin] = self.axis;
        for v in 0..HEIGHT {
            let dv = v as f32 - tip[1];
            // `echo` is not 0 for |dv·cos − du·sin| within its reach across and du·cos + dv·sin within its reach ahead.
            let mut first = (from_px - dv * sin) / cos;
            let mut last = (REACH_AHEAD_PX - dv * sin) / cos;
            if sin != 0.0 {
                let ends = [-REACH_ACROSS_PX, REACH_ACROSS_PX].map(|across| (dv * cos - across) / sin);
                first = first.max(ends[0].min(ends[1]));
                last = last.min(ends[0].max(ends[1]));
            } else if dv.abs() > REACH_ACROSS_PX {
                continue;
            }
            let column = |du: f32| (tip[0] + du).clamp(0.0, WIDTH as f32) as usize;
            for u in column(first.floor())..column(last.ceil() + 1.0) {
                act(u, v);
            }
        }
    }
}
