//! Which elements touch the phantom. Blind ones neither send nor hear; something in the way of others takes a part.

use sonoloop_types::{ProbeSpec, Slice};

use crate::{
    beam::{Beam, amplitude_from_db},
    lattice::mix,
    march::{DIRECTIONS, part_of_aperture},
    paths::Plane,
};

/// A gap above this is air: it reflects all. Below it is rounding.
const AIR_GAP_M: f32 = 1e-7;
/// Bands of ringing wave up and down by this. [assumed]
const RINGING_WAVE_M: f32 = 0.12e-3;
/// Distance of the bands under a bare lens: one passage through it. [assumed]
const LENS_M: f64 = 0.9e-3;
/// Gel follows the face so far before it tears. [assumed] Sound goes to and fro in it as well, so the bands lie farther
/// apart where the gap is wider, and those of a probe that is lifted on one side slant.
const FILM_M: f64 = 0.5e-3;

/// Contact of the elements in one picture.
pub struct Contact {
    enabled: bool,
    elements: usize,
    pitch_m: f64,
    /// Share of the near aperture that is blind, per displayed column, times the strength of its elements' ringing; by how
    /// much this is drawn farther down, and how far apart its bands are.
    pub blind: Vec<f32>,
    pub ringing_shift_m: Vec<f32>,
    pub band_spacing_m: Vec<f32>,
    pub any_blind: bool,
    /// Some elements send and hear less than others, or nothing.
    pub any_weaker: bool,
    /// Coupled elements left of each edge between elements, and the same weighted by the amplitude that each lets through
    /// one way.
    coupled: Vec<f64>,
    through: Vec<f64>,
}

/// Ringing of the elements around a place: how strong, and how much farther down than in a lens of even thickness. Both
/// change slowly along the array, strength a little from element to element too. [assumed]
fn ringing(place: f64) -> (f32, f32) {
    let strength = 0.95 + 0.4 * smooth_noise(1, place / 9.0) + 0.08 * smooth_noise(2, place);
    (strength, RINGING_WAVE_M * smooth_noise(3, place / 14.0))
}

/// Noise in −1..1 that is drawn at whole places and passes smoothly between them.
fn smooth_noise(seed: u64, place: f64) -> f32 {
    let first = place.floor();
    let value = |knot: f64| (mix(seed ^ mix(knot as i64 as u64)) >> 40) as f32 / (1u32 << 23) as f32 - 1.0;
    let u = (place - first) as f32;
    let (left, right) = (value(first), value(first + 1.0));
    left + (right - left) * u * u * (3.0 - 2.0 * u)
}

impl Contact {
    pub fn new(probe: &ProbeSpec) -> Self {
        Self {
            enabled: probe.effects.contact,
            elements: probe.elements as usize,
            pitch_m: probe.pitch_m,
            blind: Vec::new(),
            ringing_shift_m: Vec::new(),
            band_spacing_m: Vec::new(),
            any_blind: false,
            any_weaker: false,
            coupled: Vec::new(),
            through: Vec::new(),
        }
    }

    pub fn set(&mut self, slice: &Slice, plane: &Plane, beam: &Beam) {
        let element_gap_m = &slice.element_gap_m;
        let loss_db = |i: usize| slice.element_loss_db.get(i).map_or(0.0, |&db| f64::from(db).max(0.0));
        let coupled = |i: usize| element_gap_m.get(i).is_none_or(|&gap| gap <= AIR_GAP_M);
        self.any_blind = self.enabled && (0..self.elements).any(|i| !coupled(i));
        self.any_weaker = self.any_blind || (self.enabled && (0..self.elements).any(|i| loss_db(i) > 0.0));
        for (by_column, value) in [
            (&mut self.blind, 0.0),
            (&mut self.ringing_shift_m, 0.0),
            (&mut self.band_spacing_m, LENS_M as f32),
        ] {
            by_column.clear();
            by_column.resize(plane.columns, value);
        }
        if !self.any_weaker {
            return;
        }
        for sums in [&mut self.coupled, &mut self.through] {
            sums.clear();
            sums.push(0.0);
        }
        for i in 0..self.elements {
            let touches = if coupled(i) { 1.0 } else { 0.0 };
            self.coupled.push(self.coupled[i] + touches);
            // Half of the loss each way.
            self.through.push(self.through[i] + touches * amplitude_from_db(-loss_db(i) / 2.0));
        }
        if !self.any_blind {
            return;
        }
        let face_m = beam.wanted_aperture_m(0.0);
        for column in 0..plane.columns {
            let x_m = plane.first_x_m + column as f64 * plane.spacing_m;
            let share = self.mean(&self.coupled, [x_m - face_m / 2.0, x_m + face_m / 2.0]);
            let (strength, shift_m) = ringing(x_m / self.pitch_m);
            self.blind[column] = (1.0 - share) * strength;
            self.ringing_shift_m[column] = shift_m;
            let element = (x_m / self.pitch_m + (self.elements as f64 - 1.0) / 2.0).max(0.0);
            let gap_m = |i: usize| f64::from(element_gap_m.get(i).copied().unwrap_or(0.0)).clamp(0.0, FILM_M);
            let (left, right) = (gap_m(element as usize), gap_m(element as usize + 1));
            self.band_spacing_m[column] =
                (LENS_M + left + (right - left) * (element - element.floor())) as f32;
        }
    }

    /// Mean of what `sums` adds up over the elements between two places; 1 where there are none.
    fn mean(&self, sums: &[f64], ends_m: [f64; 2]) -> f32 {
        let count = self.elements as f64;
        let [low, high] = ends_m.map(|x_m| (x_m / self.pitch_m + count / 2.0).clamp(0.0, count));
        if high - low < 1e-9 {
            return 1.0;
        }
        let before = |edge: f64| {
            let i = (edge as usize).min(self.elements - 1);
            sums[i] + (sums[i + 1] - sums[i]) * (edge - i as f64)
        };
        ((before(high) - before(low)) / (high - low)) as f32
    }

    /// Takes away what the blind and shadowed elements of one direction would have seen, knot by knot.
    pub fn shade(&self, direction: usize, plane: &Plane, wanted_m: f64, part: &mut [f32]) {
        debug_assert!(direction < DIRECTIONS);
        for (i, part) in part.iter_mut().enumerate() {
            *part *= self.mean(&self.through, part_of_aperture(direction, plane.knot_x_m(i), wanted_m));
        }
    }
}
