//! From working rows to display rows: the pulse, drawn where its echo's time says.

use crate::{
    beam::{Beam, PROFILE_REACH, unit_energy_peak},
    fast::{exp_minus, floor, turn},
    instructions::{Instructions, wide},
    lateral::{BeamFilters, LateralScratch},
};

/// Columns are padded to a multiple of this, the width of the inner loops.
pub const BLOCK: usize = 32;
/// Columns that share one delay.
const DELAY_BLOCK: usize = 8;
/// Delays are rounded to this many pixels; blocks of equal delay go together.
const DELAY_STEP_PX: f32 = 1.0 / 16.0;
/// Fractions of a row at which taps are kept.
const FRACTIONS: usize = 128;
/// Rows that a pulse spans at most, the longest at the steepest tilt.
const TAPS: usize = 16;
/// Lengths of the pulse kept per σ at the focus.
const LENGTHS: f64 = 64.0;
/// Rows kept: a pulse, and where materials delay the sound as many as neighbouring lines may lie apart.
const RING: usize = TAPS;
const RING_WITH_DELAYS: usize = 64;

/// Scratch for one task: laterally filtered rows, the newest of them.
#[derive(Default)]
pub struct AxialScratch {
    lateral: LateralScratch,
    ring: Vec<f32>,
    delays_m: Vec<f32>,
    /// The same in steps.
    steps: Vec<i64>,
    groups: Vec<Group>,
    /// Distance of the rows that `pulses` are for.
    row_step_m: f64,
    /// By length, those that were needed so far.
    pulses: Vec<Pulse>,
}

/// A pulse of one length on the rows.
#[derive(Default)]
struct Pulse {
    /// Of each fraction of a row that a place lies past its `first_row`.
    taps: Vec<[f32; TAPS]>,
    /// Taps that it needs, an even number, half of them above the place.
    count: usize,
}

/// Columns of one display row that show one depth.
struct Group {
    first: usize,
    end: usize,
    /// Working row that tap 0 belongs to; before row 0 there is nothing.
    first_row: i64,
    fraction: usize,
}

impl AxialScratch {
    /// Fills the display rows from `first_row` on; `out` holds, per row, `columns` real parts and as many
    /// imaginary ones.
    pub fn display_rows(
        &mut self,
        filters: &BeamFilters,
        columns: usize,
        spacing_m: f64,
        first_row: usize,
        out: &mut [f32],
    ) {
        let BeamFilters { instructions, beam, paths, map, rows, .. } = filters;
        if self.row_step_m != map.row_step_m {
            self.row_step_m = map.row_step_m;
            self.pulses.clear();
        }
        let rows_kept = if paths.any_delay { RING_WITH_DELAYS } else { RING };
        self.ring.resize(rows_kept * 2 * columns, 0.0);
        self.lateral.reset();
        let clip = |row: i64| row.clamp(0, *rows as i64) as usize;
        let mut filled = None;
        for (i, out) in out.chunks_exact_mut(2 * columns).enumerate() {
            let length = self.tabulate(*instructions, beam, (first_row + i) as f64 * spacing_m);
            let Pulse { count, .. } = self.pulses[length];
            self.group(filters, columns, spacing_m, first_row + i, count);
            let count = count as i64;
            let lowest = self.groups.iter().map(|group| clip(group.first_row)).min().unwrap_or(0);
            let highest = self.groups.iter().map(|group| clip(group.first_row + count)).max().unwrap_or(0);
            let mut next = filled.unwrap_or(lowest);
            while next < highest {
                let row = &mut self.ring[next % rows_kept * 2 * columns..][..2 * columns];
                self.lateral.filter_row(filters, next, row.split_at_mut(columns).into());
                next += 1;
            }
            filled = Some(next);
            let (out_re, out_im) = out.split_at_mut(columns);
            // Lines whose delays differ by more than the rows kept lose part of their pulse.
            let first_kept = lowest.max(next.saturating_sub(rows_kept));
            let mut kept: [&[f32]; RING_WITH_DELAYS] = [&[]; RING_WITH_DELAYS];
            for (row, kept) in (first_kept..next).zip(&mut kept) {
                *kept = &self.ring[row % rows_kept * 2 * columns..][..2 * columns];
            }
            for group in &self.groups {
                let low = clip(group.first_row).max(first_kept);
                let high = clip(group.first_row + count).max(low);
                let sources = &kept[low - first_kept..high - first_kept];
                let skipped = (low as i64 - group.first_row).clamp(0, count) as usize;
                let taps = &self.pulses[length].taps[group.fraction][skipped..][..high - low];
                let Group { first, end, .. } = *group;
                weighted_sum(*instructions, taps, sources, first, &mut out_re[first..end]);
                weighted_sum(*instructions, taps, sources, columns + first, &mut out_im[first..end]);
            }
            if paths.any_delay {
                // The carrier is late as well.
                turn_blocks(*instructions, beam.two_k_rad_m, &self.delays_m, out_re, out_im);
            }
        }
    }

    /// Sees to the pulse of a depth; returns its place in `pulses`.
    fn tabulate(&mut self, instructions: Instructions, beam: &Beam, depth_m: f64) -> usize {
        let length = (beam.sigma_axial_at_m(depth_m) / beam.sigma_axial_m * LENGTHS + 0.5) as usize;
        if self.pulses.len() <= length {
            self.pulses.resize_with(length + 1, Pulse::default);
        }
        if self.pulses[length].taps.is_empty() {
            self.pulses[length] =
                Pulse::new(instructions, beam.sigma_axial_m * length as f64 / LENGTHS, self.row_step_m);
        }
        length
    }

