//! Where the needle stands in the way of the sound.
//!
//! Steel lets next to nothing through, but the aperture is taller than a needle: below it the sound that comes
//! from above and beneath it in elevation fills the shadow. A ray of each direction remembers the steel that it met last;
//! for a place farther down the aperture's height, seen from there, is h·(z − z_n)/z at the needle's depth z_n, and
//! the share of it that the steel covers is lost. Rays are counted by where they leave the face, in knots, and a place
//! lies between two of them.

use sonoloop_types::{Point, ProbeSpec, Slice};

use crate::{
    beam::Beam,
    march::{DIRECTIONS, offset},
    needle::Shaft,
    paths::Plane,
};

/// Share of the amplitude that steel takes away. [assumed] Its wall reflects 0.94; some sound goes round.
const OPACITY: f32 = 0.85;
/// The shadow begins so far below the steel's front wall, so that the wall's own echo is not in it. [assumed]
const BELOW_M: f64 = 0.6e-3;

/// Steel across a ray: its depth, what it covers in elevation, and of the ray's width.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cover {
    depth_m: f32,
    low_m: f32,
    high_m: f32,
    width: f32,
}

/// Covers nothing, and adds nothing to another's range.
const NO_COVER: Cover = Cover { depth_m: 0.0, low_m: f32::MAX, high_m: f32::MIN, width: 0.0 };

/// Steel that begins to shade at a row of knots.
struct Shade {
    row: usize,
    /// Ends across, in knots.
    ends: [f64; 2],
    cover: Cover,
}

pub struct Occlusion {
    element_height_m: f64,
    enabled: bool,
    /// By row.
    shades: Vec<Shade>,
    next: usize,
    /// Rays of a direction left of the first knot, and right of the last.
    margin: usize,
    /// By direction and ray.
    covers: Vec<Cover>,
    /// Share that is covered, of the rays of one direction.
    covered: Vec<f32>,
}

impl Occlusion {
    pub fn new(probe: &ProbeSpec) -> Self {
        Self {
            element_height_m: probe.element_height_m,
            enabled: probe.effects.needle_shadow,
            shades: Vec::new(),
            next: 0,
            margin: 0,
            covers: Vec::new(),
            covered: Vec::new(),
        }
    }

    /// Lists where the needle of a picture shades.
    pub fn trace(&mut self, beam: &Beam, slice: &Slice, shaft: &Shaft, plane: &Plane) {
        self.shades.clear();
        self.next = 0;
        self.covers.clear();
        let Some(needle) = slice.needle.as_ref().filter(|_| self.enabled) else { return };
        let probe_from_phantom = slice.phantom_from_probe.inverse();
        let line: Vec<Point> = needle.centreline_in_phantom.iter().map(|p| probe_from_phantom * p).collect();
        if line.iter().any(|p| !p.coords.iter().all(|v| v.is_finite())) {
            return;
        }
        let mut behind_tip_m = 0.0;
        for ends in line.windows(2).rev() {
            self.trace_piece([ends[0], ends[1]], behind_tip_m, shaft, plane);
            behind_tip_m += (ends[1] - ends[0]).norm();
        }
        self.shades.sort_by_key(|shade| shade.row);
        if self.any() {
            self.margin = (beam.half_cone() * plane.knots_down() as f64).ceil() as usize + 1;
            self.covers.resize(DIRECTIONS * self.rays(plane), NO_COVER);
        }
    }

