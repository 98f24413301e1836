use std::collections::BTreeSet;

use sonoloop_types::{Acoustics, Pose};

use super::named_file;
use super::units::{m, m3, pose};
use crate::document::Document;
use crate::raw::{RawInclusion, RawMaterial, RawMaterials, RawPassage, RawPhantom};
use crate::{Inclusion, LoadError, Material, PassageSpec, PhantomSpec, Shape};

/// How far a body may stand out of the block by rounding alone.
const ROUNDING_M: f64 = 1e-9;
/// A face may give way by this share of `drag_decay_mm`: at all of it tissue would fold over.
const MOST_OF_DECAY: f64 = 0.8;

/// The phantom with the materials that it uses, background first.
pub(crate) fn phantom(document: &Document) -> Result<PhantomSpec, LoadError> {
    let raw: RawPhantom = document.typed()?;
    let file = Document::read(&named_file(document, "materials", &raw.materials)?)?;
    let known: RawMaterials = file.typed()?;
    let mut materials = Vec::new();
    let mut index_of = |key: &str, name: &str| -> Result<u16, LoadError> {
        if let Some(index) = materials.iter().position(|material: &Material| material.name == name) {
            return Ok(index as u16); // at most 201 bodies, so at most 201 materials
        }
        let Some(raw) = known.materials.get(name) else {
            let names: Vec<_> = known.materials.keys().map(String::as_str).collect();
            let path = file.source.path.display();
            return Err(document.fail(key, format!("must be a material of {path}: {}", names.join(", "))));
        };
        materials.push(material(&file, name, raw)?);
        Ok((materials.len() - 1) as u16)
    };
    let background = index_of("background", &raw.background)?;
    let size_m = m3(raw.size_mm);
    let mut names = BTreeSet::new();
    let mut inclusions = Vec::new();
    for (index, body) in raw.inclusions.iter().enumerate() {
        let key = format!("inclusions.{index}");
        if !names.insert(&body.name) {
            return Err(document.fail(&format!("{key}.name"), "must be unique in the phantom"));
        }
        let shape = shape(document, &key, body)?;
        let phantom_from_inclusion = pose(body.centre_mm, body.rpy_deg);
        lies_inside(document, &key, &shape, &phantom_from_inclusion, size_m)?;
        let material = index_of(&format!("{key}.material"), &body.material)?;
        inclusions.push(Inclusion { name: body.name.clone(), shape, phantom_from_inclusion, material });
    }
    Ok(PhantomSpec { name: raw.name, size_m, background, materials, inclusions })
}

/// Every material of the file, by name.
pub(crate) fn materials(document: &Document) -> Result<Vec<Material>, LoadError> {
    let raw: RawMaterials = document.typed()?;
    raw.materials.iter().map(|(name, raw)| material(document, name, raw)).collect()
}

fn material(document: &Document, name: &str, raw: &RawMaterial) -> Result<Material, LoadError> {
    let needle = raw.needle.map(|raw| passage(document, name, &raw)).transpose()?;
    Ok(Material {
        name: name.to_owned(),
        acoustics: Acoustics {
            sound_speed_m_s: raw.sound_speed_m_s,
            attenuation_db_cm_mhz: raw.attenuation_db_cm_mhz,
            attenuation_exponent: raw.attenuation_exponent,
            density_kg_m3: raw.density_kg_m3,
            backscatter_db: raw.backscatter_db,
        },
        youngs_modulus_pa: raw.youngs_modulus_kpa.map(|kpa| kpa * 1000.0),
        needle,
    })
}

fn passage(document: &Document, material: &str, raw: &RawPassage) -> Result<PassageSpec, LoadError> {
    let fail = |key: &str, message: String| {
        Err(document.fail(&format!("materials.{material}.needle.{key}"), message))
    };
    if raw.puncture_n < raw.cutting_n {
        return fail("puncture_n", format!("must be at least cutting_n = {}", raw.cutting_n));
    }
    let passage = PassageSpec {
        friction_n_m: raw.friction_n_m,
        cutting_n: raw.cutting_n,
        puncture_n: raw.puncture_n,
        stiffness_n_m: raw.stiffness_n_m,
        stiffening_n_m2: raw.stiffening_n_m2,
        drag_decay_m: m(raw.drag_decay_mm),
        bending: raw.bending,
    };
    let (dent_mm, most_mm) = (passage.dent_m(0.0) * 1000.0, MOST_OF_DECAY * raw.drag_decay_mm);
    if dent_mm > most_mm {
        let message = format!(
            "is reached when the face has given way by {dent_mm:.1} mm; that must be at most {most_mm:.1} mm, {MOST_OF_DECAY} of \
             drag_decay_mm"
        );
        return fail("puncture_n", message);
    }
    Ok(passage)
}