    /// Cuts a display row into groups of columns that show one depth.
    fn group(&mut self, filters: &BeamFilters, columns: usize, spacing_m: f64, row: usize, taps: usize) {
        let BeamFilters { paths, map, .. } = filters;
        let shown_m = row as f64 * spacing_m;
        let per_row = FRACTIONS as f64 / map.row_step_m;
        let above = taps as i64 / 2 - 1;
        let group = |first: usize, end: usize, delay_m: f64| {
            let place = floor((shown_m - delay_m) * per_row + 0.5);
            let fractions = FRACTIONS as i64;
            Group {
                first,
                end,
                first_row: place.div_euclid(fractions) - above,
                fraction: place.rem_euclid(fractions) as usize,
            }
        };
        self.groups.clear();
        if !paths.any_delay {
            self.groups.push(group(0, columns, 0.0));
            return;
        }
        self.delays_m.resize(columns / DELAY_BLOCK, 0.0);
        paths.delays_of_row(row, &mut self.delays_m);
        let step_m = DELAY_STEP_PX * spacing_m as f32;
        self.steps.clear();
        self.steps.extend(self.delays_m.iter().map(|&delay_m| floor(f64::from(delay_m / step_m) + 0.5)));
        let mut first = 0;
        for same in self.steps.chunk_by(i64::eq) {
            let end = first + same.len() * DELAY_BLOCK;
            self.groups.push(group(first, end, same[0] as f64 * f64::from(step_m)));
            first = end;
        }
    }
}

impl Pulse {
    fn new(instructions: Instructions, sigma_m: f64, row_step_m: f64) -> Self {
        let reach_m = PROFILE_REACH * sigma_m;
        let count = (2 * (reach_m / row_step_m).ceil() as usize).clamp(2, TAPS);
        let mut taps = vec![[0.0; TAPS]; FRACTIONS];
        let sigma_rows = (sigma_m / row_step_m) as f32;
        fill_taps(
            instructions,
            &mut taps,
            (count / 2 - 1) as f32,
            sigma_rows,
            unit_energy_peak(sigma_m) as f32,
        );
        Self { taps, count }
    }
}

wide! {
    /// A pulse with this σ in rows at all fractions of a row after row `above`.
    fn fill_taps(taps: &mut [[f32; TAPS]], above: f32, sigma_rows: f32, peak: f32) {
        let (decay, reach) = (0.5 / (sigma_rows * sigma_rows), PROFILE_REACH as f32 * sigma_rows);
        for (i, taps) in taps.iter_mut().enumerate() {
            let place = above + i as i32 as f32 / FRACTIONS as f32;
            for (row, tap) in taps.iter_mut().enumerate() {
                let d = place - row as i32 as f32;
                let inside = if d.abs() <= reach { peak } else { 0.0 };
                *tap = inside * exp_minus(d * d * decay);
            }
        }
    }
}

wide! {
    /// `out[x] = Σ_t taps[t]·sources[t][first + x]`.
    fn weighted_sum(taps: &[f32], sources: &[&[f32]], first: usize, out: &mut [f32]) {
        let most = out.len() / BLOCK * BLOCK;
        let (in_blocks, rest) = out.split_at_mut(most);
        blocks::<BLOCK>(taps, sources, first, in_blocks);
        blocks::<DELAY_BLOCK>(taps, sources, first + most, rest);
    }
}

wide! {
    /// Turns the phase of columns by −2k·delay, which is linear between the middles of blocks.
    fn turn_blocks(two_k_rad_m: f64, delays_m: &[f32], out_re: &mut [f32], out_im: &mut [f32]) {
        let turns_per_m = (two_k_rad_m / core::f64::consts::TAU) as f32;
        let re = out_re.as_chunks_mut::<DELAY_BLOCK>().0;
        let im = out_im.as_chunks_mut::<DELAY_BLOCK>().0;
        for (block, (re, im)) in re.iter_mut().zip(im).enumerate() {
            let before = delays_m[block.saturating_sub(1)];
            let here = delays_m[block];
            let after = delays_m[(block + 1).min(delays_m.len() - 1)];
            for x in 0..DELAY_BLOCK {
                let past = (x as f32 + 0.5) / DELAY_BLOCK as f32 - 0.5;
                let beside = if past < 0.0 { here - before } else { after - here };
                let [cos, sin] = turn(turns_per_m * (here + past * beside));
                (re[x], im[x]) = (re[x] * cos + im[x] * sin, im[x] * cos - re[x] * sin);
            }
        }
    }
}

#[inline(always)]
fn blocks<const N: usize>(taps: &[f32], sources: &[&[f32]], first: usize, out: &mut [f32]) {
    for (x, out) in out.chunks_exact_mut(N).enumerate() {
        let mut sum = [0.0f32; N];
        for (source, &tap) in sources.iter().zip(taps) {
            for (s, &v) in sum.iter_mut().zip(&source[first + x * N..][..N]) {
                *s += tap * v;
            }
        }
        out.copy_from_slice(&sum);
    }
}