    /// Cuts a straight piece, whose second end is so far behind the tip, into rows of knots.
    fn trace_piece(&mut self, [a, end]: [Point; 2], behind_tip_m: f64, shaft: &Shaft, plane: &Plane) {
        let (a, b) = if a.z <= end.z { (a, end) } else { (end, a) };
        let radius_m = shaft.radius_m;
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
            let middle = from + (to - from) / 2.0;
            let radius_m = shaft.wall_m(behind_tip_m + (middle - end).norm());
            // What is beside the picture casts no shadow into it.
            let most = (plane.knots_across() - 1) as f64 + 0.5;
            let place = |x_m: f64| ((x_m - plane.first_x_m) / plane.step_m()).clamp(-0.5, most);
            let ends = [place(from.x.min(to.x) - radius_m), place(from.x.max(to.x) + radius_m)];
            if ends[0] >= ends[1] {
                continue;
            }
            let depth_m = middle.z;
            self.shades.push(Shade {
                row: ((depth_m - radius_m + BELOW_M) / step_m).ceil().max(0.0) as usize,
                ends,
                cover: Cover {
                    depth_m: depth_m as f32,
                    low_m: (from.y.min(to.y) - radius_m) as f32,
                    high_m: (from.y.max(to.y) + radius_m) as f32,
                    width: 1.0,
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

    fn rays(&self, plane: &Plane) -> usize {
        plane.knots_across() + 2 * self.margin
    }

    /// Goes on to a row of knots, the one below that of the call before.
    pub fn reach_row(&mut self, row: usize, beam: &Beam, plane: &Plane) {
        let rays = self.rays(plane);
        while let Some(shade) = self.shades.get(self.next).filter(|shade| shade.row <= row) {
            for direction in 0..DIRECTIONS {
                let first_ray = first_ray(direction, row, beam) + self.margin as f64;
                let [low, high] = shade.ends.map(|end| end + first_ray);
                // Ray j is as wide as from j − ½ to j + ½.
                let (first, last) = ((low + 0.5) as usize, ((high + 0.5) as usize).min(rays - 1));
                let covers = &mut self.covers[direction * rays..][..rays];
                for (j, cover) in covers.iter_mut().enumerate().take(last + 1).skip(first) {
                    let [left, right] = [j as f64 - 0.5, j as f64 + 0.5];
                    let width = (high.min(right) - low.max(left)).max(0.0) as f32;
                    let Cover { depth_m, low_m, high_m, .. } = shade.cover;
                    *cover = Cover {
                        depth_m,
                        low_m: low_m.min(cover.low_m),
                        high_m: high_m.max(cover.high_m),
                        width: width.max(cover.width),
                    };
                }
            }
            self.next += 1;
        }
    }

    /// Takes away what the steel hides from one direction at a row of knots so far down, knot by knot.
    #[inline(always)]
    pub fn shade(&mut self, direction: usize, row: usize, beam: &Beam, depth_m: f64, part: &mut [f32]) {
        // One way the beam is √2 thicker than both ways together.
        let thickness_m = (core::f64::consts::SQRT_2 * beam.thickness_m(depth_m)) as f32;
        let (height_m, per_depth) = (self.element_height_m as f32, (1.0 / depth_m) as f32);
        let place = first_ray(direction, row, beam) + self.margin as f64;
        let (first, past) = (place as usize, (place - place as usize as f64) as f32);
        let rays = part.len() + 2 * self.margin;
        let covers = &self.covers[direction * rays + first..][..part.len() + 1];
        self.covered.clear();
        self.covered.extend(covers.iter().map(|cover| {
            let cone_m = height_m * (1.0 - cover.depth_m * per_depth);
            let width_m = if cone_m > thickness_m { cone_m } else { thickness_m };
            let half_m = 0.5 * width_m;
            let low_m = if cover.low_m > -half_m { cover.low_m } else { -half_m };
            let high_m = if cover.high_m < half_m { cover.high_m } else { half_m };
            let covered_m = if high_m > low_m { high_m - low_m } else { 0.0 };
            cover.width * OPACITY * covered_m / width_m
        }));
        for (part, covered) in part.iter_mut().zip(self.covered.windows(2)) {
            *part *= 1.0 - (covered[0] + past * (covered[1] - covered[0]));
        }
    }
}

/// Which ray of a direction meets knot 0 of a row; the ray that leaves the face at knot j is number j.
fn first_ray(direction: usize, row: usize, beam: &Beam) -> f64 {
    offset(direction) * beam.half_cone() * row as f64
}
