//! Echoes added to the display field with their exact point spread.
//!
//! The needle's coherent line stands tens of dB over the speckle and cancels to a thousandth at an angle, so
//! it gets the exact spread and not the working grid's few per cent. By linearity this equals adding it before
//! the beam filters.

use crate::{
    beam::Beam,
    echo::Echo,
    fast::{NEPER_PER_POWER_DB, exp_minus, floor, power_db},
    instructions::wide,
    paths::Paths,
};

/// Profiles are cut where they fall to this over unit speckle (−50 dB)…
const FLOOR: f64 = 0.003;
/// …and at most at this many σ: 3e-4, −70 dB.
const MAX_REACH: f64 = 4.0;
/// Columns added, and rows worked out, at a time.
const WIDTH: usize = 8;

/// Layout of a field: columns and rows of display pixels.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Columns per row, padded; a row holds so many real parts, then imaginary ones.
    pub columns: usize,
    pub rows: usize,
    pub first_x_m: f64,
    pub spacing_m: f64,
}

/// One echo's spread over the display, with those of its reverberations that it runs into.
#[derive(Debug, Clone, Copy)]
struct Stamp {
    /// Rows it reaches, `lo..hi`.
    rows: [u32; 2],
    /// First column, and how many, a multiple of [`WIDTH`].
    column: u32,
    width: u32,
    /// Where its profiles begin.
    axial: u32,
    lateral: u32,
}

/// The stamps of a picture; each is the product of two profiles.
#[derive(Default)]
pub struct Stamps {
    stamps: Vec<Stamp>,
    /// By row, real and imaginary parts.
    axial: Vec<[f32; 2]>,
    lateral: Vec<f32>,
}

/// What echoes from one place have in common.
struct Place {
    at_m: [f64; 2],
    stretch: f64,
    sigma_x: f64,
    delay_m: f64,
    /// True when the last stamp is of this place.
    has_stamp: bool,
}

impl Stamps {
    /// Appends a lateral profile; its first column and width, `None` when it misses the picture.
    #[inline(always)]
    fn push_lateral(&mut self, column: f64, sigma: f64, reach: f64, layout: &Layout) -> Option<(u32, usize)> {
        let [lo, hi] = range(column, reach * sigma, layout.columns).map(|c| c as usize);
        if lo >= hi {
            return None;
        }
        let width = (hi - lo).next_multiple_of(WIDTH);
        // Near the right side the window moves in.
        let first = lo.min(layout.columns - width);
        let decay = (0.5 / (sigma * sigma)) as f32;
        let column = (column - first as f64) as f32;
        self.lateral.extend((0..width).map(|i| {
            let d = i as i32 as f32 - column;
            exp_minus(d * d * decay)
        }));
        Some((first as u32, width))
    }
}

