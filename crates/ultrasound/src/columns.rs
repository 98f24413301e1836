//! Materials along the lattice's columns, asked for once and kept.

use std::collections::HashMap;

use sonoloop_types::{ColumnSegment, ProbeSpec, Tissue};

use crate::{
    beam::{NEPER_PER_DB, amplitude_from_db},
    boundary::{Boundary, Facet, Mirror, PLANE_LEVEL_DB, ROUGH_SHARE_DB, facets},
    lattice::{Lattice, mix},
    table::Table,
};

/// Columns beyond this index are outside any phantom: half of the 1 m that a file may state is 31 600 of the closest columns,
/// 15.8 µm apart (1.62 σ of the beam at 25 MHz, F# 0.5 and 1300 m/s). It bounds the tables: 32 MB each.
const MAX_INDEX: i32 = 32_768;

/// Beyond these no material slows sound down or speeds it up, as assumed over true speed minus one: depths must
/// stay in order, and what lies behind such a material is in its shadow.
const SLOWEST: f64 = 0.3;
const FASTEST: f64 = -0.8;
/// A rough boundary is drawn where it has this much of the power of the speckle beside it, or of unit speckle.
const ROUGH_OVER_SPECKLE: f32 = 0.05;
const ROUGH_FLOOR: f32 = 1e-3;

/// Scatterers of a column down to `end`, exclusive, from where the layer above ends. Layers follow one another without gaps
/// from the first scatterer on, and are small, as most of the time goes into fetching them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    pub end: i32,
    /// Which [`Filling`] it has, see [`Columns::filling`].
    filling: u32,
}

/// What a layer is made of.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Filling {
    /// Scatter amplitude relative to unit backscatter; 0 where nothing scatters.
    pub amplitude: f32,
    /// One-way attenuation at the probe's centre frequency.
    pub loss_np_m: f32,
    /// One-way loss by reflection at its upper end.
    pub entry_loss_np: f32,
    /// Displayed minus true length per length.
    pub delay: f32,
}

/// Index of the filling of what is no tissue.
const NOTHING: u32 = 0;

/// Place of a column's layers, see [`Columns::layers`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Range {
    first: u32,
    count: u32,
}

