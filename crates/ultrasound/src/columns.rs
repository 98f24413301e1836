//! Materials along the lattice's columns, asked for once and kept.

use std::collections::HashMap;

use sonoloop_types::{ColumnSegment, ProbeSpec, Tissue};

use crate::{
    beam::{NEPER_PER_DB, amplitude_from_db},
    boundary::{Boundary, Facet, PLANE_LEVEL_DB, ROUGH_SHARE_DB, facets},
    lattice::{Lattice, mix},
};

const TILE: i32 = 32;
const UNKNOWN: u32 = u32::MAX;
/// Columns beyond this index are outside any phantom: half of the 1 m that a file may state is 31 600 of the closest columns,
/// 15.8 µm apart (1.62 σ of the beam at 25 MHz, F# 0.5 and 1300 m/s). It bounds the tables of tiles: 32 MB each.
const MAX_INDEX: i32 = 32_768;

/// Beyond these no material slows sound down or speeds it up, as assumed over true speed minus one: depths must
/// stay in order, and what lies behind such a material is in its shadow.
const SLOWEST: f64 = 0.3;
const FASTEST: f64 = -0.8;
/// A rough boundary is drawn where it has this much of the power of the speckle beside it, or of unit speckle.
const ROUGH_OVER_SPECKLE: f32 = 0.05;
const ROUGH_FLOOR: f32 = 1e-3;

/// A stretch of one material, in scatterer indices of its column: `start..end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    pub start: i32,
    pub end: i32,
    /// Scatter amplitude relative to unit backscatter; 0 where nothing scatters.
    pub amplitude: f32,
    /// One-way attenuation at the probe's centre frequency.
    pub loss_np_m: f32,
    /// One-way loss by reflection at its upper end.
    pub entry_loss_np: f32,
    /// Displayed minus true length per length.
    pub delay: f32,
}

/// Place of a column's stretches, see [`Columns::stretches`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    first: u32,
    count: u32,
}

const EMPTY: Range = Range { first: 0, count: 0 };
const UNREAD: Range = Range { first: UNKNOWN, count: 0 };

type Tile = [Range; (TILE * TILE) as usize];

/// A range for every column, in tiles that are made when one of their columns is asked for.
struct Table {
    /// Columns exist for −half ≤ index < half, along x and y.
    half: [i32; 2],
    tiles: Vec<Option<Box<Tile>>>,
}

impl Table {
    fn new(half: [i32; 2]) -> Self {
        let [across, along] = half.map(|h| (2 * h / TILE) as usize);
        Self { half, tiles: (0..across * along).map(|_| None).collect() }
    }

    /// Index of a column's tile, and of the column in it; `None` outside.
    #[inline]
    fn place(&self, ix: i32, iy: i32) -> Option<[usize; 2]> {
        let [hx, hy] = self.half;
        if ix < -hx || ix >= hx || iy < -hy || iy >= hy {
            return None;
        }
        let (i, j, side) = ((ix + hx) as usize, (iy + hy) as usize, TILE as usize);
        Some([j / side * (2 * hx / TILE) as usize + i / side, j % side * side + i % side])
    }

    #[inline]
    fn entry(&mut self, ix: i32, iy: i32) -> Option<&mut Range> {
        let [tile, column] = self.place(ix, iy)?;
        let tile = self.tiles[tile].get_or_insert_with(|| Box::new([UNREAD; (TILE * TILE) as usize]));
        Some(&mut tile[column])
    }

    /// An entry that was made before; an empty range outside.
    #[inline]
    fn known(&self, ix: i32, iy: i32) -> Range {
        let Some([tile, column]) = self.place(ix, iy) else { return EMPTY };
        let range = self.tiles[tile].as_ref().map_or(UNREAD, |tile| tile[column]);
        debug_assert!(range.first != UNKNOWN, "column {ix}, {iy} was not learnt");
        if range.first == UNKNOWN { EMPTY } else { range }
    }
}

/// What the picture needs of a material.
#[derive(Clone, Copy)]
struct Medium {
    amplitude: f32,
    loss_np_m: f32,
    delay: f32,
    impedance: f64,
}

/// Tissue as seen by the lattice.
pub struct Columns {
    tissue: Tissue,
    lattice: Lattice,
    media: Vec<Medium>,
    draws_boundaries: bool,
    draws_speckle: bool,
    reverberates: bool,
    stretches: Vec<Stretch>,
    stretches_of: Table,
    /// Where stretches of a hash are kept: neighbouring columns often have the same ones, and what is kept once stays in
    /// the caches.
    kept: HashMap<u64, Range>,
    boundaries: Vec<Boundary>,
    boundaries_of: Table,
    facets: Vec<Facet>,
    /// Their depths once more: most are only looked at for these.
    facet_z_m: Vec<f64>,
    facets_of: Table,
    segments: Vec<ColumnSegment>,
}