wide! {
    /// Replaces all by the stamps of the echoes that show; those from one place follow one another.
    pub fn prepare(
        stamps: &mut Stamps,
        beam: &Beam,
        paths: &Paths,
        echoes: [&[Echo]; 2],
        layout: &Layout,
    ) {
        stamps.stamps.clear();
        stamps.axial.clear();
        stamps.lateral.clear();
        let pixels = |v_m: f64| v_m / layout.spacing_m;
        let mut place =
            Place { at_m: [f64::NAN; 2], stretch: 1.0, sigma_x: 0.0, delay_m: 0.0, has_stamp: false };
        for echo in echoes.into_iter().flatten() {
            let over_floor = (echo.re * echo.re + echo.im * echo.im) / (FLOOR * FLOOR);
            if over_floor <= 1.0 {
                continue;
            }
            // amplitude·exp(−r²/2) = floor
            let reach =
                f64::from(power_db(over_floor as f32) * NEPER_PER_POWER_DB).max(0.0).sqrt().min(MAX_REACH);
            if place.at_m != [echo.x_m, echo.z_m] {
                let stretch = paths.stretch(echo.x_m, echo.z_m);
                place = Place {
                    at_m: [echo.x_m, echo.z_m],
                    stretch,
                    sigma_x: pixels(beam.sigma_lateral_m * beam.widening(echo.x_m, echo.z_m) * stretch),
                    delay_m: paths.delay_m(echo.x_m, echo.z_m),
                    has_stamp: false,
                };
            }
            let sigma_z = pixels(beam.sigma_axial_at_m(echo.z_m + echo.late_m));
            let decay_z = (0.5 / (sigma_z * sigma_z)) as f32;
            let row = pixels(echo.z_m + echo.late_m + place.delay_m);
            let [lo, hi] = range(row, reach * sigma_z, layout.rows);
            if lo >= hi {
                continue;
            }
            let runs_into = |last: &Stamp| last.rows[0] <= lo && lo <= last.rows[1];
            if !place.has_stamp || !stamps.stamps.last().is_some_and(runs_into) {
                let column = pixels(echo.x_m - layout.first_x_m);
                let Some((column, width)) = stamps.push_lateral(column, place.sigma_x, reach, layout) else {
                    continue;
                };
                place.has_stamp = true;
                let lateral = (stamps.lateral.len() - width) as u32;
                let axial = stamps.axial.len() as u32;
                stamps.stamps.push(Stamp { rows: [lo, lo], column, width: width as u32, axial, lateral });
            }
            let Some(stamp) = stamps.stamps.last_mut() else { continue };
            stamp.rows[1] = stamp.rows[1].max(hi);
            stamps.axial.resize((stamp.axial + stamp.rows[1] - stamp.rows[0]) as usize, [0.0; 2]);
            // Speckle keeps its level when the beam widens; a point spreads its energy.
            let mut scale = 1.0 / place.stretch.sqrt();
            if echo.unshaded {
                scale *= paths.unshade(echo.x_m, echo.z_m + echo.late_m);
            }
            let [re, im] = echo.baseband(beam, place.delay_m).map(|part| (scale * part) as f32);
            let profile =
                &mut stamps.axial[(stamp.axial + lo - stamp.rows[0]) as usize..][..(hi - lo) as usize];
            let row = (row - f64::from(lo)) as f32;
            for (k, profile) in profile.chunks_mut(WIDTH).enumerate() {
                let first = (k * WIDTH) as i32;
                let axial: [f32; WIDTH] = core::array::from_fn(|i| {
                    let d = (first + i as i32) as f32 - row;
                    exp_minus(d * d * decay_z)
                });
                for (out, axial) in profile.iter_mut().zip(axial) {
                    out[0] += axial * re;
                    out[1] += axial * im;
                }
            }
        }
    }
}

wide! {
    /// Adds the stamps to the rows from `first_row` on; a row holds `columns` real parts, then imaginary ones.
    pub fn apply(stamps: &Stamps, columns: usize, first_row: usize, field: &mut [f32]) {
        let end_row = first_row + field.len() / (2 * columns);
        for stamp in &stamps.stamps {
            let [top, bottom] = stamp.rows.map(|row| row as usize);
            let (lo, hi) = (top.max(first_row), bottom.min(end_row));
            if lo >= hi {
                continue;
            }
            let profile = &stamps.axial[stamp.axial as usize + lo - top..][..hi - lo];
            let (lateral, _) =
                stamps.lateral[stamp.lateral as usize..][..stamp.width as usize].as_chunks::<WIDTH>();
            let rows = field[(lo - first_row) * 2 * columns..].chunks_exact_mut(2 * columns);
            for (row, &[re, im]) in rows.zip(profile) {
                let (out_re, out_im) = row.split_at_mut(columns);
                let first = stamp.column as usize;
                add(re, lateral, &mut out_re[first..]);
                add(im, lateral, &mut out_im[first..]);
            }
        }
    }
}

#[inline(always)]
fn add(factor: f32, lateral: &[[f32; WIDTH]], out: &mut [f32]) {
    for (out, lateral) in out.as_chunks_mut::<WIDTH>().0.iter_mut().zip(lateral) {
        for (out, l) in out.iter_mut().zip(lateral) {
            *out += factor * l;
        }
    }
}

/// Whole places within `reach` of `centre` in `0..end`, as `lo..hi`.
fn range(centre: f64, reach: f64, end: usize) -> [u32; 2] {
    let low = -floor(-(centre - reach).clamp(0.0, end as f64));
    [low as u32, floor((centre + reach + 1.0).clamp(low as f64, end as f64)) as u32]
}
