//! Some strides of a column: their samples, phases and weights, and adding them to two lines.

use core::ops::Range;

use crate::{
    columns::Columns,
    elevation::STRIDE,
    fast::{exp_minus, nearest, turn},
    instructions::{Instructions, nearest_f32, prefetch, wide},
    lattice::TAPE_LENGTH,
    points::Column,
    splat::{BAND, amplitudes},
    strides::{Band, FARTHEST_SHIFT, LANES, Part, Strides},
    tape::unpack,
};

/// Strides that are worked out together at most, a multiple of [`LANES`].
pub const BLOCK: usize = 32;
const _: () = assert!(BLOCK.is_multiple_of(LANES));
/// Samples by which a stride's may lie off those that follow from a block's first one, either way.
const BESIDE: i32 = 2 * FARTHEST_SHIFT as i32;
/// Samples of tape that a block's strides reach.
pub const ROWS: usize = (BLOCK + 1) * STRIDE + 2 * BESIDE as usize;

/// Some strides of a column, worked out but for lines and materials.
pub struct Block {
    /// First of them in the band.
    first: usize,
    /// The first scatterer of each, and where on the strained tapes it is.
    numbers: [i32; BLOCK],
    samples: [i32; BLOCK],
    /// The phase in the middle, and how far it turns from row to row.
    cos: [f32; BLOCK],
    sin: [f32; BLOCK],
    angle: [f32; BLOCK],
    /// The weight where each begins, and the parabola that it follows to its end through its middle.
    weight: [f32; BLOCK],
    growth: [f32; BLOCK],
    bend: [f32; BLOCK],
    /// Where lines drift: the share of the second line at the beginning, and by how much it grows to the end.
    share: [f32; BLOCK],
    drift: [f32; BLOCK],
    /// Of each scatterer.
    amplitude: [[f32; STRIDE]; BLOCK],
}

impl Default for Block {
    fn default() -> Self {
        let zeros = [0.0; BLOCK];
        Self {
            first: 0,
            numbers: [0; BLOCK],
            samples: [0; BLOCK],
            cos: zeros,
            sin: zeros,
            angle: zeros,
            weight: zeros,
            growth: zeros,
            bend: zeros,
            share: zeros,
            drift: zeros,
            amplitude: [[0.0; STRIDE]; BLOCK],
        }
    }
}

wide! {
    /// Works a block's strides out. Loops over several arrays side by side, without branches: they vectorise.
    pub fn prepare(band: &Band, column: &Column, strides: &Strides, part: Part, block: &mut Block) {
        let Part { from, to } = part;
        let Band { flow, tape, warp, strain_step, .. } = *band;
        let count = (to - from).next_multiple_of(LANES).min(BLOCK);
        let first_stride = strides.first + from;
        block.first = first_stride;
        let (numbers, samples) = (&mut block.numbers[..count], &mut block.samples[..count]);
        let (shift, rows_apart) = (&strides.shift[from..][..count + 1], &strides.rows_apart[from..][..count]);
        let per_row = tape.sub_delays as f32;
        let whole_delays = strides.offset * tape.sub_delays as i32;
        let first_row = (first_stride * STRIDE) as i32;
        let class_size = (tape.sub_delays * tape.stride) as i32;
        // Those of this picture alone, whichever are kept from others.
        let [first_class, last_class] = band.classes.map(|class| class as f32);
        let per_class = -1.0 / (strain_step * flow.rows_per_scatterer);
        let of_rest = 1.0 / strain_step;
        for i in 0..count {
            let middle = shift[i] + MIDDLE * (shift[i + 1] - shift[i]);
            let (row_of_0, sub_delay) = tape.split(nearest_f32(middle * per_row) + whole_delays);
            let class = of_rest + per_class * rows_apart[i];
            let class = if class > first_class { class } else { first_class };
            let class = nearest_f32(if class < last_class { class } else { last_class }) - tape.first_class;
            numbers[i] = first_row + (i * STRIDE) as i32 - row_of_0;
            samples[i] = class * class_size + sub_delay * tape.stride as i32 + numbers[i];
        }
        // Where on the tape scatterer 0 would be.
        let first = numbers[0];
        let at = (column.tape as i32 + first) & (TAPE_LENGTH as i32 - 1);
        let start = if at < BESIDE { at + TAPE_LENGTH as i32 } else { at } - first;
        for sample in &mut *samples {
            *sample += start;
        }
        // By the time that they are read, the samples are there.
        for &sample in &samples[..to - from] {
            prefetch(&tape.strained, sample as usize);
        }
        // Minus the carrier's turns down to where the scatterer is, but for those that the tape has in it.
        let turns = -flow.turns_per_row * f64::from(strides.offset - start);
        let turns = (turns - nearest(turns) as f64) as f32;
        let turns_per_row = flow.turns_per_row as f32;
        let (cos, sin, angle) = (&mut block.cos[..count], &mut block.sin[..count], &mut block.angle[..count]);
        for i in 0..count {
            let grown = shift[i + 1] - shift[i];
            let [c, s] = turn(turns - turns_per_row * (shift[i] + MIDDLE * grown));
            let turned = -core::f32::consts::TAU / STRIDE as f32 * turns_per_row * grown;
            // Turned by small angles as if those were their sines, which makes values greater by half their square.
            let scale = 1.0 - 0.5 * MEAN_SQUARE * turned * turned;
            (cos[i], sin[i], angle[i]) = (scale * c, scale * s, turned);
        }
        let e_m = &strides.places.e_m[from..][..count + 1];
        let (decay, peak) = (&warp.decay[first_stride..][..count + 1], &warp.peak[column.class][first_stride..][..count + 1]);
        let middle_peak = &warp.middle_peak[column.class][first_stride..][..count];
        let weigh = |e_m: f32, decay: f32, peak: f32| peak * exp_minus(e_m * e_m * decay);
        let mut edges = [0.0; BLOCK + 1];
        for i in 0..count {
            edges[i] = weigh(e_m[i], decay[i], peak[i]);
        }
        edges[count] = weigh(e_m[count], decay[count], peak[count]);
        let (weight, growth, bend) =
            (&mut block.weight[..count], &mut block.growth[..count], &mut block.bend[..count]);
        for i in 0..count {
            let middle_m = 0.5 * (e_m[i] + e_m[i + 1]);
            let middle = weigh(middle_m, 0.5 * (decay[i] + decay[i + 1]), middle_peak[i]);
            let grown = edges[i + 1] - edges[i];
            let bent = 2.0 * (edges[i] + edges[i + 1] - 2.0 * middle);
            (weight[i], growth[i], bend[i]) = (edges[i], grown - bent, bent);
        }
    }
}

