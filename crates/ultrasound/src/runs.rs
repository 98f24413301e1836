//! Runs of columns of moved tissue, added to the lines of a band.
//!
//! Where scatterers are is worked out at knots, every [`KNOT`] of them. As long as they keep to a straight line between
//! knots they are one run: stretches of tape, as in tissue at rest, each at its own delay, whose phase goes on evenly. Where
//! they bend, or drift too much off the rows of the warp for one delay even between knots, they are added one by one.

use crate::{
    columns::{Columns, Layer},
    fast::{exp_minus, nearest, turn},
    instructions::{nearest_f32, prefetch, wide},
    lattice::TAPE_LENGTH,
    points::{Column, Flow},
    splat::BAND,
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS, unpack},
    warp::Warp,
};

/// Scatterers from one knot to the next, and knots of the longest run.
pub const KNOT: usize = 8;
pub const LONGEST: usize = 32;
/// Rows of the longest run.
pub const ROWS: usize = STRIDES * KNOT;
/// Strides of the longest run, whose rows may be stretched.
const STRIDES: usize = LONGEST + 3;
/// What a whole run may do at most, over [`crate::beam::Grain::drift_rows`], which itself is for the rows from one knot to the
/// next: rows by which its middle lies off the line between its ends (a tenth of a radian of the carrier), lines by which it
/// drifts, metres by which its middle is off in elevation.
const BEND_ROWS: f32 = 1.0 / 8.0;
const DRIFT_LINES: f32 = 5.0 / 3.0;
const BEND_M: f32 = 0.1e-3;
/// Knots from which on a stretch is looked at between its ends and its middle.
const QUARTERED: usize = 8;

/// Where knots, or scatterers, of a column are.
#[derive(Default)]
pub struct Knots {
    /// Depth in rows of the grid.
    pub row: Vec<f32>,
    pub e_m: Vec<f32>,
    pub x_m: Vec<f32>,
    /// Place among the grid's lines.
    pub line: Vec<f32>,
}

/// What it takes to add a band's columns.
pub struct Place<'a> {
    pub flow: &'a Flow,
    pub tape: &'a BakedTape,
    /// The samples of every [`KNOT`] rows' class of the strain.
    pub tapes: &'a [&'a [u32]],
    pub warp: &'a Warp,
    pub tissue: &'a Columns,
    pub drift_rows: f32,
    /// The band's first line.
    pub first_line: i32,
}

/// Scatterers, or knots, between two of them.
#[derive(Clone, Copy)]
struct Stretch {
    from: usize,
    count: usize,
}

/// Where a stretch's ends lie among the rows of a warp, and how far its middle lies off the middle between them.
struct Ends {
    above: f32,
    below: f32,
    bend: f32,
}

/// Adds a column to the lines from the one before a band to the one after it, each of them the real parts of all rows of
/// the warp, then the imaginary ones. `runs` and `single` are scratch.
pub fn add_column(
    instructions: crate::Instructions,
    place: &Place,
    column: &Column,
    knots: &Knots,
    runs: &mut Vec<Run>,
    single: &mut Knots,
    lines: &mut [f32],
) {
    runs.clear();
    let last = knots.row.len() - 1;
    let mut from = 0;
    // Place of the knot `from` among the rows of the warp, where it is known.
    let mut above = None;
    // Knots whose scatterers go one by one.
    let mut apart = Stretch { from: 0, count: 0 };
    // Where the run before was short the next one is not tried much longer.
    let mut longest = LONGEST;
    while from < last {
        let mut stretch = Stretch { from, count: LONGEST.min(last - from) };
        if !place.shows(knots, stretch) {
            from += stretch.count;
            above = None;
            continue;
        }
        let begin = above.unwrap_or_else(|| place.warp.at(knots.row[from]));
        stretch.count = longest.min(1 << stretch.count.ilog2());
        let mut ends = place.ends(knots, stretch, begin);
        let mut is_straight = place.is_straight(knots, stretch, &ends);
        while !is_straight && stretch.count > 1 {
            stretch.count /= 2;
            ends = place.ends(knots, stretch, begin);
            if stretch.count == 1 && place.flow.is_dragged() {
                // No knot is in its middle.
                let middle = from * KNOT + KNOT / 2;
                place.flow.follow_each(instructions, column, middle..middle + 1, single);
                ends.bend = place.warp.at(single.row[0]) - 0.5 * (ends.above + ends.below);
            }
            is_straight = place.is_straight(knots, stretch, &ends);
        }
        from += stretch.count;
        above = Some(ends.below);
        longest = LONGEST.min(2 * stretch.count);
        if !place.shows(knots, stretch) {
            continue;
        }
        if is_straight {
            runs.extend(place.run(column, knots, stretch, &ends));
        } else if apart.from + apart.count == stretch.from {
            apart.count += stretch.count;
        } else {
            place.add_apart(instructions, column, knots, apart, single, lines);
            apart = stretch;
        }
    }
    let mut buffers = Buffers { numbers: [0; STRIDES], places: [0; STRIDES], weights: [0.0; ROWS] };
    for run in runs {
        add_run(instructions, place, column, run, &mut buffers, lines);
    }
    place.add_apart(instructions, column, knots, apart, single, lines);
}

