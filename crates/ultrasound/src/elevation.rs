//! Elevational weights by bin of e′ and row.

use crate::{
    awake,
    beam::{Beam, unit_energy_peak},
    fast::{exp_minus, nearest},
    instructions::{Instructions, wide},
    shear::{Shear, Slab},
    thinning::Thinning,
};

/// Rows between two looks at whether a column is inside the slice; runs start and end at multiples of it.
pub const STRIDE: usize = 8;
/// Bins that one task fills.
const BLOCK: usize = 64;

/// Rows `lo..hi` in which a bin of columns crosses the slice; weights from `first` on in its block.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    pub lo: u32,
    pub hi: u32,
    pub first: u32,
}

/// Place of weights in the table, see [`ElevationTable::weights`].
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    class: u32,
    block: u32,
    pub first: u32,
}

/// A depth between two rows.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    above: usize,
    below: usize,
    share: f32,
}

impl Place {
    #[inline]
    fn between(self, values: &[f32]) -> f32 {
        let (above, below) = (values[self.above], values[self.below]);
        above + self.share * (below - above)
    }
}

#[derive(Default)]
struct Block {
    runs: Vec<Run>,
    /// Runs of bin b of the block are `runs[starts[b]..starts[b + 1]]`.
    starts: Vec<u32>,
    weights: Vec<f32>,
    /// Of the bin at hand: which strides show.
    shows: Vec<u32>,
}

/// The slice as the columns of one of [`Thinning`]'s sets see it.
#[derive(Default)]
struct Class {
    peak: Vec<f32>,
    /// Negative where they are left out.
    reach_m: Vec<f32>,
    /// Of each stride's first and last row: e − e′, and the reach.
    ends: Vec<[f32; 4]>,
    slab: Slab,
    first_bin: i64,
    bins: usize,
    blocks: Vec<Block>,
}

/// Weight w(e; z) of the slice for every column that crosses it, unit energy, made for one pose.
#[derive(Default)]
pub struct ElevationTable {
    bins_per_m: f64,
    classes: Vec<Class>,
    decay: Vec<f32>,
    /// e − e′ by row.
    drift_m: Vec<f32>,
    /// What the table was made for: rows, their distance in metres, elevational slope, columns left out.
    made_for: Option<(usize, f64, f64, Thinning)>,
}

impl ElevationTable {
    /// Fills the table; every weight also carries `scale`. One table serves one beam and scale.
    pub fn build(&mut self, instructions: Instructions, beam: &Beam, shear: &Shear, scale: f64) {
        let thinning = shear.thinning;
        let made_for = Some((shear.rows, shear.row_step_m, shear.elevation_slope, thinning));
        if self.made_for == made_for {
            return;
        }
        self.made_for = made_for;
        let bin_m = beam.grain.elevation_bin_m;
        self.bins_per_m = 1.0 / bin_m;
        let sigmas_m: Vec<f64> =
            (0..shear.rows).map(|row| beam.sigma_elevation_m(row as f64 * shear.row_step_m)).collect();
        self.decay.clear();
        self.decay.extend(sigmas_m.iter().map(|sigma_m| (0.5 / (sigma_m * sigma_m)) as f32));
        let drift_m = |row: usize| shear.elevation_slope * row as f64 * shear.row_step_m;
        self.drift_m.clear();
        self.drift_m.extend((0..shear.rows).map(|row| drift_m(row) as f32));
        self.classes.resize_with(thinning.classes, Class::default);
        for (index, class) in self.classes.iter_mut().enumerate() {
            let Class { peak, reach_m, ends, slab, first_bin, bins, blocks } = class;
            peak.clear();
            reach_m.clear();
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let mut widest_m = 0.0f64;
            for (row, &sigma_m) in sigmas_m.iter().enumerate() {
                let gain = thinning.gain(index, beam.steady_sigma_m(row as f64 * shear.row_step_m));
                peak.push((scale * gain * unit_energy_peak(sigma_m)) as f32);
                if gain == 0.0 {
                    reach_m.push(-1.0);
                    continue;
                }
                let reach = beam.grain.elevation_reach * sigma_m;
                low = low.min(-reach - drift_m(row));
                high = high.max(reach - drift_m(row));
                widest_m = widest_m.max(reach);
                reach_m.push(reach as f32);
            }
            // None at all where every row leaves them out.
            *first_bin = if low <= high { (low / bin_m).floor() as i64 } else { 0 };
            *bins = if low <= high { ((high / bin_m).ceil() as i64 - *first_bin + 1) as usize } else { 0 };
            let outer = [*first_bin, *first_bin + *bins as i64 - 1];
            *slab = Slab { elevations_m: outer.map(|bin| bin as f64 * bin_m), reach_m: widest_m };
            let (first_bin, bins) = (*first_bin, *bins);
            blocks.resize_with(bins.div_ceil(BLOCK), Block::default);
            ends.clear();
            ends.extend(self.drift_m.chunks(STRIDE).zip(reach_m.chunks(STRIDE)).map(|(drift_m, reach_m)| {
                let last = drift_m.len() - 1;
                [drift_m[0], reach_m[0], drift_m[last], reach_m[last]]
            }));
            let profile = Profile { instructions, decay: &self.decay, peak, drift_m: &self.drift_m, ends };
            awake::for_each(blocks.iter_mut().enumerate(), |(index, block)| {
                block.clear();
                for bin in index * BLOCK..((index + 1) * BLOCK).min(bins) {
                    let e_m = (first_bin + bin as i64) as f64 * bin_m;
                    block.push_bin(shear, e_m, widest_m, &profile);
                }
            });
        }
    }

