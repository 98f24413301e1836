//! Materials along the lattice's columns, asked for once and kept.

use sonoloop_types::{ColumnSegment, Tissue};

use crate::{beam::amplitude_from_db, lattice::Lattice};

const TILE: i32 = 32;
const UNKNOWN: u32 = u32::MAX;
/// Columns beyond this index are outside any phantom (and would overflow the tile table).
const MAX_INDEX: i32 = 16_384;

/// A stretch of one material, in scatterer indices of its column: `start..end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    pub start: i32,
    pub end: i32,
    /// Scatter amplitude relative to unit backscatter; 0 where nothing scatters.
    pub amplitude: f32,
    /// Two-way attenuation at the probe's centre frequency.
    pub attenuation_db_m: f32,
}

/// Place of a column's stretches, see [`Columns::stretches`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    first: u32,
    count: u32,
}

/// Tissue as seen by the lattice.
pub struct Columns {
    tissue: Tissue,
    lattice: Lattice,
    /// Amplitude and two-way attenuation of each material.
    materials: Vec<(f32, f32)>,
    /// Columns exist for −half ≤ index < half, along x and y.
    half: [i32; 2],
    tiles_across: usize,
    tiles: Vec<Option<Box<[Range]>>>,
    stretches: Vec<Stretch>,
    segments: Vec<ColumnSegment>,
}

impl Columns {
    pub fn new(tissue: Tissue, lattice: Lattice, centre_frequency_hz: f64) -> Self {
        let frequency_mhz = centre_frequency_hz * 1e-6;
        let materials = tissue.materials().iter().map(|m| {
            let amplitude = m.backscatter_db.map_or(0.0, amplitude_from_db);
            let one_way_db_cm = m.attenuation_db_cm_mhz * libm::pow(frequency_mhz, m.attenuation_exponent);
            (amplitude as f32, (2.0 * 100.0 * one_way_db_cm) as f32)
        });
        let materials = materials.collect();
        let half = [0, 1].map(|axis| {
            let spacing_m = [lattice.column_spacing_m, lattice.row_spacing_m][axis];
            // One more than fits, for the rows that are shifted.
            let columns = (tissue.size_m()[axis] / 2.0 / spacing_m).ceil() + 1.0;
            ((columns as i32).clamp(0, MAX_INDEX) + TILE - 1) / TILE * TILE
        });
        let [across, along] = half.map(|h| (2 * h / TILE) as usize);
        Self {
            tissue,
            lattice,
            materials,
            half,
            tiles_across: across,
            tiles: (0..across * along).map(|_| None).collect(),
            stretches: Vec::new(),
            segments: Vec::new(),
        }
    }

    /// Column indices exist in `−half..half` along x and y.
    pub fn half(&self) -> [i32; 2] {
        self.half
    }

    /// The stretches of a column from the top down.
    pub fn stretches(&self, range: Range) -> &[Stretch] {
        &self.stretches[range.first as usize..][..range.count as usize]
    }

    /// One past the deepest scatterer of a column; 0 where there is none.
    pub fn end(&self, range: Range) -> i32 {
        self.stretches(range).last().map_or(0, |stretch| stretch.end)
    }

    /// Where the stretches of a column are kept; an empty range outside the phantom.
    pub fn get(&mut self, ix: i32, iy: i32) -> Range {
        let [hx, hy] = self.half;
        if ix < -hx || ix >= hx || iy < -hy || iy >= hy {
            return Range { first: 0, count: 0 };
        }
        let (i, j) = ((ix + hx) as usize, (iy + hy) as usize);
        let side = TILE as usize;
        let tile = self.tiles[j / side * self.tiles_across + i / side]
            .get_or_insert_with(|| vec![Range { first: UNKNOWN, count: 0 }; side * side].into());
        let range = &mut tile[j % side * side + i % side];
        if range.first == UNKNOWN {
            let [x_m, y_m] = self.lattice.column_m(ix, iy);
            self.tissue.column(x_m, y_m, &mut self.segments);
            let first = self.stretches.len();
            for segment in &self.segments {
                let (start, end) =
                    (self.lattice.first_below(segment.top_z_m), self.lattice.first_below(segment.bottom_z_m));
                let Some(&(amplitude, attenuation_db_m)) = self.materials.get(usize::from(segment.material))
                else {
                    continue;
                };
                if start < end {
                    self.stretches.push(Stretch { start, end, amplitude, attenuation_db_m });
                }
            }
            *range = Range { first: first as u32, count: (self.stretches.len() - first) as u32 };
        }
        *range
    }
}
