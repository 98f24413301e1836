//! Columns of moved tissue, added to the lines of a band stride by stride.
//!
//! A stride is eight rows of a band's warp. The scatterers on it are a stretch of tape, as in tissue at rest, at a delay and
//! with a phase of its own, which goes on evenly, as the delay does, to where the next stride begins. All of a column's
//! strides are worked out side by side. Where scatterers drift off the warp's rows within one stride, or bend, they are added
//! one by one.

use crate::{
    block::{BLOCK, Block, middle, prepare},
    columns::Columns,
    elevation::STRIDE,
    fast::{exp_minus, nearest, turn},
    instructions::{Instructions, nearest_f32, wide},
    points::{Column, Flow},
    splat::BAND,
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
    warp::{BEYOND, Warp},
};

/// Strides side by side in the widest vectors: loops take whole ones, and so some strides too many.
pub const LANES: usize = 8;
const _: () = assert!(BEYOND > 2 * LANES);
/// What may happen within a stride, over [`crate::beam::Grain::drift_rows`], which itself is for the rows by which its scatterers
/// drift: rows by which its scatterers bend to where the next one ends, lines by which a stride drifts.
const BEND_ROWS: f32 = 0.5;
const DRIFT_LINES: f32 = 2.5;
/// How much more than that may happen where the slice ends, three times as much in all: scatterers there count a twentieth of
/// those in its middle.
const EDGE: f32 = 2.0;
/// Lines by which strides may lie beside the two that they are shared by, and by which one drifts that is even: over a block
/// that is a tenth of a line.
const BESIDE_LINES: f32 = 0.1;
const EVEN_LINES: f32 = 0.1 / BLOCK as f32;
/// Rows by which scatterers may lie beside the row that they have at the column's middle.
pub const FARTHEST_SHIFT: f32 = 64.0;
/// Rows that a scatterer may be squeezed onto where its rows are worked out.
const CLOSEST: f32 = 0.25;

/// What a stride is: beside the picture; on one place between two lines; on its way to another; not straight.
const HIDDEN: u32 = 0;
const EVEN: u32 = 1;
const DRIFTING: u32 = 2;
const APART: u32 = 3;

/// Where scatterers of a column are.
#[derive(Default)]
pub struct Places {
    /// Depth in rows of the grid.
    pub row: Vec<f32>,
    pub e_m: Vec<f32>,
    pub x_m: Vec<f32>,
    /// Place among the grid's lines.
    pub line: Vec<f32>,
}

/// What it takes to add a band's columns.
pub struct Band<'a> {
    pub flow: &'a Flow,
    pub tape: &'a BakedTape,
    pub warp: &'a Warp,
    pub tissue: &'a Columns,
    pub drift_rows: f32,
    pub strain_step: f32,
    /// First and last class of the strain of all bands.
    pub classes: [i32; 2],
    /// The band's first line.
    pub first_line: i32,
}

/// A column on a band's strides, from the stride `first` on. All lists have an entry for the beginning of every stride, and
/// for some beyond the last one.
#[derive(Default)]
pub struct Strides {
    pub first: usize,
    /// Row of the warp minus number of the scatterer: a whole number for the column, and what is left where a stride begins.
    pub offset: i32,
    pub shift: Vec<f32>,
    pub places: Places,
    /// Rows of the grid from one scatterer to the next.
    pub rows_apart: Vec<f32>,
    kind: Vec<u32>,
    /// Numbers of scatterers and what goes with them, moved onto the strides.
    moved: [Vec<f32>; 3],
    single: Places,
}

/// Strides `from..to` of [`Strides`].
#[derive(Clone, Copy)]
pub struct Part {
    pub from: usize,
    pub to: usize,
}

/// Adds a column to the lines from the one before a band to the one after it, each of them the real parts of all rows of
/// the warp, then the imaginary ones.
pub fn add_column(
    instructions: Instructions,
    band: &Band,
    column: &Column,
    strides: &mut Strides,
    block: &mut Block,
    lines: &mut [f32],
) {
    let count = band.lay_out(instructions, column, strides);
    let mut from = 0;
    while let Some(hidden) = strides.kind[from..count].iter().position(|&kind| kind != HIDDEN) {
        from += hidden;
        let end = count.min(from + BLOCK);
        prepare(instructions, band, column, strides, Part { from, to: end }, block);
        while from < end {
            let kind = strides.kind[from];
            let others = strides.kind[from..end].iter().position(|&other| other != kind);
            let mut to = others.map_or(end, |others| from + others);
            match kind {
                EVEN => block.add::<false>(instructions, band, column, strides, Part { from, to }, lines),
                DRIFTING => {
                    let line = &strides.places.line;
                    let whole = nearest_f32(middle(line, from, from + 1) - 0.5) as f32;
                    let between = whole - BESIDE_LINES..whole + 1.0 + BESIDE_LINES;
                    let beside = line[from + 2..=to].iter().position(|line| !between.contains(line));
                    to = beside.map_or(to, |between| from + 1 + between);
                    block.add::<true>(instructions, band, column, strides, Part { from, to }, lines);
                }
                APART => band.add_apart(instructions, column, strides, Part { from, to }, lines),
                _ => {}
            }
            from = to;
        }
    }
}