/// Half way between two of some values.
pub fn middle(values: &[f32], from: usize, to: usize) -> f32 {
    0.5 * (values[from] + values[to])
}

impl Block {
    /// Adds some of the column's strides to the two lines that they lie between, those that drift row by row.
    pub fn add<const DRIFTS: bool>(
        &mut self,
        instructions: Instructions,
        band: &Band,
        column: &Column,
        strides: &Strides,
        Part { from, to }: Part,
        lines: &mut [f32],
    ) {
        let line = &strides.places.line[from..=to];
        let of_part = middle(line, 0, if DRIFTS { 1 } else { to - from });
        let whole = nearest_f32(of_part - 0.5);
        let line_at_hand = (whole + 1 - band.first_line) as usize;
        if line_at_hand > BAND {
            return;
        }
        let begin = strides.first + from - self.first;
        let part = Part { from: begin, to: begin + to - from };
        let size = 2 * band.warp.len();
        let both = &mut lines[line_at_hand * size..][..2 * size];
        if DRIFTS {
            for (stride, ends) in line.windows(2).enumerate() {
                self.share[begin + stride] = ends[0] - whole as f32;
                self.drift[begin + stride] = ends[1] - ends[0];
            }
            add_drifting(instructions, self, band, column, part, both);
        } else {
            add_even(instructions, self, band, column, of_part - whole as f32, part, both);
        }
    }
}

wide! {
    /// Of every stride the same share goes to the second line.
    fn add_even(block: &mut Block, band: &Band, column: &Column, share: f32, part: Part, lines: &mut [f32]) {
        add_strides::<false>(block, band, column, share, part, lines);
    }
}

wide! {
    /// What share goes there changes from row to row.
    fn add_drifting(block: &mut Block, band: &Band, column: &Column, part: Part, lines: &mut [f32]) {
        add_strides::<true>(block, band, column, 0.0, part, lines);
    }
}

/// Fills in the amplitudes of some strides' scatterers; returns which of them have any.
#[inline(always)]
fn fill_in(numbers: &[i32], tissue: &Columns, column: &Column, out: &mut [[f32; STRIDE]]) -> Range<usize> {
    let (count, stride) = (numbers.len(), STRIDE as i32);
    let (first, last) = (numbers[0], numbers[count - 1]);
    let (_, layers) = tissue.between(column.layers, first, last + stride);
    let (mut from, mut filled) = (0, count..0);
    for (index, &layer) in layers.iter().enumerate() {
        // As far as strides end within the layer, next to where those of tissue at rest do.
        let strides = (layer.end.saturating_sub(first) / stride).max(0) as usize;
        let mut end = strides.clamp(from, count);
        while end > from && numbers[end - 1].saturating_add(stride) > layer.end {
            end -= 1;
        }
        while end < count && numbers[end].saturating_add(stride) <= layer.end {
            end += 1;
        }
        let amplitude = tissue.filling(layer).amplitude;
        out[from..end].fill([amplitude; STRIDE]);
        let begin = from;
        while from < end && numbers[from] < 0 {
            out[from] = amplitudes(numbers[from], &layers[index..], tissue);
            from += 1;
        }
        if amplitude != 0.0 && begin < end {
            filled = filled.start.min(begin)..end;
        }
        from = end;
        if from < count && numbers[from] < layer.end {
            out[from] = amplitudes(numbers[from], &layers[index..], tissue);
            filled = filled.start.min(from)..from + 1;
            from += 1;
        }
        if from == count {
            break;
        }
    }
    filled
}

