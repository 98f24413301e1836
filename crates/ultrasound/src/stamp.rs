//! Echoes added to the display field with their exact point spread.
//!
//! The needle's coherent line stands tens of dB over the speckle and cancels to a thousandth at an angle, so
//! it gets the exact spread and not the working grid's few per cent. By linearity this equals adding it before
//! the beam filters.

use core::ops::Range;

use crate::{
    beam::Beam,
    echo::Echo,
    fast::{NEPER_PER_POWER_DB, exp_minus, floor, power_db},
    paths::Paths,
};

/// Profiles are cut where they fall to this over unit speckle (−50 dB)…
const FLOOR: f64 = 0.003;
/// …and at most at this many σ: 3e-4, −70 dB.
const MAX_REACH: f64 = 4.0;
/// Columns added at a time.
const WIDTH: usize = 16;
/// Rows added at a time.
const HEIGHT: usize = 8;

/// Layout of a field: columns and rows of display pixels.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Columns per row, padded; a row holds so many real parts, then imaginary ones.
    pub columns: usize,
    pub first_x_m: f64,
    pub spacing_m: f64,
}

/// One echo's spread over the display.
#[derive(Debug, Clone, Copy)]
pub struct Stamp {
    /// Rows and columns it reaches, `lo..hi`.
    rows: [u32; 2],
    columns: [u32; 2],
    /// Place in pixels from the field's first row and column.
    row: f32,
    column: f32,
    /// 1/2σ² in pixels, axial and lateral.
    decay: [f32; 2],
    re: f32,
    im: f32,
}

/// Replaces `stamps` by those of the echoes that show.
pub fn prepare<'a>(
    beam: &Beam,
    paths: &Paths,
    echoes: impl Iterator<Item = &'a Echo>,
    layout: &Layout,
    rows: usize,
    stamps: &mut Vec<Stamp>,
) {
    stamps.clear();
    let pixels = |v_m: f64| v_m / layout.spacing_m;
    let sigma_z = pixels(beam.sigma_axial_m);
    let range = |centre: f64, reach: f64, end: usize| {
        let low = -floor(-(centre - reach).clamp(0.0, end as f64));
        [low as u32, floor((centre + reach + 1.0).clamp(low as f64, end as f64)) as u32]
    };
    // Reverberations come from one place.
    let mut place = [f64::NAN; 2];
    let (mut stretch, mut sigma_x, mut delay_m) = (1.0, 0.0, 0.0);
    for echo in echoes {
        let over_floor = (echo.re * echo.re + echo.im * echo.im) / (FLOOR * FLOOR);
        if over_floor <= 1.0 {
            continue;
        }
        // amplitude·exp(−r²/2) = floor
        let reach =
            f64::from(power_db(over_floor as f32) * NEPER_PER_POWER_DB).max(0.0).sqrt().min(MAX_REACH);
        if place != [echo.x_m, echo.z_m] {
            place = [echo.x_m, echo.z_m];
            stretch = paths.stretch(echo.x_m, echo.z_m);
            sigma_x = pixels(beam.sigma_lateral_m * beam.widening(echo.x_m, echo.z_m) * stretch);
            delay_m = paths.delay_m(echo.x_m, echo.z_m);
        }
        // Speckle keeps its level when the beam widens; a point spreads its energy.
        let scale = 1.0 / stretch.sqrt();
        let (row, column) = (pixels(echo.z_m + echo.late_m + delay_m), pixels(echo.x_m - layout.first_x_m));
        let rows = range(row, reach * sigma_z, rows);
        let columns = range(column, reach * sigma_x, layout.columns);
        if rows[0] < rows[1] && columns[0] < columns[1] {
            let [re, im] = echo.baseband(beam, delay_m);
            stamps.push(Stamp {
                rows,
                columns,
                row: row as f32,
                column: column as f32,
                decay: [(0.5 / (sigma_z * sigma_z)) as f32, (0.5 / (sigma_x * sigma_x)) as f32],
                re: (scale * re) as f32,
                im: (scale * im) as f32,
            });
        }
    }
}

/// Adds the stamps to the rows from `first_row` on; a row holds `columns` real parts, then imaginary ones.
pub fn apply(stamps: &[Stamp], columns: usize, first_row: usize, field: &mut [f32]) {
    let end_row = first_row + field.len() / (2 * columns);
    for stamp in stamps {
        let rows = (stamp.rows[0] as usize).max(first_row)..(stamp.rows[1] as usize).min(end_row);
        for first in rows.clone().step_by(HEIGHT) {
            let rows = first..rows.end.min(first + HEIGHT);
            apply_rows(stamp, columns, rows, &mut field[(first - first_row) * 2 * columns..]);
        }
    }
}

/// Adds up to `HEIGHT` rows of a stamp; `field` begins at the first of them.
fn apply_rows(stamp: &Stamp, columns: usize, rows: Range<usize>, field: &mut [f32]) {
    let axial: [f32; HEIGHT] = core::array::from_fn(|i| {
        let d = (rows.start + i) as i32 as f32 - stamp.row;
        exp_minus(d * d * stamp.decay[0])
    });
    let [mut left, right] = stamp.columns.map(|c| c as usize);
    while left < right {
        // Columns beyond the stamp's own get zero; near the right side the window moves in.
        let first = left.min(columns - WIDTH);
        let lateral: [f32; WIDTH] = core::array::from_fn(|i| {
            let d = (first + i) as i32 as f32 - stamp.column;
            let inside = first + i >= left && first + i < right;
            if inside { exp_minus(d * d * stamp.decay[1]) } else { 0.0 }
        });
        for (out, axial) in field.chunks_exact_mut(2 * columns).zip(&axial[..rows.len()]) {
            let (re, im) = (axial * stamp.re, axial * stamp.im);
            let (out_re, out_im) = out.split_at_mut(columns);
            for (out, l) in out_re[first..][..WIDTH].iter_mut().zip(&lateral) {
                *out += re * l;
            }
            for (out, l) in out_im[first..][..WIDTH].iter_mut().zip(&lateral) {
                *out += im * l;
            }
        }
        left = first + WIDTH;
    }
}