impl Band<'_> {
    /// Works out where a column's scatterers lie among the strides; returns how many strides those are.
    fn lay_out(&self, instructions: Instructions, column: &Column, strides: &mut Strides) -> usize {
        let Self { flow, warp, drift_rows, .. } = *self;
        let (middle, middle_row) = flow.middle(column);
        let farthest = 4.0 * warp.len() as f32;
        let offset = nearest_f32(warp.at(middle_row).clamp(-farthest, farthest)) - middle as i32;
        let stride = STRIDE as i32;
        // As far as there are scatterers, and the column shows.
        let shown = column.shown.map(|row| nearest_f32(warp.at(row) * (1.0 / STRIDE as f32)));
        let first = (offset - stride).div_euclid(stride).max(shown[0] - 1);
        let last = ((offset + flow.scatterers as i32 + stride).div_euclid(stride) + 1).min(shown[1] + 1);
        let first = first.clamp(0, warp.strides() as i32);
        let count = last.clamp(first, warp.strides() as i32) - first;
        if count == 0 {
            return 0;
        }
        (strides.first, strides.offset) = (first as usize, offset);
        // Whole vectors, and one that nobody needs to know.
        let size = (count as usize + 2).next_multiple_of(LANES) + LANES;
        let at = first as usize;
        let Strides { shift, places, rows_apart, kind, moved, .. } = strides;
        kind.resize(kind.len().max(size), HIDDEN);
        for values in [&mut *shift, rows_apart].into_iter().chain(&mut *moved) {
            values.resize(values.len().max(size), 0.0);
        }
        shift[..size].fill(0.0);
        let warp_row = &warp.row_of_stride[at..][..size];
        let numbers = flow.every_stride(first * stride - offset, size);
        flow.follow(instructions, column, numbers, places);
        settle(instructions, flow, column, [warp_row, numbers[2]], places, rows_apart, shift);
        if flow.is_dragged() {
            // Once more, at the scatterers that come to lie there: how far one is dragged changes quickly.
            for (moved, values) in moved.iter_mut().zip(numbers) {
                go_ahead(instructions, values, shift, &mut moved[..size]);
            }
            flow.follow(instructions, column, [0, 1, 2].map(|part| &moved[part][..size]), places);
            settle(instructions, flow, column, [warp_row, &moved[2]], places, rows_apart, shift);
            // Those are from rows to rows of the warp, so far.
            for (apart, shifts) in rows_apart.iter_mut().zip(shift[..size].windows(2)) {
                *apart *= 1.0 + (shifts[1] - shifts[0]) * (1.0 / STRIDE as f32);
            }
        }
        let drift = [drift_rows, drift_rows * BEND_ROWS, drift_rows * DRIFT_LINES];
        look(
            instructions,
            &warp.reach_m[column.class][at..][..size],
            flow.reach_m,
            drift,
            places,
            [shift, rows_apart],
            kind,
        );
        count as usize
    }

    /// Adds scatterers one by one.
    #[cold]
    #[inline(never)]
    fn add_apart(
        &self,
        instructions: Instructions,
        column: &Column,
        strides: &mut Strides,
        Part { from, to }: Part,
        lines: &mut [f32],
    ) {
        let Self { flow, tape, warp, tissue, first_line, .. } = *self;
        let [lo, hi] = [from, to].map(|stride| (strides.first + stride) * STRIDE);
        // Those beyond the ends reach into these rows as well.
        const NEAR: i32 = DELAY_TAPS as i32;
        let shifts = &strides.shift[from..=to];
        let all = 0..flow.scatterers;
        let numbers = if shifts.iter().all(|shift| shift.abs() < FARTHEST_SHIFT) {
            let number = |row: usize, shift: f32| row as i32 - strides.offset - nearest_f32(shift);
            let rows = (lo..=hi).step_by(STRIDE);
            let numbers = rows.zip(shifts).map(|(row, &shift)| number(row, shift));
            let [first, end] = numbers.fold([i32::MAX, i32::MIN], |[low, high], n| [low.min(n), high.max(n)]);
            let last = all.end as i32;
            (first - NEAR).clamp(0, last) as usize..(end + NEAR).clamp(0, last) as usize
        } else {
            all
        };
        let single = &mut strides.single;
        flow.follow_each(instructions, column, numbers.clone(), single);
        let size = warp.len();
        for (i, n) in numbers.enumerate() {
            let warped = warp.at(single.row[i]);
            let at = nearest_f32(warped);
            let amplitude = tissue.amplitude(column.layers, n as i32);
            let row = at.clamp(0, size as i32 - 1) as usize;
            let (e_m, line) = (single.e_m[i], single.line[i]);
            let whole = nearest_f32(line - 0.5);
            let line_at_hand = (whole + 1 - first_line) as usize;
            let [decay, peak, reach_m] = warp.slice_at(column.class, warped);
            let hidden = e_m.abs() > reach_m || single.x_m[i].abs() > flow.reach_m;
            if hidden || amplitude == 0.0 || line_at_hand > BAND {
                continue;
            }
            let (at, sub_delay) = tape.split(nearest_f32(warped * tape.sub_delays as f32));
            let filter = &tape.strained_filters(warp.class[row / STRIDE])[sub_delay as usize];
            let turns = -flow.turns_per_row * f64::from(warped);
            let [cos, sin] = turn((turns - nearest(turns) as f64) as f32);
            let [re, im] = tape.raw(column.tape + n);
            let weight = amplitude * peak * exp_minus(e_m * e_m * decay);
            let [re, im] = [weight * (re * cos - im * sin), weight * (re * sin + im * cos)];
            let share = line - whole as f32;
            let both = &mut lines[line_at_hand * 2 * size..][..4 * size];
            for (line, share) in both.chunks_exact_mut(2 * size).zip([1.0 - share, share]) {
                let (line_re, line_im) = line.split_at_mut(size);
                for (m, &[cos, sin]) in filter.iter().enumerate() {
                    let row = at + m as i32 - DELAY_REACH as i32;
                    if (lo as i32..hi as i32).contains(&row) {
                        line_re[row as usize] += share * (re * cos - im * sin);
                        line_im[row as usize] += share * (re * sin + im * cos);
                    }
                }
            }
        }
    }
}