/// How far each row of a stride is from its beginning to where the next one begins, and the middle of them; how far each is from
/// there, and the mean square of that.
const PARTS: [f32; STRIDE] = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];
const MIDDLE: f32 = 0.4375;
const FROM_MIDDLE: [f32; STRIDE] = [-3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5];
const MEAN_SQUARE: f32 = 5.25;

/// Adds strides to two lines.
#[inline(always)]
fn add_strides<const DRIFTS: bool>(
    block: &mut Block,
    band: &Band,
    column: &Column,
    share: f32,
    Part { from, to }: Part,
    lines: &mut [f32],
) {
    let filled = fill_in(&block.numbers[from..to], band.tissue, column, &mut block.amplitude[from..to]);
    if filled.is_empty() {
        return;
    }
    let strides = from + filled.start..from + filled.end;
    let tapes = &*band.tape.strained;
    let count = strides.len();
    let rows = (block.first + strides.start) * STRIDE..(block.first + strides.end) * STRIDE;
    let (left, right) = lines.split_at_mut(lines.len() / 2);
    let (left_re, left_im) = left.split_at_mut(left.len() / 2);
    let (right_re, right_im) = right.split_at_mut(right.len() / 2);
    let left_re = &mut left_re[rows.clone()].as_chunks_mut::<STRIDE>().0[..count];
    let left_im = &mut left_im[rows.clone()].as_chunks_mut::<STRIDE>().0[..count];
    let right_re = &mut right_re[rows.clone()].as_chunks_mut::<STRIDE>().0[..count];
    let right_im = &mut right_im[rows].as_chunks_mut::<STRIDE>().0[..count];
    let samples = &block.samples[strides.clone()][..count];
    let (weight, growth) = (&block.weight[strides.clone()][..count], &block.growth[strides.clone()][..count]);
    let (cos, sin) = (&block.cos[strides.clone()][..count], &block.sin[strides.clone()][..count]);
    let (angle, bend) = (&block.angle[strides.clone()][..count], &block.bend[strides.clone()][..count]);
    let (first_share, drift) =
        (&block.share[strides.clone()][..count], &block.drift[strides.clone()][..count]);
    let amplitude = &block.amplitude[strides][..count];
    let (mut a, mut b) = ([1.0 - share; STRIDE], [share; STRIDE]);
    for stride in 0..count {
        let samples = &tapes[samples[stride] as usize..][..STRIDE];
        let (weight, growth, bend) = (weight[stride], growth[stride], bend[stride]);
        let (cos, sin, angle) = (cos[stride], sin[stride], angle[stride]);
        let amplitude = &amplitude[stride];
        // Arrays of their own before any output is written: it might be one of the inputs as far as the compiler knows.
        let (mut re, mut im) = ([0.0; STRIDE], [0.0; STRIDE]);
        for i in 0..STRIDE {
            let sample = unpack(samples[i]);
            let weight = amplitude[i] * (weight + PARTS[i] * (growth + PARTS[i] * bend));
            let weighted = [weight * sample[0], weight * sample[1]];
            let turned = angle * FROM_MIDDLE[i];
            let [cos, sin] = [cos - sin * turned, sin + cos * turned];
            re[i] = cos * weighted[0] - sin * weighted[1];
            im[i] = cos * weighted[1] + sin * weighted[0];
        }
        if DRIFTS {
            for i in 0..STRIDE {
                b[i] = first_share[stride] + PARTS[i] * drift[stride];
                a[i] = 1.0 - b[i];
            }
        }
        add_to(&mut left_re[stride], &a, &re);
        add_to(&mut left_im[stride], &a, &im);
        add_to(&mut right_re[stride], &b, &re);
        add_to(&mut right_im[stride], &b, &im);
    }
}

#[inline(always)]
fn add_to(out: &mut [f32; STRIDE], share: &[f32; STRIDE], values: &[f32; STRIDE]) {
    for i in 0..STRIDE {
        out[i] += share[i] * values[i];
    }
}
