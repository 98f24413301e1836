//! Where the needle stands in the way of the sound.
//!
//! Steel lets next to nothing through, but the aperture is taller than a needle: below it the sound that comes
//! from above and beneath it in elevation fills the shadow. A direction remembers the steel that it met last; for a
//! place farther down the aperture's height, seen from there, is h·(z − z_n)/z at the needle's depth z_n, and
//! the share of it that the steel covers is lost.

use sonoloop_types::{Point, ProbeSpec, Slice};

use crate::{
    beam::Beam,
    march::{DIRECTIONS, offset},
    paths::Plane,
};

/// Share of the amplitude that steel takes away. [assumed] Its wall reflects 0.94; some sound goes round.
const OPACITY: f32 = 0.85;
/// The shadow begins so far below the steel, under its reverberations. [assumed]
const BELOW_M: f64 = 0.4e-3;

/// Steel across a direction: its depth and what it covers in elevation.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cover {
    depth_m: f32,
    low_m: f32,
    high_m: f32,
}

/// Covers nothing, and adds nothing to another's range.
const NO_COVER: Cover = Cover { depth_m: 0.0, low_m: f32::MAX, high_m: f32::MIN };

/// Steel that begins to shade at a row of knots.
struct Shade {
    row: usize,
    knots: [usize; 2],
    cover: Cover,
}

pub struct Occlusion {
    element_height_m: f64,
    enabled: bool,
    /// By row.
    shades: Vec<Shade>,
    next: usize,
    /// By direction and knot.
    covers: Vec<Cover>,
    before: Vec<Cover>,
}

impl Occlusion {
    pub fn new(probe: &ProbeSpec) -> Self {
        Self {
            element_height_m: probe.element_height_m,
            enabled: probe.effects.needle_shadow,
            shades: Vec::new(),
            next: 0,
            covers: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Lists where the needle of a picture shades.
    pub fn trace(&mut self, slice: &Slice, diameter_m: f64, plane: &Plane) {
        self.shades.clear();
        self.next = 0;
        self.covers.clear();
        let Some(needle) = slice.needle.as_ref().filter(|_| self.enabled) else { return };
        let probe_from_phantom = slice.phantom_from_probe.inverse();
        let line: Vec<Point> = needle.centreline_in_phantom.iter().map(|p| probe_from_phantom * p).collect();
        if line.iter().any(|p| !p.coords.iter().all(|v| v.is_finite())) {
            return;
        }
        for ends in line.windows(2) {
            self.trace_piece([ends[0], ends[1]], diameter_m / 2.0, plane);
        }
        self.shades.sort_by_key(|shade| shade.row);
        if self.any() {
            self.covers.resize(DIRECTIONS * plane.knots_across(), NO_COVER);
        }
    }

    /// Cuts a straight piece into rows of knots.
    fn trace_piece(&mut self, [a, b]: [Point; 2], radius_m: f64, plane: &Plane) {
        let (a, b) = if a.z <= b.z { (a, b) } else { (b, a) };
        let step_m = plane.step_m();
        let deepest_m = step_m * (plane.knots_down() - 1) as f64;
        let reach_m = self.element_height_m / 2.0 + radius_m;
        if b.z <= 0.0 || a.z >= deepest_m || a.y.min(b.y) > reach_m || a.y.max(b.y) < -reach_m {
            return;
        }
        let at = |z_m: f64| {
            let share = if b.z - a.z > 1e-9 { ((z_m - a.z) / (b.z - a.z)).clamp(0.0, 1.0) } else { 0.0 };
            a + (b - a) * share
        };
        let (first, last) = ((a.z.max(0.0) / step_m) as usize, (b.z.min(deepest_m) / step_m) as usize);
        for row in first..=last {
            let (from, to) = if b.z - a.z > 1e-9 {
                (at(row as f64 * step_m), at((row + 1) as f64 * step_m))
            } else {
                (a, b)
            };
            let place = |x_m: f64| (x_m - plane.first_x_m) / plane.step_m();
            let last = (plane.knots_across() - 1) as f64;
            let left = place(from.x.min(to.x) - radius_m).ceil().max(0.0);
            let right = place(from.x.max(to.x) + radius_m).floor().min(last);
            if right < left {
                continue;
            }
            let depth_m = (from.z + to.z) / 2.0;
            self.shades.push(Shade {
                row: ((depth_m + radius_m + BELOW_M) / step_m).ceil() as usize,
                knots: [left as usize, right as usize + 1],
                cover: Cover {
                    depth_m: depth_m as f32,
                    low_m: (from.y.min(to.y) - radius_m) as f32,
                    high_m: (from.y.max(to.y) + radius_m) as f32,
                },
            });
        }
    }

    /// True when the needle shades anything.
    pub fn any(&self) -> bool {
        !self.shades.is_empty()
    }

    /// True when some place so far down is shaded.
    pub fn begun(&self) -> bool {
        self.next > 0
    }

    /// Goes on to a row of knots, the one below that of the call before.
    pub fn reach_row(&mut self, row: usize, beam: &Beam, plane: &Plane) {
        if !self.any() {
            return;
        }
        let across = plane.knots_across();
        for direction in 0..DIRECTIONS {
            // Whole knots, rounded so that they add up to the direction's slope.
            let slope = offset(direction) * beam.half_cone();
            let shift = (slope * row as f64).round() - (slope * (row as f64 - 1.0)).round();
            let covers = &mut self.covers[direction * across..][..across];
            if row > 0 && shift != 0.0 {
                self.before.clear();
                self.before.extend_from_slice(covers);
                for (i, cover) in covers.iter_mut().enumerate() {
                    let from = (i as i64 + shift as i64).clamp(0, across as i64 - 1);
                    *cover = self.before[from as usize];
                }
            }
        }
        while let Some(shade) = self.shades.get(self.next).filter(|shade| shade.row <= row) {
            for direction in 0..DIRECTIONS {
                for cover in &mut self.covers[direction * across..][shade.knots[0]..shade.knots[1]] {
                    let Cover { depth_m, low_m, high_m } = shade.cover;
                    *cover =
                        Cover { depth_m, low_m: low_m.min(cover.low_m), high_m: high_m.max(cover.high_m) };
                }
            }
            self.next += 1;
        }
    }

    /// Takes away what the steel hides from one direction at a depth, knot by knot.
    pub fn shade(&self, direction: usize, beam: &Beam, depth_m: f64, part: &mut [f32]) {
        // One way the beam is √2 thicker than both ways together.
        let thickness_m = (core::f64::consts::SQRT_2 * beam.thickness_m(depth_m)) as f32;
        let (height_m, per_depth) = (self.element_height_m as f32, (1.0 / depth_m) as f32);
        let covers = &self.covers[direction * part.len()..][..part.len()];
        for (part, cover) in part.iter_mut().zip(covers) {
            let cone_m = height_m * (1.0 - cover.depth_m * per_depth);
            let width_m = if cone_m > thickness_m { cone_m } else { thickness_m };
            let (half_m, low_m) =
                (0.5 * width_m, if cover.low_m > -0.5 * width_m { cover.low_m } else { -0.5 * width_m });
            let high_m = if cover.high_m < half_m { cover.high_m } else { half_m };
            let covered_m = if high_m > low_m { high_m - low_m } else { 0.0 };
            *part *= 1.0 - OPACITY * covered_m / width_m;
        }
    }
}