wide! {
    /// Goes from the scatterers at `places` to those that lie where strides begin: Newton's step, to second order. Adds to how
    /// many rows of the warp they lie off by, finds how many rows of the grid lie from one to the next, and takes what was
    /// known of the places over to the ones that lie there.
    fn settle(
        flow: &Flow,
        column: &Column,
        warp_row_and_spread: [&[f32]; 2],
        places: &mut Places,
        rows_apart: &mut [f32],
        shift: &mut [f32],
    ) {
        let [warp_row, spread] = warp_row_and_spread;
        let count = warp_row.len();
        let (shift, rows_apart) = (&mut shift[..count], &mut rows_apart[..count]);
        let (warp_row, row, spread) = (&warp_row[..count], &places.row[..count], &spread[..count]);
        let Places { e_m, x_m, line, .. } = places;
        let (e_m, x_m, line) = (&mut e_m[..count], &mut x_m[..count], &mut line[..count]);
        let &Flow { elevation_per_row, along_per_row, .. } = flow;
        let &Column { elevation_aside_m, lines_aside, .. } = column;
        for at in (0..count - LANES).step_by(LANES) {
            let (above, below, mut apart) = (lanes(row, at), lanes(row, at + 1), [0.0; LANES]);
            for i in 0..LANES {
                let rows = (below[i] - above[i]) * (1.0 / STRIDE as f32);
                apart[i] = if rows > CLOSEST { rows } else { CLOSEST };
            }
            rows_apart[at..at + LANES].copy_from_slice(&apart);
        }
        // Beyond the column nothing changes any more.
        let (known, beyond) = rows_apart.split_at_mut(count - LANES);
        beyond.fill(known[count - LANES - 1]);
        for at in (0..count - LANES).step_by(LANES) {
            let (apart, next) = (lanes(rows_apart, at), lanes(rows_apart, at + 1));
            let (spread, spread_next) = (lanes(spread, at), lanes(spread, at + 1));
            let (row, warp_row) = (lanes(row, at), lanes(warp_row, at));
            let (mut shifts, mut at_lines) = (lanes(shift, at), lanes(line, at));
            let (mut es_m, mut xs_m) = (lanes(e_m, at), lanes(x_m, at));
            for i in 0..LANES {
                // Where it begins they are this far apart, and farther by `growth` from one to the next.
                let growth = (next[i] - apart[i]) * (1.0 / STRIDE as f32);
                let here = apart[i] - 0.5 * STRIDE as f32 * growth;
                let per_row = 1.0 / if here > CLOSEST { here } else { CLOSEST };
                let down = row[i] - warp_row[i];
                let even = down * per_row;
                let step = even + 0.5 * growth * per_row * even * even;
                let shifted = shifts[i] + step;
                let shifted = if shifted > -FARTHEST_SHIFT { shifted } else { -FARTHEST_SHIFT };
                shifts[i] = if shifted < FARTHEST_SHIFT { shifted } else { FARTHEST_SHIFT };
                let aside = -step * (1.0 / STRIDE as f32) * (spread_next[i] - spread[i]);
                es_m[i] += elevation_aside_m * aside - elevation_per_row * down;
                xs_m[i] -= along_per_row * down;
                at_lines[i] += lines_aside * aside;
            }
            shift[at..at + LANES].copy_from_slice(&shifts);
            e_m[at..at + LANES].copy_from_slice(&es_m);
            x_m[at..at + LANES].copy_from_slice(&xs_m);
            line[at..at + LANES].copy_from_slice(&at_lines);
        }
        let (known, beyond) = shift.split_at_mut(count - LANES);
        beyond.fill(known[count - LANES - 1]);
    }
}

