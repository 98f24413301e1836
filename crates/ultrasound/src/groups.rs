//! Adding scatterers of pressed tissue, as many at a time as lie next to one another on a warp.

use crate::{
    fast::{exp_minus, turn},
    instructions::{nearest_f32, wide},
    points::{Column, Place},
    warp::Warp,
};

/// Scatterers that go together.
pub const GROUP: usize = 16;

/// Scatterers of a column that are added together.
#[derive(Clone, Copy, Default)]
pub struct Group {
    /// The first scatterer of the group, and which of its scatterers are meant.
    pub first: u32,
    pub from: f32,
    pub to: f32,
    pub amplitude: f32,
    /// Row of the warp that the first one is next to, and part of it.
    pub at: u32,
    pub part: u32,
    /// Line among those at hand, and among the grid's.
    pub line: u32,
    pub whole_line: f32,
    /// Whether they are strained as the warp is.
    pub together: bool,
}

wide! {
    /// Adds a column's groups to the lines from the one before a band to the one after it, each of them its real parts by part
    /// of a row and row, then the imaginary ones.
    pub fn add_column(place: &Place, column: &Column, groups: &[Group], lines: &mut [f32]) {
        // Loops, as what a closure calls would not be compiled for these instructions.
        if place.flow.parts == 2 {
            for group in groups {
                add_group::<2>(place, column, group, lines);
            }
        } else {
            for group in groups {
                add_group::<4>(place, column, group, lines);
            }
        }
    }
}

pub type Steps = [f32; GROUP];

/// 0, 1, 2, …: not known to the compiler, which would do some of them apart, and then all one by one.
pub fn steps() -> Steps {
    core::hint::black_box(core::array::from_fn(|i| i as f32))
}

/// The values from a place on.
#[inline(always)]
fn slots(values: &[f32], first: usize) -> &[f32; GROUP] {
    values[first..].first_chunk().expect("tables go on for a group")
}

/// Loops over several arrays side by side, without branches: they vectorise, and not all do that are put together otherwise.
#[inline(always)]
fn add_group<const PARTS: usize>(place: &Place, column: &Column, group: &Group, lines: &mut [f32]) {
    let Place { flow, tape, warp, .. } = *place;
    let Group { first, from, to, amplitude, at, part, line, whole_line, together } = *group;
    let (first, at, part) = (first as usize, at as usize, part as usize);
    let (sunk, spread) = (slots(&flow.sunk, first), slots(&flow.spread, first));
    let top = (column.top_row + first as f64) as f32;
    let (decay, peak) = (slots(&warp.decay, at), slots(&warp.peak, at));
    let [mut re, mut im] = tape.raw_parts::<GROUP>(column.tape + first);
    let (mut row, mut weight) = ([0.0; GROUP], [0.0; GROUP]);
    for i in 0..GROUP {
        row[i] = top + flow.steps[i] + column.rows_down * sunk[i] + column.rows_aside * spread[i];
        weight[i] = if flow.steps[i] >= from && flow.steps[i] < to { amplitude } else { 0.0 };
    }
    for i in 0..GROUP {
        let e_m = column.e_m + flow.elevation_per_row * row[i] + column.elevation_aside_m * spread[i];
        weight[i] *= peak[i] * exp_minus(e_m * e_m * decay[i]);
    }
    for i in 0..GROUP {
        let [cos, sin] = turn(row[i] * flow.turns_per_row);
        let (r, j) = (weight[i] * re[i], weight[i] * im[i]);
        (re[i], im[i]) = (r * cos + j * sin, j * cos - r * sin);
    }
    let (mut share, mut other) = ([0.0; GROUP], [0.0; GROUP]);
    for i in 0..GROUP {
        share[i] = column.lines_aside * spread[i] + (column.line - whole_line);
        other[i] = 1.0 - share[i];
    }
    let line_size = 2 * PARTS * warp.len();
    let lines = &mut lines[line as usize * line_size..][..2 * line_size];
    if !together {
        return add_apart::<PARTS>(warp, share, row, [re, im], lines);
    }
    let (level, per_row) = (slots(&warp.row, at), slots(&warp.per_row, at));
    let (mut below_re, mut below_im) = ([0.0; GROUP], [0.0; GROUP]);
    for i in 0..GROUP {
        // How far it lies past the part of its row, in parts.
        let past = (row[i] - level[i]) * (per_row[i] * PARTS as f32) - part as f32;
        (below_re[i], below_im[i]) = (past * re[i], past * im[i]);
        (re[i], im[i]) = (re[i] - below_re[i], im[i] - below_im[i]);
    }
    let upper = part * warp.len() + at;
    let lower = if part + 1 < PARTS { upper + warp.len() } else { at + 1 };
    let (left, right) = lines.split_at_mut(line_size);
    add_to_line(left, [upper, lower], &other, [&re, &im], [&below_re, &below_im]);
    add_to_line(right, [upper, lower], &share, [&re, &im], [&below_re, &below_im]);
}

/// Adds shares of a group to a line's rows from the two given ones on.
#[inline(always)]
fn add_to_line(
    line: &mut [f32],
    [upper, lower]: [usize; 2],
    share: &[f32; GROUP],
    [here_re, here_im]: [&[f32; GROUP]; 2],
    [below_re, below_im]: [&[f32; GROUP]; 2],
) {
    let (line_re, line_im) = line.split_at_mut(line.len() / 2);
    add(line_re, upper, share, here_re);
    add(line_re, lower, share, below_re);
    add(line_im, upper, share, here_im);
    add(line_im, lower, share, below_im);
}

#[inline(always)]
fn add(out: &mut [f32], first: usize, share: &[f32; GROUP], values: &[f32; GROUP]) {
    let out = &mut out[first..][..GROUP];
    for i in 0..GROUP {
        out[i] += share[i] * values[i];
    }
}

/// Adds scatterers to two lines one by one, where they are strained unlike the warp.
#[cold]
#[inline(never)]
fn add_apart<const PARTS: usize>(
    warp: &Warp,
    share: [f32; GROUP],
    row: [f32; GROUP],
    [re, im]: [[f32; GROUP]; 2],
    lines: &mut [f32],
) {
    let len = warp.len();
    let (left, right) = lines.split_at_mut(2 * PARTS * len);
    for (line, shares) in [(left, share.map(|share| 1.0 - share)), (right, share)] {
        for (i, share) in shares.into_iter().enumerate() {
            let place = nearest_f32(warp.at(row[i]) * PARTS as f32 - 0.5) as usize;
            if place / PARTS + 1 >= len {
                continue;
            }
            let (at, part) = (place / PARTS, place % PARTS);
            let past = (row[i] - warp.row[at]) * (warp.per_row[at] * PARTS as f32) - part as f32;
            let (upper, lower) = (part * len + at, (place + 1) % PARTS * len + (place + 1) / PARTS);
            for (c, value) in [re[i], im[i]].into_iter().enumerate() {
                line[c * PARTS * len + upper] += share * (1.0 - past) * value;
                line[c * PARTS * len + lower] += share * past * value;
            }
        }
    }
}
