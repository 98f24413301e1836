//! The phantom: which material lies where, for the needle point by point, for the renderer as columns under the top face.
//!
//! A column is a vertical ray. Every inclusion is convex, so two parry ray casts, one from above and one
//! from below, give the ends of its stretch. Only balls and boxes are cast, which parry solves in closed
//! form: an ellipsoid is a unit ball in stretched coordinates, a cylinder is a disc that meets a slab. parry
//! works in f32; rays begin next to the inclusion, so that the ends are good to some nanometres.

use parry3d::math::Vector as Vector32;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::{Ball, Cuboid};
use sonoloop_scenario::{Inclusion, PassageSpec, PhantomSpec, Shape};
use sonoloop_types::{ColumnSegment, Point, Pose, Tissue, Vector};

/// Wider than any phantom: the open sides of the slab that closes a cylinder.
const WIDE_M: f64 = 10.0;

/// One convex body that all rays through an inclusion must meet.
#[derive(Debug, Clone)]
enum Part {
    /// Unit ball in coordinates scaled by these factors (0 drops a coordinate: an endless cylinder).
    Ball([f64; 3]),
    /// Box of these half edges.
    Box(Cuboid),
}

#[derive(Debug, Clone)]
struct Body {
    parts: Vec<Part>,
    inclusion_from_phantom: Pose,
    centre_in_phantom: Point,
    bounding_radius_m: f64,
    material: u16,
}

/// The undeformed phantom as a needle meets it, in f64 and straight from the definition of the shapes.
#[derive(Debug, Clone)]
pub(crate) struct Anatomy {
    size_m: [f64; 3],
    background: u16,
    /// The last first.
    bodies: Vec<(Shape, Pose, u16)>,
    passages: Vec<Option<PassageSpec>>,
}

impl Anatomy {
    pub(crate) fn new(spec: &PhantomSpec) -> Self {
        let body = |i: &Inclusion| (i.shape, i.phantom_from_inclusion.inverse(), i.material);
        Self {
            size_m: spec.size_m,
            background: spec.background,
            bodies: spec.inclusions.iter().rev().map(body).collect(),
            passages: spec.materials.iter().map(|material| material.needle).collect(),
        }
    }

    /// The material that a point lies in; `None` outside the phantom.
    pub(crate) fn material_at(&self, point: &Point) -> Option<u16> {
        let [x, y, z] = self.size_m;
        let beside = point.x.abs() > x / 2.0 || point.y.abs() > y / 2.0;
        if beside || point.z > 0.0 || point.z < -z {
            return None;
        }
        let around = |(shape, inclusion_from_phantom, _): &&(Shape, Pose, u16)| {
            let p = inclusion_from_phantom * point;
            match *shape {
                Shape::Ellipsoid { radii_m: [a, b, c] } => {
                    let [u, v, w] = [p.x / a, p.y / b, p.z / c];
                    u * u + v * v + w * w <= 1.0
                }
                Shape::Cylinder { radius_m, length_m } => {
                    p.x * p.x + p.y * p.y <= radius_m * radius_m && p.z.abs() <= length_m / 2.0
                }
                Shape::Cuboid { size_m } => {
                    p.coords.iter().zip(size_m).all(|(value, size)| value.abs() <= size / 2.0)
                }
            }
        };
        Some(self.bodies.iter().find(around).map_or(self.background, |body| body.2))
    }

    /// How a needle gets through a material; `None` where none does.
    pub(crate) fn passage(&self, material: u16) -> Option<&PassageSpec> {
        self.passages[usize::from(material)].as_ref()
    }
}

/// Materials and columns of the undeformed phantom.
pub fn tissue(spec: &PhantomSpec) -> Tissue {
    let [size_x, size_y, size_z] = spec.size_m;
    let background = spec.background;
    let bodies: Vec<Body> = spec.inclusions.iter().map(Body::new).collect();
    let materials = spec.materials.iter().map(|m| m.acoustics).collect();
    Tissue::new(spec.size_m, materials, move |x, y, out| {
        out.clear();
        if x.abs() > size_x / 2.0 || y.abs() > size_y / 2.0 {
            return;
        }
        out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: -size_z, material: background });
        for body in &bodies {
            if let Some((top_z_m, bottom_z_m)) = body.stretch(x, y) {
                let (top_z_m, bottom_z_m) = (top_z_m.min(0.0), bottom_z_m.max(-size_z));
                if top_z_m > bottom_z_m {
                    overlay(out, ColumnSegment { top_z_m, bottom_z_m, material: body.material });
                }
            }
        }
    })
}

