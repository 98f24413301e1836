//! From working rows to display rows: the pulse.

use crate::{
    beam::{PROFILE_REACH, exp_minus, unit_energy_peak},
    lateral::{BeamFilters, LateralScratch},
};

/// Columns are padded to a multiple of this, the width of the inner loops.
pub const BLOCK: usize = 32;
/// Rows kept: the pulse spans 13 rows at the steepest tilt.
const RING: usize = 16;

/// Scratch for one task: laterally filtered rows, the newest [`RING`] of them.
#[derive(Default)]
pub struct AxialScratch {
    lateral: LateralScratch,
    ring: Vec<f32>,
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
        let BeamFilters { beam, map, rows, .. } = filters;
        let (reach_m, step_m) = (PROFILE_REACH * beam.sigma_axial_m, map.row_step_m);
        let peak = unit_energy_peak(beam.sigma_axial_m) as f32;
        let decay = (0.5 / (beam.sigma_axial_m * beam.sigma_axial_m)) as f32;
        self.ring.resize(RING * 2 * columns, 0.0);
        self.lateral.reset();
        let window = |v: usize| {
            let z_m = v as f64 * spacing_m;
            let low = ((z_m - reach_m) / step_m).ceil().max(0.0) as usize;
            let high = (((z_m + reach_m) / step_m).floor() as usize + 1).min(*rows);
            (z_m, low, high)
        };
        let mut filled = window(first_row).1;
        for (i, out) in out.chunks_exact_mut(2 * columns).enumerate() {
            let (z_m, low, high) = window(first_row + i);
            while filled < high {
                let row = &mut self.ring[filled % RING * 2 * columns..][..2 * columns];
                self.lateral.filter_row(filters, filled, row.split_at_mut(columns).into());
                filled += 1;
            }
            let mut taps = [0.0f32; RING];
            let mut sources: [&[f32]; RING] = [&[]; RING];
            for ((row, tap), source) in (low..high).zip(&mut taps).zip(&mut sources) {
                let d = (z_m - row as f64 * step_m) as f32;
                *tap = peak * exp_minus(d * d * decay);
                *source = &self.ring[row % RING * 2 * columns..][..2 * columns];
            }
            let (taps, sources) = (&taps[..high - low], &sources[..high - low]);
            weighted_sum(taps, sources, out);
        }
    }
}

/// `out[x] = Σ_t taps[t]·sources[t][x]`, a multiple of [`BLOCK`] values.
fn weighted_sum(taps: &[f32], sources: &[&[f32]], out: &mut [f32]) {
    for (x, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut sum = [0.0f32; BLOCK];
        for (source, &tap) in sources.iter().zip(taps) {
            for (s, &v) in sum.iter_mut().zip(&source[x * BLOCK..][..BLOCK]) {
                *s += tap * v;
            }
        }
        out.copy_from_slice(&sum);
    }
}