fn shape(document: &Document, key: &str, raw: &RawInclusion) -> Result<Shape, LoadError> {
    match (raw.ellipsoid, raw.cylinder, raw.cuboid) {
        (Some(body), None, None) => Ok(Shape::Ellipsoid { radii_m: m3(body.radii_mm) }),
        (None, Some(body), None) => {
            Ok(Shape::Cylinder { radius_m: m(body.radius_mm), length_m: m(body.length_mm) })
        }
        (None, None, Some(body)) => Ok(Shape::Cuboid { size_m: m3(body.size_mm) }),
        _ => Err(document
            .fail(&format!("{key}.name"), "must have exactly one of the keys ellipsoid, cylinder, cuboid")),
    }
}

fn lies_inside(
    document: &Document,
    key: &str,
    shape: &Shape,
    phantom_from_inclusion: &Pose,
    size_m: [f64; 3],
) -> Result<(), LoadError> {
    let reach = reach_m(shape, phantom_from_inclusion);
    let centre = phantom_from_inclusion.translation.vector;
    let [x, y, z] = size_m;
    let bounds = [(-x / 2.0, x / 2.0), (-y / 2.0, y / 2.0), (-z, 0.0)];
    for (axis, (low, high)) in bounds.into_iter().enumerate() {
        let (from, to) = (centre[axis] - reach[axis], centre[axis] + reach[axis]);
        if from < low - ROUNDING_M || to > high + ROUNDING_M {
            let message = format!(
                "lies outside the phantom: it spans {:.2} to {:.2} mm along {}, must be in [{}, {}]",
                from * 1000.0,
                to * 1000.0,
                ["x", "y", "z"][axis],
                low * 1000.0,
                high * 1000.0
            );
            return Err(document.fail(&format!("{key}.centre_mm"), message));
        }
    }
    Ok(())
}

/// Half extents of the turned shape along the phantom's axes (its support function there).
fn reach_m(shape: &Shape, phantom_from_inclusion: &Pose) -> [f64; 3] {
    let turn = phantom_from_inclusion.rotation.to_rotation_matrix();
    std::array::from_fn(|axis| {
        let row = turn.matrix().row(axis);
        match *shape {
            Shape::Ellipsoid { radii_m: r } => {
                (0..3).map(|i| (row[i] * r[i]) * (row[i] * r[i])).sum::<f64>().sqrt()
            }
            Shape::Cuboid { size_m: s } => (0..3).map(|i| row[i].abs() * s[i] / 2.0).sum(),
            Shape::Cylinder { radius_m, length_m } => {
                let across = (1.0 - row[2] * row[2]).max(0.0).sqrt();
                row[2].abs() * length_m / 2.0 + radius_m * across
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The support function of a convex body is the largest coordinate of its surface points.
    #[test]
    fn truth_reach_is_the_farthest_surface_point() {
        let turned = pose([0.0; 3], [20.0, -35.0, 50.0]);
        let shapes = [
            Shape::Ellipsoid { radii_m: [0.03, 0.01, 0.02] },
            Shape::Cylinder { radius_m: 0.005, length_m: 0.04 },
            Shape::Cuboid { size_m: [0.04, 0.02, 0.01] },
        ];
        for shape in shapes {
            let reach = reach_m(&shape, &turned);
            let mut farthest = [0.0_f64; 3];
            for i in 0..=400 {
                for j in 0..=400 {
                    let (a, b) = (
                        f64::from(i) / 400.0 * std::f64::consts::PI,
                        f64::from(j) / 200.0 * std::f64::consts::PI,
                    );
                    let on_sphere = [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()];
                    let point = match shape {
                        Shape::Ellipsoid { radii_m: r } => std::array::from_fn(|k| on_sphere[k] * r[k]),
                        Shape::Cylinder { radius_m: r, length_m: l } => {
                            [r * b.cos(), r * b.sin(), l / 2.0 * on_sphere[2].signum()]
                        }
                        Shape::Cuboid { size_m: s } => {
                            std::array::from_fn(|k| s[k] / 2.0 * on_sphere[k].signum())
                        }
                    };
                    let moved = turned.rotation * nalgebra::Vector3::from(point);
                    farthest = std::array::from_fn(|k| farthest[k].max(moved[k].abs()));
                }
            }
            for axis in 0..3 {
                // The grid of surface points is fine to 1°, hence 2e-4 of 30 mm.
                assert!((reach[axis] - farthest[axis]).abs() < 6e-6, "{shape:?} {reach:?} {farthest:?}");
            }
        }
    }
}