/// Some values side by side.
#[inline(always)]
fn lanes(values: &[f32], at: usize) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&values[at..at + LANES]);
    lanes
}

wide! {
    /// What goes with scatterers so many numbers ahead of those that it is known of.
    fn go_ahead(values: &[f32], shift: &[f32], out: &mut [f32]) {
        let count = out.len();
        let (values, shift) = (&values[..count], &shift[..count]);
        for i in 0..count - 1 {
            out[i] = values[i] - shift[i] * (values[i + 1] - values[i]) * (1.0 / STRIDE as f32);
        }
        out[count - 1] = values[count - 1];
    }
}

wide! {
    /// What each stride is. `drift` is the most that rows, neighbours' rows and lines may do.
    fn look(
        warp_reach_m: &[f32],
        reach_m: f32,
        drift: [f32; 3],
        places: &Places,
        of_scatterers: [&[f32]; 2],
        kind: &mut [u32],
    ) {
        let count = warp_reach_m.len() - LANES;
        let [shift, rows_apart] = of_scatterers;
        let [drift_rows, bend_rows, drift_lines] = drift;
        let kind = &mut kind[..count];
        for at in (0..count).step_by(LANES) {
            let [warp_reach, next_reach] = [lanes(warp_reach_m, at), lanes(warp_reach_m, at + 1)];
            let [e_m, next_e] = [lanes(&places.e_m, at), lanes(&places.e_m, at + 1)];
            let [x_m, next_x] = [lanes(&places.x_m, at), lanes(&places.x_m, at + 1)];
            let [line, next_line] = [lanes(&places.line, at), lanes(&places.line, at + 1)];
            let [shift, next_shift] = [lanes(shift, at), lanes(shift, at + 1)];
            let [apart, next_apart] = [lanes(rows_apart, at), lanes(rows_apart, at + 1)];
            let mut kinds = [HIDDEN; LANES];
            for i in 0..LANES {
                let within = (e_m[i].abs() <= warp_reach[i])
                    | (next_e[i].abs() <= next_reach[i])
                    | ((e_m[i] * next_e[i] < 0.0) & (warp_reach[i] > 0.0));
                let shows = within & ((x_m[i].abs() <= reach_m) | (next_x[i].abs() <= reach_m));
                // Rows of the warp are even within a stride, and bend from one to the next; scatterers bend by this.
                let bend = STRIDE as f32 * (next_apart[i] - apart[i]);
                let line_drift = (next_line[i] - line[i]).abs();
                // Where the slice ends they count little.
                let (reach_m2, e_m2) = (warp_reach[i] * warp_reach[i], e_m[i] * e_m[i]);
                let allowed = reach_m2 + EDGE * if e_m2 < reach_m2 { e_m2 } else { reach_m2 };
                let alone = ((next_shift[i] - shift[i]).abs() * reach_m2 > drift_rows * allowed)
                    | (bend.abs() * reach_m2 > bend_rows * allowed)
                    | (line_drift > drift_lines)
                    | (shift[i].abs() >= FARTHEST_SHIFT);
                let shown = if line_drift > EVEN_LINES { DRIFTING } else { EVEN };
                let shown = if alone { APART } else { shown };
                kinds[i] = if shows { shown } else { HIDDEN };
            }
            kind[at..at + LANES].copy_from_slice(&kinds);
        }
    }
}
