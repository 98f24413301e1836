//! What each display line loses on the way: attenuation through the materials, and blind elements.

use sonoloop_types::{Point, Pose, ProbeSpec};

use crate::{
    beam::{Beam, amplitude_from_db},
    columns::Columns,
    lattice::Lattice,
};

/// Pixels between knots of the map, down and across.
const KNOT: usize = 8;
const KNOT_ACROSS: usize = 16;
/// Samples of the materials between two knots along depth.
const SAMPLES: usize = 2;
/// A gap above this is air: it reflects all. Below it is rounding.
const AIR_GAP_M: f32 = 1e-7;

/// Amplitude of the field by depth knot and column, and how blind each column is at the face.
#[derive(Default)]
pub struct GainMap {
    columns: usize,
    /// One row of `columns` amplitudes per knot.
    amplitude: Vec<f32>,
    /// Share of the near aperture that is blind, per column.
    pub blind: Vec<f32>,
    /// True when any element is blind.
    pub any_blind: bool,
    loss_db: Vec<f64>,
    once: Vec<f64>,
    twice: Vec<f64>,
}

/// The plane that the map covers.
pub struct Plane<'a> {
    pub phantom_from_probe: &'a Pose,
    pub columns: usize,
    pub rows: usize,
    pub first_x_m: f64,
    pub spacing_m: f64,
}

impl GainMap {
    pub fn build(
        &mut self,
        beam: &Beam,
        probe: &ProbeSpec,
        lattice: &Lattice,
        tissue: &mut Columns,
        plane: &Plane,
        element_gap_m: &[f32],
    ) {
        self.columns = plane.columns;
        let across = plane.columns.div_ceil(KNOT_ACROSS) + 1;
        let knots = plane.rows / KNOT + 2;
        self.amplitude.resize(knots * plane.columns, 0.0);
        self.loss_db.clear();
        self.loss_db.resize(across, 0.0);
        let step_m = KNOT as f64 * plane.spacing_m / SAMPLES as f64;
        let pose_is_finite = plane.phantom_from_probe.to_homogeneous().iter().all(|v| v.is_finite());
        for (knot, row) in self.amplitude.chunks_exact_mut(plane.columns).enumerate() {
            let mut right = 0.0;
            for (i, loss_db) in self.loss_db.iter_mut().enumerate() {
                let x_m = plane.first_x_m + (i * KNOT_ACROSS) as f64 * plane.spacing_m;
                if knot > 0 && pose_is_finite {
                    for sample in 0..SAMPLES {
                        let z_m = ((knot - 1) * SAMPLES + sample) as f64 * step_m + step_m / 2.0;
                        let point = plane.phantom_from_probe * Point::new(x_m, 0.0, z_m);
                        *loss_db += step_m * attenuation_db_m(lattice, tissue, &point);
                    }
                }
                let left = right;
                right = amplitude_from_db(-*loss_db) as f32;
                if i > 0 {
                    let first = (i - 1) * KNOT_ACROSS;
                    let part = &mut row[first..plane.columns.min(i * KNOT_ACROSS)];
                    for (j, a) in part.iter_mut().enumerate() {
                        *a = left + (right - left) * (j as f32 / KNOT_ACROSS as f32);
                    }
                }
            }
        }
        self.apply_contact(beam, probe, plane, element_gap_m);
    }

    /// Amplitudes at the knots above and below a display row, and how far it lies between them.
    pub fn row(&self, row: usize) -> (&[f32], &[f32], f32) {
        let (knot, below) = (row / KNOT, row % KNOT);
        let (above, rest) = self.amplitude[knot * self.columns..].split_at(self.columns);
        (above, &rest[..self.columns], below as f32 / KNOT as f32)
    }

    /// Blind elements neither send nor hear: the field falls with the square of the coupled share of the
    /// active aperture, weighted by a triangle.
    fn apply_contact(&mut self, beam: &Beam, probe: &ProbeSpec, plane: &Plane, element_gap_m: &[f32]) {
        let elements = probe.elements as usize;
        let coupled = |i: usize| element_gap_m.get(i).is_none_or(|&gap| gap <= AIR_GAP_M);
        self.any_blind = (0..elements).any(|i| !coupled(i));
        self.blind.clear();
        self.blind.resize(plane.columns, 0.0);
        if !self.any_blind {
            return;
        }
        // once[i]: coupled elements left of edge i; twice: its running integral. The triangle's weighted sum is
        // a second difference of the latter.
        self.once.clear();
        self.twice.clear();
        self.once.push(0.0);
        self.twice.push(0.0);
        for i in 0..elements {
            let (a, b) = (self.once[i], self.twice[i]);
            let here = if coupled(i) { 1.0 } else { 0.0 };
            self.once.push(a + here);
            self.twice.push(b + a + here / 2.0);
        }
        let coupled_share = |x_m: f64, half_width_m: f64| {
            let at = |x: f64| (x + beam.half_aperture_m) / probe.pitch_m;
            let [l, m, r] = [x_m - half_width_m, x_m, x_m + half_width_m].map(at);
            let n = elements as f64;
            let seen = second_difference(|u| integral(&self.twice, &self.once, u), l, m, r);
            let all = second_difference(
                |u| {
                    let v = u.clamp(0.0, n);
                    v * v / 2.0 + n * (u - v).max(0.0)
                },
                l,
                m,
                r,
            );
            if all > 0.0 { (seen / all).clamp(0.0, 1.0) } else { 0.0 }
        };
        for (knot, row) in self.amplitude.chunks_exact_mut(plane.columns).enumerate() {
            let half_m = beam.wanted_aperture_m((knot * KNOT) as f64 * plane.spacing_m) / 2.0;
            for (j, a) in row.iter_mut().enumerate() {
                let share = coupled_share(plane.first_x_m + j as f64 * plane.spacing_m, half_m);
                *a *= (share * share) as f32;
            }
        }
        let face_m = beam.wanted_aperture_m(0.0) / 2.0;
        for (j, blind) in self.blind.iter_mut().enumerate() {
            let x_m = plane.first_x_m + j as f64 * plane.spacing_m;
            *blind = (1.0 - coupled_share(x_m, face_m)) as f32;
        }
    }
}

fn second_difference(f: impl Fn(f64) -> f64, l: f64, m: f64, r: f64) -> f64 {
    f(l) - 2.0 * f(m) + f(r)
}

/// ∫ of the running sum up to edge `u`, linear between edges, continued beyond the array's ends.
fn integral(twice: &[f64], once: &[f64], u: f64) -> f64 {
    let last = twice.len() - 1;
    if u <= 0.0 {
        return 0.0;
    }
    if u >= last as f64 {
        return twice[last] + once[last] * (u - last as f64);
    }
    let i = u as usize;
    let f = u - i as f64;
    twice[i] + once[i] * f + (once[i + 1] - once[i]) * f * f / 2.0
}

fn attenuation_db_m(lattice: &Lattice, tissue: &mut Columns, point_in_phantom: &Point) -> f64 {
    let [ix, iy] = lattice.nearest(point_in_phantom.x, point_in_phantom.y);
    let n = (-point_in_phantom.z / lattice.depth_step_m).floor();
    let range = tissue.get(ix, iy);
    let stretches = tissue.stretches(range).iter();
    stretches
        .filter(|s| f64::from(s.start) <= n && n < f64::from(s.end))
        .map(|s| f64::from(s.attenuation_db_m))
        .sum()
}