/// What a run's strides and rows need until they are added.
struct Buffers {
    /// Of each stride: its first scatterer, and where on the tape it is.
    numbers: [i32; STRIDES],
    places: [i32; STRIDES],
    /// Of each row.
    weights: [f32; ROWS],
}

/// A run of a column's scatterers over rows `lo..hi` of the warp, whole strides.
pub struct Run {
    lo: usize,
    hi: usize,
    /// Scatterer of row `lo`, and its place on the tape.
    first: i32,
    sample: i32,
    /// Row minus number of the scatterer in the middle of the first stride, in delays of the tape, and by how much it grows per
    /// stride.
    delays: f32,
    delays_per_stride: f32,
    /// Phase at row `lo`, and what it grows by per row.
    turns: f32,
    turns_per_row: f32,
    e_m: f32,
    e_per_row: f32,
    /// Line among those at hand, and the share of the one after it.
    line: usize,
    share: f32,
}

impl Place<'_> {
    /// Whether any of a stretch may show.
    #[inline]
    fn shows(&self, knots: &Knots, Stretch { from, count }: Stretch) -> bool {
        let Self { flow, first_line, .. } = *self;
        let both = |values: &[f32]| (values[from], values[from + count]);
        let beside = |(a, b): (f32, f32), reach: f32| (a > reach && b > reach) || (a < -reach && b < -reach);
        let (above, below) = both(&knots.row);
        if below < flow.rows[0] || above > flow.rows[1] {
            return false;
        }
        let reach_m = flow.widest_between(above, below);
        let middle = (first_line + BAND as i32 / 2) as f32;
        let hidden = |from: usize, to: usize| {
            let both = |values: &[f32]| (values[from], values[to]);
            let (a, b) = both(&knots.line);
            beside(both(&knots.e_m), reach_m)
                || beside(both(&knots.x_m), flow.reach_m)
                || beside((a - middle, b - middle), BAND as f32 / 2.0 + 2.0)
        };
        // What is dragged, or goes aside over a long stretch, may come in between two ends and go out again.
        let part = if flow.is_dragged() { 1 } else { QUARTERED };
        let all_hidden = || {
            let parts = (from..from + count).step_by(part);
            parts.map(|knot| (knot, (knot + part).min(from + count))).all(|(knot, next)| hidden(knot, next))
        };
        !hidden(from, from + count) || count > part && !all_hidden()
    }

    /// Where a stretch's ends lie among the rows of the warp, and its middle off the middle between them.
    #[inline]
    fn ends(&self, knots: &Knots, Stretch { from, count }: Stretch, above: f32) -> Ends {
        let below = self.warp.at(knots.row[from + count]);
        let middle =
            if count > 1 { self.warp.at(knots.row[from + count / 2]) } else { 0.5 * (above + below) };
        Ends { above, below, bend: middle - 0.5 * (above + below) }
    }

    /// Whether a stretch is a run.
    #[inline]
    fn is_straight(&self, knots: &Knots, Stretch { from, count }: Stretch, ends: &Ends) -> bool {
        let line = |values: &[f32], share: f32| values[from] + share * (values[from + count] - values[from]);
        let off = |values: &[f32], quarters: usize| {
            (values[from + count * quarters / 4] - line(values, 0.25 * quarters as f32)).abs()
        };
        let most = self.drift_rows;
        let drift_lines = knots.line[from + count] - knots.line[from];
        // A quarter from the ends of a stretch that bends one way only three quarters of its middle's bend are left.
        let bends_evenly = |quarters: usize| {
            let bend = self.warp.at(knots.row[from + count * quarters / 4])
                - (ends.above + 0.25 * quarters as f32 * (ends.below - ends.above));
            (bend - 0.75 * ends.bend).abs() <= most * BEND_ROWS
                && off(&knots.line, quarters) <= most * DRIFT_LINES
                && off(&knots.e_m, quarters) <= most * BEND_M
        };
        (ends.below - ends.above - (count * KNOT) as f32).abs() <= most * count as f32
            && drift_lines.abs() <= most * DRIFT_LINES
            && ends.bend.abs() <= most * BEND_ROWS
            && (count == 1
                || off(&knots.line, 2) <= most * DRIFT_LINES && off(&knots.e_m, 2) <= most * BEND_M)
            && (count < QUARTERED || bends_evenly(1) && bends_evenly(3))
    }

    /// Rows of the warp that a stretch fills.
    #[inline]
    fn rows(&self, ends: &Ends) -> [usize; 2] {
        [ends.above, ends.below].map(|row| {
            let strides = nearest_f32(row * (1.0 / KNOT as f32)).max(0) as usize;
            (strides * KNOT).min(self.warp.len())
        })
    }

    #[inline]
    fn run(&self, column: &Column, knots: &Knots, stretch: Stretch, ends: &Ends) -> Option<Run> {
        let Self { flow, tape, first_line, .. } = *self;
        let [lo, hi] = self.rows(ends);
        let Stretch { from, count } = stretch;
        let both = |values: &[f32]| (values[from], values[from + count]);
        let &Ends { above, below, bend } = ends;
        let per_warped = 1.0 / (below - above);
        let at = |(a, b): (f32, f32), row: f32| a + (row - above) * per_warped * (b - a);
        let middle = 0.5 * (lo + hi) as f32;
        let line = at(both(&knots.line), middle);
        let whole = nearest_f32(line - 0.5);
        let line_at_hand = (whole + 1 - first_line) as usize;
        if lo >= hi || line_at_hand > BAND {
            return None;
        }
        // Row of the warp minus number of the scatterer, a line that takes a third of the bend.
        let bend = bend * (2.0 / 3.0);
        let numbers = ((from * KNOT) as f32, ((from + count) * KNOT) as f32);
        let shifts = (above - numbers.0 + bend, below - numbers.1 + bend);
        let shift_per_row = per_warped * (shifts.1 - shifts.0);
        let shift = at(shifts, lo as f32);
        let per_row = tape.sub_delays as f32;
        let delays = per_row * (shift + 0.5 * (KNOT as f32 - 1.0) * shift_per_row);
        let (row_of_0, _) = tape.split(nearest_f32(delays));
        let first = lo as i32 - row_of_0;
        let sample = (column.tape as i32 + first) & (TAPE_LENGTH as i32 - 1);
        // Minus the carrier's turns down to where the scatterer is, but for those that the tape has in it.
        let turns = -flow.turns_per_row * (f64::from(shift) + f64::from(first - sample));
        let e_ends = both(&knots.e_m);
        Some(Run {
            lo,
            hi,
            first,
            sample,
            delays,
            delays_per_stride: per_row * KNOT as f32 * shift_per_row,
            turns: (turns - nearest(turns) as f64) as f32,
            turns_per_row: -(flow.turns_per_row as f32) * shift_per_row,
            e_m: at(e_ends, lo as f32),
            e_per_row: per_warped * (e_ends.1 - e_ends.0),
            line: line_at_hand,
            share: line - whole as f32,
        })
    }

    /// Adds scatterers one by one.
    #[cold]
    #[inline(never)]
    fn add_apart(
        &self,
        instructions: crate::Instructions,
        column: &Column,
        knots: &Knots,
        stretch: Stretch,
        single: &mut Knots,
        lines: &mut [f32],
    ) {
        let Self { flow, tape, warp, tissue, first_line, .. } = *self;
        if stretch.count == 0 {
            return;
        }
        let [lo, hi] = self.rows(&self.ends(knots, stretch, warp.at(knots.row[stretch.from])));
        // Those beyond the ends reach into these rows as well.
        const BESIDE: usize = DELAY_TAPS;
        let first = (stretch.from * KNOT).saturating_sub(BESIDE);
        let end = ((stretch.from + stretch.count) * KNOT + BESIDE).min(flow.numbers.len());
        flow.follow_each(instructions, column, first..end, single);
        let size = warp.len();
        for (i, n) in (first..end).enumerate() {
            let warped = warp.at(single.row[i]);
            let at = nearest_f32(warped);
            let amplitude = tissue.amplitude(column.layers, n as i32);
            let row = at.clamp(0, size as i32 - 1) as usize;
            let (e_m, line) = (single.e_m[i], single.line[i]);
            let whole = nearest_f32(line - 0.5);
            let line_at_hand = (whole + 1 - first_line) as usize;
            let reach_m = flow.widest_between(single.row[i], single.row[i]);
            let hidden = e_m.abs() > reach_m || single.x_m[i].abs() > flow.reach_m;
            if hidden || amplitude == 0.0 || line_at_hand > BAND {
                continue;
            }
            let (at, sub_delay) = tape.split(nearest_f32(warped * tape.sub_delays as f32));
            let filter = &tape.strained(warp.class[row / KNOT]).filters[sub_delay as usize];
            let turns = -flow.turns_per_row * f64::from(warped);
            let [cos, sin] = turn((turns - nearest(turns) as f64) as f32);
            let [re, im] = tape.raw(column.tape + n);
            let weight = amplitude * warp.peak[row] * exp_minus(e_m * e_m * warp.decay[row]);
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
    /// Adds a run. Loops over several arrays side by side, without branches: they vectorise.
    fn add_run(place: &Place, column: &Column, run: &Run, buffers: &mut Buffers, lines: &mut [f32]) {
        let Run { lo, hi, first, sample, turns, turns_per_row, e_m, e_per_row, line, share, .. } = *run;
        let (count, size) = (hi - lo, place.warp.len());
        let Buffers { numbers, places, weights } = buffers;
        let strides = count / KNOT;
        let (numbers, places) = (&mut numbers[..strides], &mut places[..strides]);
        for (stride, (number, at)) in numbers.iter_mut().zip(&mut *places).enumerate() {
            let delays = nearest_f32(run.delays + run.delays_per_stride * stride as i32 as f32);
            let (row_of_0, sub_delay) = place.tape.split(delays);
            *number = (lo + stride * KNOT) as i32 - row_of_0;
            *at = (sub_delay as usize * place.tape.stride) as i32 + sample + *number - first;
        }
        // By the time that weights are known, the samples are there.
        for (&at, tape) in places.iter().zip(&place.tapes[lo / KNOT..]) {
            prefetch(tape.get(at as usize..at as usize + KNOT).unwrap_or_default());
        }
        let (Some(&from), Some(&to)) = (numbers.first(), numbers.last()) else { return };
        let (layers, materials) = place.tissue.between(column.layers, from, to + KNOT as i32);
        let one = match materials {
            [] => return,
            &[layer] => Some(place.tissue.filling(layer).amplitude),
            _ => None,
        };
        if one == Some(0.0) {
            return;
        }
        let weights = &mut weights[..count];
        let steps = &place.flow.steps[..count];
        let (decay, peak) = (&place.warp.decay[lo..hi], &place.warp.peak[lo..hi]);
        for i in 0..count {
            let e_m = e_m + e_per_row * steps[i];
            weights[i] = peak[i] * exp_minus(e_m * e_m * decay[i]);
        }
        if first < 0 {
            // Above the first scatterer.
            weights[..((-first) as usize).min(count)].fill(0.0);
        }
        if one.is_none() {
            mix(place.tissue, place.tissue.layers(layers), numbers, weights);
        }
        let amplitude = one.unwrap_or(1.0);
        let [a, b] = [amplitude * (1.0 - share), amplitude * share];
        let (left, right) = lines[line * 2 * size..][..4 * size].split_at_mut(2 * size);
        let (left_re, left_im) = left.split_at_mut(size);
        let (right_re, right_im) = right.split_at_mut(size);
        let (mut cos, mut sin) = ([0.0; KNOT], [0.0; KNOT]);
        // A slice of a length that is not known beforehand: the compiler would do them one by one.
        let of_stride = &place.flow.steps[..place.flow.stride.min(KNOT)];
        for ((cos, sin), step) in cos.iter_mut().zip(&mut sin).zip(of_stride) {
            [*cos, *sin] = turn(turns + turns_per_row * step);
        }
        add(
            &place.tapes[lo / KNOT..],
            places,
            weights,
            [cos, sin],
            turn(turns_per_row * KNOT as f32),
            [a, b],
            &mut left_re[lo..hi],
            &mut left_im[lo..hi],
            &mut right_re[lo..hi],
            &mut right_im[lo..hi],
        );
    }
}

/// Multiplies by the amplitudes of several materials; strides begin with scatterers of these numbers, in ascending order.
#[inline(always)]
fn mix(tissue: &Columns, layers: &[Layer], numbers: &[i32], weights: &mut [f32]) {
    let (first, last) = (numbers[0], numbers.len() - 1);
    let (mut from, mut stride) = (0, 0);
    for &layer in layers {
        // The last stride that begins before the layer's end, next to where it were in tissue at rest.
        stride = ((layer.end.saturating_sub(first) / KNOT as i32).max(0) as usize).clamp(stride, last);
        while stride > 0 && numbers[stride] >= layer.end {
            stride -= 1;
        }
        while stride < last && numbers[stride + 1] < layer.end {
            stride += 1;
        }
        let scatterers = layer.end.saturating_sub(numbers[stride]).clamp(0, KNOT as i32) as usize;
        let to = (stride * KNOT + scatterers).max(from);
        let amplitude = tissue.filling(layer).amplitude;
        weights[from..to].iter_mut().for_each(|weight| *weight *= amplitude);
        from = to;
    }
}

/// Adds the samples at some places, whose phases start with `cos` and `sin`, and turn by another angle from each stride to the next.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "six streams and their factors")]
fn add(
    tapes: &[&[u32]],
    places: &[i32],
    weights: &[f32],
    [mut cos, mut sin]: [[f32; KNOT]; 2],
    [cos_step, sin_step]: [f32; 2],
    [a, b]: [f32; 2],
    left_re: &mut [f32],
    left_im: &mut [f32],
    right_re: &mut [f32],
    right_im: &mut [f32],
) {
    let weights = weights.as_chunks::<KNOT>().0;
    let (left_re, left_im) = (left_re.as_chunks_mut::<KNOT>().0, left_im.as_chunks_mut::<KNOT>().0);
    let (right_re, right_im) = (right_re.as_chunks_mut::<KNOT>().0, right_im.as_chunks_mut::<KNOT>().0);
    let left = left_re.iter_mut().zip(left_im);
    let right = right_re.iter_mut().zip(right_im);
    for ((((&place, tape), weights), (left_re, left_im)), (right_re, right_im)) in
        places.iter().zip(tapes).zip(weights).zip(left).zip(right)
    {
        let samples = &tape[place as usize..][..KNOT];
        // Arrays of their own before any output is written: it might be one of the inputs as far as the compiler knows.
        let (mut re, mut im) = ([0.0; KNOT], [0.0; KNOT]);
        for i in 0..KNOT {
            let sample = unpack(samples[i]);
            let weighted = [weights[i] * sample[0], weights[i] * sample[1]];
            re[i] = cos[i] * weighted[0] - sin[i] * weighted[1];
            im[i] = cos[i] * weighted[1] + sin[i] * weighted[0];
        }
        add_part(left_re, a, &re);
        add_part(left_im, a, &im);
        add_part(right_re, b, &re);
        add_part(right_im, b, &im);
        for i in 0..KNOT {
            (cos[i], sin[i]) = (cos[i] * cos_step - sin[i] * sin_step, sin[i] * cos_step + cos[i] * sin_step);
        }
    }
}

#[inline(always)]
fn add_part(out: &mut [f32; KNOT], share: f32, values: &[f32; KNOT]) {
    for i in 0..KNOT {
        out[i] += share * values[i];
    }
}