/// Lays `new` over the segments: what it covers is replaced.
fn overlay(segments: &mut Vec<ColumnSegment>, new: ColumnSegment) {
    let first = segments.partition_point(|s| s.bottom_z_m >= new.top_z_m);
    let last = segments.partition_point(|s| s.top_z_m > new.bottom_z_m) - 1;
    let (above, below) = (segments[first], segments[last]);
    let above = ColumnSegment { bottom_z_m: new.top_z_m, ..above };
    let below = ColumnSegment { top_z_m: new.bottom_z_m, ..below };
    let pieces = [above, new, below];
    segments.splice(first..=last, pieces.into_iter().filter(|s| s.top_z_m > s.bottom_z_m));
}

impl Body {
    fn new(inclusion: &Inclusion) -> Self {
        let (parts, bounding_radius_m) = match inclusion.shape {
            Shape::Ellipsoid { radii_m: [a, b, c] } => {
                (vec![Part::Ball([1.0 / a, 1.0 / b, 1.0 / c])], a.max(b).max(c))
            }
            Shape::Cuboid { size_m: [a, b, c] } => {
                (vec![cuboid([a / 2.0, b / 2.0, c / 2.0])], (a * a + b * b + c * c).sqrt() / 2.0)
            }
            Shape::Cylinder { radius_m, length_m } => (
                vec![
                    Part::Ball([1.0 / radius_m, 1.0 / radius_m, 0.0]),
                    cuboid([WIDE_M, WIDE_M, length_m / 2.0]),
                ],
                (radius_m * radius_m + length_m * length_m / 4.0).sqrt(),
            ),
        };
        Self {
            parts,
            inclusion_from_phantom: inclusion.phantom_from_inclusion.inverse(),
            centre_in_phantom: Point::from(inclusion.phantom_from_inclusion.translation.vector),
            bounding_radius_m,
            material: inclusion.material,
        }
    }

    /// Upper and lower z at which the vertical line through (x, y) enters and leaves the body.
    fn stretch(&self, x_m: f64, y_m: f64) -> Option<(f64, f64)> {
        let centre = self.centre_in_phantom;
        let (dx, dy) = (x_m - centre.x, y_m - centre.y);
        if dx * dx + dy * dy >= self.bounding_radius_m * self.bounding_radius_m {
            return None;
        }
        let length_m = 2.2 * self.bounding_radius_m;
        let start_in_phantom = Point::new(x_m, y_m, centre.z + length_m / 2.0);
        let start = self.inclusion_from_phantom * start_in_phantom;
        let down = self.inclusion_from_phantom * -Vector::z();
        let (mut enter, mut leave) = (0.0f64, length_m);
        for part in &self.parts {
            let (part_enter, part_leave) = part.stretch(&start, &down, length_m)?;
            enter = enter.max(part_enter);
            leave = leave.min(part_leave);
        }
        (enter < leave).then(|| (start_in_phantom.z - enter, start_in_phantom.z - leave))
    }
}

impl Part {
    /// Lengths along the ray at which it enters and leaves; the ray begins and ends as it may.
    fn stretch(&self, start: &Point, direction: &Vector, length_m: f64) -> Option<(f64, f64)> {
        let end = start + direction * length_m;
        let scale = match self {
            Self::Ball(scale) => *scale,
            Self::Box(_) => [1.0; 3],
        };
        let narrow = |x: f64, y: f64, z: f64| {
            Vector32::new((x * scale[0]) as f32, (y * scale[1]) as f32, (z * scale[2]) as f32)
        };
        let forward =
            Ray::new(narrow(start.x, start.y, start.z), narrow(direction.x, direction.y, direction.z));
        let backward = Ray::new(narrow(end.x, end.y, end.z), -forward.dir);
        let cast = |ray: &Ray| match self {
            Self::Ball(_) => Ball::new(1.0).cast_local_ray(ray, length_m as f32, true),
            Self::Box(cuboid) => cuboid.cast_local_ray(ray, length_m as f32, true),
        };
        let (enter, rest) = (cast(&forward)?, cast(&backward)?);
        Some((f64::from(enter), length_m - f64::from(rest)))
    }
}