/// Place of a column's facets.
#[derive(Debug, Clone, Copy, Default)]
struct FacetRange {
    range: Range,
    /// Which 64ths of the phantom's thickness they lie in: most columns are only looked at for this.
    depths: u64,
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
    /// 64ths of the phantom's thickness per metre.
    depths_per_m: f64,
    lattice: Lattice,
    media: Vec<Medium>,
    draws_boundaries: bool,
    draws_speckle: bool,
    reverberates: bool,
    layers: Vec<Layer>,
    layers_of: Table<Range>,
    fillings: Vec<Filling>,
    /// Index of a filling, by its bits.
    filling_of: HashMap<[u32; 4], u32>,
    /// Where layers of a hash are kept: neighbouring columns often have the same ones, and what is kept once stays in
    /// the caches.
    kept: HashMap<u64, Range>,
    boundaries: Vec<Boundary>,
    boundaries_of: Table<Range>,
    facets: Vec<Facet>,
    /// What each of them reflects.
    mirrors: Vec<Mirror>,
    facets_of: Table<FacetRange>,
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
            (columns as i32).clamp(0, MAX_INDEX)
        });
        Self {
            depths_per_m: 64.0 / tissue.size_m()[2],
            tissue,
            lattice,
            media,
            draws_boundaries: effects.boundaries,
            draws_speckle: effects.speckle,
            reverberates: effects.reverberation,
            layers: Vec::new(),
            layers_of: Table::new(half),
            fillings: vec![Filling::default()],
            filling_of: HashMap::new(),
            kept: HashMap::new(),
            boundaries: Vec::new(),
            boundaries_of: Table::new(half),
            facets: Vec::new(),
            mirrors: Vec::new(),
            facets_of: Table::new(half),
            segments: Vec::new(),
        }
    }

    /// Column indices exist in `−half..half` along x and y.
    pub fn half(&self) -> [i32; 2] {
        self.layers_of.half()
    }

    /// Height of the phantom.
    pub fn thickness_m(&self) -> f64 {
        self.tissue.size_m()[2]
    }

    /// The layers of a column from the top down; none outside the phantom.
    #[inline]
    pub fn layers(&self, range: Range) -> &[Layer] {
        &self.layers[range.first as usize..][..range.count as usize]
    }

    /// What a layer is made of.
    #[inline]
    pub fn filling(&self, layer: Layer) -> &Filling {
        &self.fillings[layer.filling as usize]
    }

    /// Those of a column's layers that scatterers `from..to` lie in.
    #[inline]
    pub fn between(&self, range: Range, from: i32, to: i32) -> (Range, &[Layer]) {
        let all = self.layers(range);
        let first = all.iter().take_while(|layer| layer.end <= from).count();
        let inner = all[first..].iter().take_while(|layer| layer.end < to).count();
        let count = (inner + 1).min(all.len() - first);
        (Range { first: range.first + first as u32, count: count as u32 }, &all[first..first + count])
    }

    /// Amplitude of a column's scatterer; 0 above the first one.
    pub fn amplitude(&self, range: Range, n: i32) -> f32 {
        let layer = self.layers(range).iter().find(|layer| layer.end > n);
        layer.filter(|_| n >= 0).map_or(0.0, |&layer| self.filling(layer).amplitude)
    }

    /// Asks for what the other functions tell of some columns of a row.
    pub fn learn(&mut self, mut columns: core::ops::Range<i32>, iy: i32) {
        while let Some(ix) = self.layers_of.first_unset(columns.clone(), iy) {
            self.read(ix, iy);
            columns.start = ix + 1;
        }
    }

    /// Where the layers of a column are kept; an empty range outside the phantom. The column was learnt.
    #[inline]
    pub fn get(&self, ix: i32, iy: i32) -> Range {
        self.layers_of.get(ix, iy)
    }

    /// Scatterers of a column through the whole phantom, at most.
    pub fn most_scatterers(&self) -> usize {
        (self.thickness_m() / self.lattice.depth_step_m).ceil() as usize + 1
    }

    /// Asks for what [`Self::facets`] tells of some columns of a row.
    pub fn learn_facets(&mut self, mut columns: core::ops::Range<i32>, iy: i32) {
        while let Some(ix) = self.facets_of.first_unset(columns.clone(), iy) {
            self.find_facets(ix, iy);
            columns.start = ix + 1;
        }
    }

    fn find_facets(&mut self, ix: i32, iy: i32) {
        let own = self.boundaries(ix, iy);
        let first = self.facets.len();
        if !own.is_empty() {
            let spacing_m = self.lattice.spacing_m();
            let reverberates = self.reverberates;
            let found = facets(&own, spacing_m, [ix, iy], reverberates, |ix, iy| self.boundaries(ix, iy));
            for (facet, mirror) in found {
                self.facets.push(facet);
                self.mirrors.push(mirror);
            }
        }
        let range = Range { first: first as u32, count: (self.facets.len() - first) as u32 };
        let depths = self.facets[first..]
            .iter()
            .fold(0, |all, facet| all | self.depths(f64::from(facet.z_m), f64::from(facet.z_m)));
        self.facets_of.set(ix, iy, FacetRange { range, depths });
    }

    /// Bits of the 64ths of the phantom's thickness between two depths, phantom frame.
    #[inline]
    fn depths(&self, low_z_m: f64, high_z_m: f64) -> u64 {
        let [first, last] = [high_z_m, low_z_m].map(|z_m| (-z_m * self.depths_per_m).clamp(0.0, 63.0) as u32);
        (u64::MAX << first) & (u64::MAX >> (63 - last))
    }

    /// The facets of a column's boundaries between two depths, phantom frame, and their places; none outside the phantom. They
    /// were learnt.
    #[inline]
    pub fn facets(
        &self,
        ix: i32,
        iy: i32,
        low_z_m: f64,
        high_z_m: f64,
    ) -> impl Iterator<Item = (usize, &Facet)> {
        let FacetRange { range, depths } = self.facets_of.get(ix, iy);
        let any = low_z_m <= high_z_m && depths & self.depths(low_z_m, high_z_m) != 0;
        let first = range.first as usize;
        let places = first..if any { first + range.count as usize } else { first };
        let within = move |(_, facet): &(usize, &Facet)| (low_z_m..=high_z_m).contains(&f64::from(facet.z_m));
        let facets = self.facets[places.clone()].iter();
        places.zip(facets).filter(within)
    }

    /// What a facet reflects, by its place.
    pub fn mirror(&self, place: usize) -> &Mirror {
        &self.mirrors[place]
    }

    fn boundaries(&mut self, ix: i32, iy: i32) -> Vec<Boundary> {
        self.learn(ix..ix + 1, iy);
        let range = self.boundaries_of.get(ix, iy);
        self.boundaries[range.first as usize..][..range.count as usize].to_vec()
    }

    /// Asks the tissue for a column inside the table.
    fn read(&mut self, ix: i32, iy: i32) {
        let [x_m, y_m] = self.lattice.column_m(ix, iy);
        self.tissue.column(x_m, y_m, &mut self.segments);
        let (first, first_boundary) = (self.layers.len(), self.boundaries.len());
        let mut above: Option<(u16, Medium)> = None;
        let segments = core::mem::take(&mut self.segments);
        for segment in &segments {
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
            let mut filling = Filling { amplitude: scattered, loss_np_m, entry_loss_np: 0.0, delay };
            self.push(first, start, Filling::default());
            if let (Some(boundary), Some((_, above))) = (boundary, above) {
                let reflected = boundary.reflection.abs() * amplitude_from_db(PLANE_LEVEL_DB);
                let rough = (reflected * amplitude_from_db(ROUGH_SHARE_DB)) as f32;
                let beside = amplitude.max(above.amplitude);
                filling.entry_loss_np = boundary.entry_loss_np() as f32;
                if start < end && rough * rough > ROUGH_FLOOR.max(ROUGH_OVER_SPECKLE * beside * beside) {
                    // The surface is one layer of stronger scatterers.
                    let surface = (rough * rough + scattered * scattered).sqrt();
                    self.push(first, start + 1, Filling { amplitude: surface, ..filling });
                    filling.entry_loss_np = 0.0;
                }
                if boundary.shows() {
                    self.boundaries.push(boundary);
                }
            }
            self.push(first, end, filling);
            above = Some((segment.material, medium));
        }
        self.segments = segments;
        if self.layers.len() > first {
            self.layers.push(Layer { end: i32::MAX, filling: NOTHING });
        }
        let range = |first: usize, end: usize| Range { first: first as u32, count: (end - first) as u32 };
        let layers = self.keep_once(range(first, self.layers.len()));
        let boundaries = range(first_boundary, self.boundaries.len());
        self.layers_of.set(ix, iy, layers);
        self.boundaries_of.set(ix, iy, boundaries);
    }

    /// Goes on with a column, whose layers begin at `first`, down to `end`.
    fn push(&mut self, first: usize, end: i32, filling: Filling) {
        let from = self.layers[first..].last().map_or(0, |layer| layer.end);
        if from < end {
            let Filling { amplitude, loss_np_m, entry_loss_np, delay } = filling;
            let bits = [amplitude, loss_np_m, entry_loss_np, delay].map(f32::to_bits);
            let filling = *self.filling_of.entry(bits).or_insert_with(|| {
                self.fillings.push(filling);
                self.fillings.len() as u32 - 1
            });
            self.layers.push(Layer { end, filling });
        }
    }

    /// The place of layers that were just appended, or of the same ones kept before.
    fn keep_once(&mut self, range: Range) -> Range {
        let new = self.layers(range);
        let bits = |layer: &Layer| u64::from(layer.end as u32) << 32 | u64::from(layer.filling);
        let hash = new.iter().fold(0, |hash, layer| mix(hash ^ bits(layer)));
        match self.kept.get(&hash) {
            Some(&kept) if self.layers(kept) == new => {
                self.layers.truncate(range.first as usize);
                kept
            }
            _ => {
                self.kept.insert(hash, range);
                range
            }
        }
    }
}
