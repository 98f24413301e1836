//! The same field by direct summation in double precision: every scatterer, every pixel it reaches.
//!
//! It shares with the fast renderer what defines the scene (beam widths, lattice, tape, needle echoes) and
//! nothing of how the sum is done. Seconds per picture; for tests.

use sonoloop_types::{Drag, Indentation, NeedleSpec, Point, ProbeSpec, Slice, Tissue, Vector};

use crate::{
    beam::{Beam, amplitude_from_db, unit_energy_peak},
    columns::Columns,
    instructions::Instructions,
    lattice::{Lattice, TAPE_LENGTH},
    motion::Motion,
    needle::{NeedleEchoes, Shaft},
    paths::Paths,
    renderer::Frame,
    shear::Shear,
    tape::{BakedTape, gaussian_tape},
};

/// Profiles are summed out to this many σ (amplitude 4e-5).
const REACH: f64 = 4.5;

struct Canvas<'a> {
    beam: &'a Beam,
    paths: &'a Paths,
    frame: Frame,
    values: Vec<[f64; 2]>,
}

impl Canvas<'_> {
    /// Adds a point with complex amplitude `(re, im)`; `energy` scales the profiles to unit energy instead of
    /// unit peak.
    fn add(&mut self, x_m: f64, z_m: f64, [re, im]: [f64; 2], energy: bool) {
        let Frame { geometry, columns, first_x_m, .. } = self.frame;
        let spacing_m = geometry.spacing_m;
        let longest_m = self.beam.most_sigma_axial_m();
        // A bound on σ_l for finding the window; the width itself belongs to the line.
        let width_m = |x_m: f64| {
            self.beam.sigma_lateral_m * self.beam.widening(x_m, z_m) * self.paths.stretch(x_m, z_m)
        };
        let widest_m = self.beam.sigma_lateral_m
            * Paths::most_stretch()
            * self.beam.widening(x_m, z_m).max(self.beam.widening(x_m * 1.2, z_m)).min(4.0)
            * 1.2;
        let left = ((x_m - REACH * widest_m - first_x_m) / spacing_m).ceil().max(0.0) as usize;
        let right = (x_m + REACH * widest_m - first_x_m) / spacing_m;
        if right < 0.0 {
            return;
        }
        let lateral: Vec<f64> = (left..columns.min(right as usize + 1))
            .map(|j| {
                let u_m = first_x_m + j as f64 * spacing_m;
                let of_m = if energy { u_m } else { x_m };
                let sigma_m = width_m(of_m);
                let d = (u_m - x_m) / sigma_m;
                // Level over speckle falls as a point's energy spreads.
                let point = || 1.0 / self.paths.stretch(x_m, z_m).sqrt();
                libm::exp(-0.5 * d * d) * if energy { unit_energy_peak(sigma_m) } else { point() }
            })
            .collect();
        // Drawn, and turned, by the time that echoes take on their line; all lines alike without delays.
        let mut axial: Vec<[f64; 2]> = Vec::new();
        let mut top = 0;
        for (j, l) in (left..).zip(&lateral) {
            if j == left || self.paths.any_delay {
                let late_m = self.paths.delay_m(first_x_m + j as f64 * spacing_m, z_m);
                let (sin, cos) = libm::sincos(-self.beam.two_k_rad_m * late_m);
                let amplitude = [re * cos - im * sin, re * sin + im * cos];
                let shown_m = z_m + late_m;
                top = ((shown_m - REACH * longest_m) / spacing_m).ceil().max(0.0) as usize;
                let end = ((shown_m + REACH * longest_m) / spacing_m + 1.0).max(0.0) as usize;
                axial.clear();
                axial.extend((top..self.frame.rows().min(end)).map(|row| {
                    // The row's pulse for speckle, as its line's width; an echo's own for the needle.
                    let row_m = row as f64 * spacing_m;
                    let sigma_z_m = self.beam.sigma_axial_at_m(if energy { row_m } else { z_m });
                    let d = (row_m - shown_m) / sigma_z_m;
                    let peak = if energy { unit_energy_peak(sigma_z_m) } else { 1.0 };
                    amplitude.map(|part| part * peak * libm::exp(-0.5 * d * d))
                }));
            }
            for (row, [re, im]) in (top..).zip(&axial) {
                let value = &mut self.values[row * columns + j];
                value[0] += re * l;
                value[1] += im * l;
            }
        }
    }
}