fn cuboid(half_m: [f64; 3]) -> Part {
    Part::Box(Cuboid::new(Vector32::new(half_m[0] as f32, half_m[1] as f32, half_m[2] as f32)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use sonoloop_types::Acoustics;

    use super::*;
    use crate::fixture;

    fn crowded() -> PhantomSpec {
        let mut spec = fixture::phantom();
        let acoustics = Acoustics { backscatter_db: None, ..spec.materials[0].acoustics };
        for name in ["b", "c", "d"] {
            let mut material = spec.materials[0].clone();
            material.name = name.into();
            material.acoustics = acoustics;
            spec.materials.push(material);
        }
        let at = |x: f64, y: f64, z: f64, roll: f64, pitch: f64| {
            Pose::from_parts(
                Vector::new(x, y, z).into(),
                nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, 0.3),
            )
        };
        let add = |shape, pose, material| Inclusion {
            name: "test".into(),
            shape,
            phantom_from_inclusion: pose,
            material,
        };
        spec.inclusions = vec![
            add(Shape::Ellipsoid { radii_m: [0.02, 0.01, 0.006] }, at(0.0, 0.0, -0.02, 0.4, 0.2), 1),
            add(Shape::Cylinder { radius_m: 0.006, length_m: 0.06 }, at(0.0, 0.0, -0.025, 1.4, 0.1), 2),
            add(Shape::Cylinder { radius_m: 0.004, length_m: 0.02 }, at(0.02, 0.01, -0.03, 0.0, 0.0), 1),
            add(Shape::Cuboid { size_m: [0.03, 0.01, 0.012] }, at(-0.01, 0.005, -0.002, 0.2, 0.5), 3),
            add(Shape::Ellipsoid { radii_m: [0.008; 3] }, at(0.0, 0.0, -0.058, 0.0, 0.0), 2),
        ];
        spec
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

        #[test]
        fn truth_columns_agree_with_point_in_shape(
            x in -0.04..0.04f64, y in -0.03..0.03f64, z in -0.06..0.0f64,
        ) {
            let spec = crowded();
            let mut out = Vec::new();
            tissue(&spec).column(x, y, &mut out);
            // No gaps, from the top down, over the whole thickness.
            prop_assert_eq!(out[0].top_z_m, 0.0);
            prop_assert_eq!(out[out.len() - 1].bottom_z_m, -spec.size_m[2]);
            prop_assert!(out.windows(2).all(|w| w[0].bottom_z_m == w[1].top_z_m));
            prop_assert!(out.iter().all(|s| s.top_z_m > s.bottom_z_m));
            let segment = out.iter().find(|s| s.bottom_z_m <= z).unwrap();
            // Within 0.1 µm of an end either answer is right: the rays are f32.
            if (segment.top_z_m - z).min(z - segment.bottom_z_m) > 1e-7 {
                prop_assert_eq!(Some(segment.material), Anatomy::new(&spec).material_at(&Point::new(x, y, z)));
            }
        }
    }

    #[test]
    fn truth_ends_through_the_middle_of_a_ball() {
        let mut spec = fixture::phantom();
        spec.inclusions = vec![Inclusion {
            name: "ball".into(),
            shape: Shape::Ellipsoid { radii_m: [0.005; 3] },
            phantom_from_inclusion: Pose::translation(0.01, 0.0, -0.03),
            material: 0,
        }];
        let mut out = Vec::new();
        tissue(&spec).column(0.01, 0.003, &mut out);
        assert_eq!(out.len(), 3);
        assert!((out[1].top_z_m - (-0.03 + 0.004)).abs() < 1e-8, "{:?}", out[1]);
        assert!((out[1].bottom_z_m - (-0.03 - 0.004)).abs() < 1e-8, "{:?}", out[1]);
    }

    #[test]
    fn nothing_lies_outside() {
        let mut out = vec![ColumnSegment { top_z_m: 1.0, bottom_z_m: 0.0, material: 9 }];
        let spec = fixture::phantom();
        tissue(&spec).column(spec.size_m[0] / 2.0 + 1e-9, 0.0, &mut out);
        assert!(out.is_empty());
    }
}