impl Columns {
    pub fn new(tissue: Tissue, lattice: Lattice, probe: &ProbeSpec) -> Self {
        let frequency_mhz = probe.centre_frequency_hz * 1e-6;
        let effects = probe.effects;
        let media = tissue.materials().iter().map(|m| {
            let db_cm = m.attenuation_db_cm_mhz * libm::pow(frequency_mhz, m.attenuation_exponent);
            let slower = (probe.assumed_sound_speed_m_s / m.sound_speed_m_s - 1.0).clamp(FASTEST, SLOWEST);
            Medium {
                amplitude: m.backscatter_db.map_or(0.0, amplitude_from_db) as f32,
                loss_np_m: if effects.attenuation { (100.0 * db_cm * NEPER_PER_DB) as f32 } else { 0.0 },
                delay: if effects.sound_speed { slower as f32 } else { 0.0 },
                impedance: m.sound_speed_m_s * m.density_kg_m3,
            }
        });
        let media = media.collect();
        let half = [0, 1].map(|axis| {
            let spacing_m = [lattice.column_spacing_m, lattice.row_spacing_m][axis];
            // One more than fits, for the rows that are shifted.
            let columns = (tissue.size_m()[axis] / 2.0 / spacing_m).ceil() + 1.0;
            ((columns as i32).clamp(0, MAX_INDEX) + TILE - 1) / TILE * TILE
        });
        Self {
            tissue,
            lattice,
            media,
            draws_boundaries: effects.boundaries,
            draws_speckle: effects.speckle,
            reverberates: effects.reverberation,
            stretches: Vec::new(),
            stretches_of: Table::new(half),
            kept: HashMap::new(),
            boundaries: Vec::new(),
            boundaries_of: Table::new(half),
            facets: Vec::new(),
            facet_z_m: Vec::new(),
            facets_of: Table::new(half),
            segments: Vec::new(),
        }
    }

    /// Column indices exist in `−half..half` along x and y.
    pub fn half(&self) -> [i32; 2] {
        self.stretches_of.half
    }

    /// Height of the phantom.
    pub fn thickness_m(&self) -> f64 {
        self.tissue.size_m()[2]
    }

    /// The stretches of a column from the top down.
    pub fn stretches(&self, range: Range) -> &[Stretch] {
        &self.stretches[range.first as usize..][..range.count as usize]
    }

    /// Those of a column's stretches that scatterers `from..to` lie in.
    pub fn between(&self, range: Range, from: i32, to: i32) -> (Range, &[Stretch]) {
        let all = self.stretches(range);
        let first = all.iter().take_while(|stretch| stretch.end <= from).count();
        let count = all[first..].iter().take_while(|stretch| stretch.start < to).count();
        (Range { first: range.first + first as u32, count: count as u32 }, &all[first..first + count])
    }

    /// Asks for what the other functions tell of a column.
    #[inline]
    pub fn learn(&mut self, ix: i32, iy: i32) {
        if self.stretches_of.entry(ix, iy).is_some_and(|range| range.first == UNKNOWN) {
            self.read(ix, iy);
        }
    }

    /// Where the stretches of a column are kept; an empty range outside the phantom. The column was learnt.
    #[inline]
    pub fn get(&self, ix: i32, iy: i32) -> Range {
        self.stretches_of.known(ix, iy)
    }

    /// Scatterers of a column through the whole phantom, at most.
    pub fn most_scatterers(&self) -> usize {
        (self.thickness_m() / self.lattice.depth_step_m).ceil() as usize + 1
    }

    /// Asks for what [`Self::facets`] tells of a column.
    #[inline]
    pub fn learn_facets(&mut self, ix: i32, iy: i32) {
        if self.facets_of.entry(ix, iy).is_none_or(|range| range.first != UNKNOWN) {
            return;
        }
        let own = self.boundaries(ix, iy);
        let first = self.facets.len();
        if !own.is_empty() {
            let spacing_m = self.lattice.spacing_m();
            let reverberates = self.reverberates;
            let found = facets(&own, spacing_m, [ix, iy], reverberates, |ix, iy| self.boundaries(ix, iy));
            self.facets.extend(found);
            self.facet_z_m.extend(self.facets[first..].iter().map(|facet| facet.z_m));
        }
        let range = Range { first: first as u32, count: (self.facets.len() - first) as u32 };
        if let Some(entry) = self.facets_of.entry(ix, iy) {
            *entry = range;
        }
    }