/// The complex field of [`crate::Renderer::field`], row by row over the displayed columns.
pub fn field(
    probe: &ProbeSpec,
    needle: &NeedleSpec,
    tissue: &Tissue,
    seed: u64,
    slice: &Slice,
) -> Vec<[f64; 2]> {
    let beam = Beam::new(probe);
    let lattice = Lattice::new(&beam, seed);
    let frame = Frame::new(probe);
    let tape = gaussian_tape(seed, 1, TAPE_LENGTH);
    let mut paths = Paths::new(&beam, probe, frame.plane());
    let mut columns = Columns::new(tissue.clone(), lattice, probe);
    let half = columns.half();
    let places = || (-half[1]..half[1]).flat_map(|iy| (-half[0]..half[0]).map(move |ix| [ix, iy]));
    (-half[1]..half[1]).for_each(|iy| columns.learn(-half[0]..half[0], iy));
    let indentation = slice.indentation.filter(Indentation::is_sound);
    let drag = slice.drag.filter(Drag::is_sound);
    let moves = indentation.is_some() || drag.is_some();
    let motion = moves.then(|| Motion::new(indentation.as_ref(), drag));
    paths.sample(Instructions::PLAIN, &lattice, &columns, Some(&slice.phantom_from_probe), motion.as_ref());
    paths.build(Instructions::PLAIN, &beam, slice, &Shaft::new(needle));
    // Asked for which columns are left out where, and nothing else.
    let shear = Shear::new(&slice.phantom_from_probe, &beam, &lattice, &frame.geometry, 0.0, None, half);
    let mut canvas =
        Canvas { beam: &beam, paths: &paths, frame, values: vec![[0.0; 2]; frame.rows() * frame.columns] };

    let probe_from_phantom = slice.phantom_from_probe.inverse();
    let mut segments = Vec::new();
    for ([ix, iy], thinning) in places().flat_map(|place| shear.iter().map(move |s| (place, s.thinning))) {
        let class = thinning.class(ix, iy);
        let [x_m, y_m] = lattice.column_m(ix, iy);
        tissue.column(x_m, y_m, &mut segments);
        let offset = lattice.tape_offset(ix, iy);
        for segment in &segments {
            let material = &tissue.materials()[usize::from(segment.material)];
            let Some(backscatter_db) = material.backscatter_db.filter(|_| probe.effects.speckle) else {
                continue;
            };
            let strength = lattice.amplitude() * amplitude_from_db(backscatter_db);
            let mut n = 0u32;
            loop {
                let z_m = -(f64::from(n) + 0.5) * lattice.depth_step_m;
                if z_m <= segment.bottom_z_m {
                    break;
                }
                let index = (offset + n as usize) % TAPE_LENGTH;
                n += 1;
                if z_m > segment.top_z_m {
                    continue;
                }
                let rest = Point::new(x_m, y_m, z_m);
                let moved_m = indentation.map_or(Vector::zeros(), |i| i.displacement_m(rest))
                    + drag.map_or(Vector::zeros(), |drag| drag.displacement_m(rest));
                let p = probe_from_phantom * (rest + moved_m);
                if p.z < 0.0 || p.z > frame.deepest_m() + REACH * beam.most_sigma_axial_m() {
                    continue;
                }
                let sigma_e_m = beam.sigma_elevation_m(p.z);
                let u = p.y / sigma_e_m;
                if u.abs() > REACH || p.x.abs() > beam.half_aperture_m + 5e-3 {
                    continue;
                }
                let strength = strength * thinning.gain(class, beam.steady_sigma_m(p.z));
                let weight = strength * unit_energy_peak(sigma_e_m) * libm::exp(-0.5 * u * u);
                let (sin, cos) = libm::sincos(-beam.two_k_rad_m * p.z);
                let [re, im] = tape[index].map(f64::from);
                let value = [weight * (re * cos - im * sin), weight * (re * sin + im * cos)];
                canvas.add(p.x, p.z, value, true);
            }
        }
    }

    let mut echoes = NeedleEchoes::new(needle, &beam, probe, seed);
    echoes.build(&beam, &BakedTape::new(seed), slice);
    for echo in &echoes.echoes {
        canvas.add(echo.x_m, echo.z_m + echo.late_m, echo.baseband(&beam, 0.0), false);
    }
    canvas.values
}