    /// Where columns of a set are that meet the slice.
    pub fn slab(&self, class: usize) -> Slab {
        self.classes[class].slab
    }

    /// Number of the bin of the columns at `e_m` = e′, see [`Self::crossing`].
    #[inline(always)]
    pub fn bin(&self, e_m: f64) -> i64 {
        nearest(e_m * self.bins_per_m)
    }

    /// Where the columns of a set and bin cross the slice, and where their weights begin; `None` when they miss it.
    #[inline]
    pub fn crossing(&self, class: usize, bin: i64) -> Option<(Weights, &[Run])> {
        let Class { first_bin, bins, blocks, .. } = &self.classes[class];
        let bin = bin - first_bin;
        if bin < 0 || bin >= *bins as i64 {
            return None;
        }
        let (block, bin) = (bin as usize / BLOCK, bin as usize % BLOCK);
        let Block { runs, starts, .. } = &blocks[block];
        let runs = &runs[starts[bin] as usize..starts[bin + 1] as usize];
        let weights = Weights { class: class as u32, block: block as u32, first: 0 };
        (!runs.is_empty()).then_some((weights, runs))
    }

    /// A depth in rows among those of the tables.
    #[inline]
    pub fn place(&self, row: f64) -> Place {
        let last = self.decay.len() - 1;
        let row = row.clamp(0.0, last as f64);
        let above = row as usize;
        Place { above, below: (above + 1).min(last), share: (row - above as f64) as f32 }
    }

    /// 1/2σ² there.
    #[inline]
    pub fn decay(&self, place: Place) -> f32 {
        place.between(&self.decay)
    }

    /// The weight at e = 0 there, for the columns of a set.
    #[inline]
    pub fn peak(&self, class: usize, place: Place) -> f32 {
        place.between(&self.classes[class].peak)
    }

    /// How far the slice reaches there for the columns of a set; negative where they are left out.
    #[inline]
    pub fn reach_m(&self, class: usize, place: Place) -> f32 {
        let reach_m = &self.classes[class].reach_m;
        let (above, below) = (reach_m[place.above], reach_m[place.below]);
        if above > below { above } else { below }
    }

    /// The weights of so many rows.
    pub fn weights(&self, weights: Weights, count: usize) -> &[f32] {
        let blocks = &self.classes[weights.class as usize].blocks;
        &blocks[weights.block as usize].weights[weights.first as usize..][..count]
    }
}

/// Of each row: 1/2σ², the weight at e = 0, and e − e′; of each stride's first and last row: e − e′ and where the slice ends.
struct Profile<'a> {
    instructions: Instructions,
    decay: &'a [f32],
    peak: &'a [f32],
    drift_m: &'a [f32],
    ends: &'a [[f32; 4]],
}

impl Block {
    fn clear(&mut self) {
        self.runs.clear();
        self.weights.clear();
        self.starts.clear();
        self.starts.push(0);
    }

    fn push_bin(&mut self, shear: &Shear, e_m: f64, widest_m: f64, profile: &Profile) {
        let Profile { decay, peak, drift_m, .. } = profile;
        let [lo, hi] = shear.strides_within(e_m, shear.elevation_slope, widest_m).map(|row| row as usize);
        let e = e_m as f32;
        let (mut from, end) = (lo / STRIDE, hi / STRIDE);
        self.shows.resize(self.shows.len().max(end), 0);
        if from < end {
            look(profile.instructions, e, &profile.ends[from..end], &mut self.shows[from..end]);
        }
        while let Some(hidden) = self.shows[from.min(end)..end].iter().position(|&shows| shows != 0) {
            from += hidden;
            let count = self.shows[from..end].iter().position(|&shows| shows == 0).unwrap_or(end - from);
            let rows = from * STRIDE..(from + count) * STRIDE;
            let first = self.weights.len();
            self.runs.push(Run { lo: rows.start as u32, hi: rows.end as u32, first: first as u32 });
            self.weights.resize(first + rows.len(), 0.0);
            let (drift_m, decay, peak) = (&drift_m[rows.clone()], &decay[rows.clone()], &peak[rows]);
            weigh(profile.instructions, e, drift_m, decay, peak, &mut self.weights[first..]);
            from += count;
        }
        self.starts.push(self.runs.len() as u32);
    }
}

wide! {
    /// Which strides of one bin show. Looked at where each begins and ends: one that is crossed between them has e of both
    /// signs.
    fn look(e_m: f32, ends: &[[f32; 4]], shows: &mut [u32]) {
        for (shows, &[first_m, first_reach_m, last_m, last_reach_m]) in shows.iter_mut().zip(ends) {
            let (first_m, last_m) = (e_m + first_m, e_m + last_m);
            let crossed = (first_m * last_m <= 0.0) & (first_reach_m > 0.0);
            *shows = u32::from((first_m.abs() <= first_reach_m) | (last_m.abs() <= last_reach_m) | crossed);
        }
    }
}

wide! {
    /// Weights of one bin, row by row.
    fn weigh(e_m: f32, drift_m: &[f32], decay: &[f32], peak: &[f32], weights: &mut [f32]) {
        let rows = drift_m.iter().zip(decay).zip(peak);
        for (weight, ((drift_m, decay), peak)) in weights.iter_mut().zip(rows) {
            let e_m = e_m + drift_m;
            *weight = peak * exp_minus(e_m * e_m * decay);
        }
    }
}