    /// The facets of a column's boundaries between two depths, phantom frame; none outside the phantom. They were learnt.
    pub fn facets(&self, ix: i32, iy: i32, low_z_m: f64, high_z_m: f64) -> impl Iterator<Item = &Facet> {
        let range = self.facets_of.known(ix, iy);
        let range = range.first as usize..(range.first + range.count) as usize;
        let within = move |&(_, z_m): &(usize, &f64)| (low_z_m..=high_z_m).contains(z_m);
        let depths = self.facet_z_m[range.clone()].iter();
        range.zip(depths).filter(within).map(|(index, _)| &self.facets[index])
    }

    fn boundaries(&mut self, ix: i32, iy: i32) -> Vec<Boundary> {
        self.learn(ix, iy);
        let range = self.boundaries_of.known(ix, iy);
        self.boundaries[range.first as usize..][..range.count as usize].to_vec()
    }

    /// Asks the tissue for a column inside the table.
    fn read(&mut self, ix: i32, iy: i32) {
        let [x_m, y_m] = self.lattice.column_m(ix, iy);
        self.tissue.column(x_m, y_m, &mut self.segments);
        let (first, first_boundary) = (self.stretches.len(), self.boundaries.len());
        let mut above: Option<(u16, Medium)> = None;
        for segment in &self.segments {
            let Some(&medium) = self.media.get(usize::from(segment.material)) else { continue };
            let Medium { amplitude, loss_np_m, delay, impedance } = medium;
            let start = self.lattice.first_below(segment.top_z_m);
            let end = self.lattice.first_below(segment.bottom_z_m);
            let boundary = above.filter(|_| self.draws_boundaries).map(|(material, above)| Boundary {
                z_m: segment.top_z_m,
                between: [material, segment.material],
                reflection: (impedance - above.impedance) / (impedance + above.impedance),
                thickness_m: (segment.top_z_m - segment.bottom_z_m) * (1.0 + f64::from(delay)),
            });
            let scattered = if self.draws_speckle { amplitude } else { 0.0 };
            let mut stretch =
                Stretch { start, end, amplitude: scattered, loss_np_m, entry_loss_np: 0.0, delay };
            if let (Some(boundary), Some((_, above))) = (boundary, above) {
                let reflected = boundary.reflection.abs() * amplitude_from_db(PLANE_LEVEL_DB);
                let rough = (reflected * amplitude_from_db(ROUGH_SHARE_DB)) as f32;
                let beside = amplitude.max(above.amplitude);
                if start < end && rough * rough > ROUGH_FLOOR.max(ROUGH_OVER_SPECKLE * beside * beside) {
                    // The surface is one layer of stronger scatterers.
                    let surface = (rough * rough + scattered * scattered).sqrt();
                    let entry_loss_np = boundary.entry_loss_np() as f32;
                    self.stretches.push(Stretch {
                        end: start + 1,
                        amplitude: surface,
                        entry_loss_np,
                        ..stretch
                    });
                    stretch.start += 1;
                } else {
                    stretch.entry_loss_np = boundary.entry_loss_np() as f32;
                }
                if boundary.shows() {
                    self.boundaries.push(boundary);
                }
            }
            if stretch.start < stretch.end {
                self.stretches.push(stretch);
            }
            above = Some((segment.material, medium));
        }
        let range = |first: usize, end: usize| Range { first: first as u32, count: (end - first) as u32 };
        let stretches = self.keep_once(range(first, self.stretches.len()));
        let boundaries = range(first_boundary, self.boundaries.len());
        for (table, range) in [(&mut self.stretches_of, stretches), (&mut self.boundaries_of, boundaries)] {
            if let Some(entry) = table.entry(ix, iy) {
                *entry = range;
            }
        }
    }

    /// The place of stretches that were just appended, or of the same ones kept before.
    fn keep_once(&mut self, range: Range) -> Range {
        let new = self.stretches(range);
        let hash = new.iter().fold(0, |hash, s| {
            let place = u64::from(s.start as u32) << 32 | u64::from(s.end as u32);
            let medium = u64::from(s.amplitude.to_bits()) << 32 | u64::from(s.loss_np_m.to_bits());
            mix(mix(hash ^ place) ^ medium)
        });
        match self.kept.get(&hash) {
            Some(&kept) if self.stretches(kept) == new => {
                self.stretches.truncate(range.first as usize);
                kept
            }
            _ => {
                self.kept.insert(hash, range);
                range
            }
        }
    }
}
