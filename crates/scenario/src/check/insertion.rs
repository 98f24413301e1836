use sonoloop_types::{ImageGeometry, NeedleSpec, Point, Vector};

use super::units::{m, rad, ticks_of_ms};
use crate::document::Document;
use crate::raw::{RawInsertion, RawManual, RawPlacement};
use crate::{HandSpec, InsertionSpec, LoadError, NeedleRobotSpec, PhantomSpec, PlacementSpec};

/// The needle's nominal course: from the phantom's top face to a target inside phantom, picture and reach.
pub(super) fn insertion(
    document: &Document,
    raw: &RawInsertion,
    phantom: &PhantomSpec,
    needle: &NeedleSpec,
    robot: &NeedleRobotSpec,
    geometry: &ImageGeometry,
) -> Result<InsertionSpec, LoadError> {
    let fail = |key: &str, message: String| Err(document.fail(&format!("insertion.{key}"), message));
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        let half_mm = phantom.size_m[axis] * 500.0;
        if raw.entry_mm[axis].abs() > half_mm {
            let message =
                format!("must lie on the top face of {}: {name} in [-{half_mm}, {half_mm}]", phantom.name);
            return fail("entry_mm", message);
        }
    }
    if raw.start_depth_mm >= raw.target_depth_mm {
        return fail("start_depth_mm", format!("must be below target_depth_mm = {}", raw.target_depth_mm));
    }
    for (limit_m, what) in [
        (needle.length_m, format!("the length of {}", needle.name)),
        (robot.max_depth_m, format!("the deepest insertion of {}", robot.name)),
    ] {
        let robots = limit_m == robot.max_depth_m && limit_m != needle.length_m;
        if robots && raw.manual.is_some() {
            continue;
        }
        if m(raw.target_depth_mm) > limit_m {
            return fail("target_depth_mm", format!("must be at most {}, {what}", limit_m * 1000.0));
        }
    }
    let (angle, azimuth) = (rad(raw.angle_deg), rad(raw.azimuth_deg));
    let flat = libm::cos(angle);
    let axis_in_world = Vector::new(flat * libm::cos(azimuth), flat * libm::sin(azimuth), -libm::sin(angle));
    let entry_in_world = Point::new(m(raw.entry_mm[0]), m(raw.entry_mm[1]), 0.0);
    let target_in_world = entry_in_world + axis_in_world * m(raw.target_depth_mm);
    let [x, y, z] = phantom.size_m;
    let bounds = [("x", -x / 2.0, x / 2.0), ("y", -y / 2.0, y / 2.0), ("z", -z, 0.0)];
    for (index, (name, low, high)) in bounds.into_iter().enumerate() {
        if target_in_world[index] < low || target_in_world[index] > high {
            let message = format!(
                "puts the target at {name} = {:.1} mm, outside {}: must be in [{}, {}]",
                target_in_world[index] * 1000.0,
                phantom.name,
                low * 1000.0,
                high * 1000.0
            );
            return fail("target_depth_mm", message);
        }
    }
    let picture_m = f64::from(geometry.height_px) * geometry.spacing_m;
    if -target_in_world.z > picture_m {
        let message = format!(
            "puts the target {:.1} mm below the surface, must be at most {:.1} mm, the depth of the picture",
            -target_in_world.z * 1000.0,
            picture_m * 1000.0
        );
        return fail("target_depth_mm", message);
    }
    Ok(InsertionSpec {
        entry_in_world,
        axis_in_world,
        bevel_roll_rad: rad(raw.bevel_roll_deg),
        start_depth_m: m(raw.start_depth_mm),
        target_depth_m: m(raw.target_depth_mm),
        target_tolerance_m: m(raw.target_tolerance_mm),
        hand: raw.manual.as_ref().map(|raw| hand(document, raw)).transpose()?,
    })
}

fn hand(document: &Document, raw: &RawManual) -> Result<HandSpec, LoadError> {
    let [least_ms, most_ms] = raw.reaction_ms;
    for (key, ascends) in [
        ("speed_mm_s", raw.speed_mm_s[0] <= raw.speed_mm_s[1]),
        ("pause_every_s", raw.pause_every_s[0] <= raw.pause_every_s[1]),
        ("pause_s", raw.pause_s[0] <= raw.pause_s[1]),
        ("reaction_ms", least_ms <= most_ms),
    ] {
        if !ascends {
            return Err(
                document.fail(&format!("insertion.manual.{key}"), "must be [low, high] with low ≤ high")
            );
        }
    }
    Ok(HandSpec {
        speed_m_s: raw.speed_mm_s.map(m),
        pause_every_s: raw.pause_every_s,
        pause_s: raw.pause_s,
        tremor_m: m(raw.tremor_mm),
        swing_m: m(raw.swing_mm),
        reaction_ticks: raw.reaction_ms.map(ticks_of_ms),
    })
}

/// How the probe stands at the start; the template about the tip must lie in the picture.
pub(super) fn placement(
    document: &Document,
    raw: &RawPlacement,
    insertion: &InsertionSpec,
    template_px: u32,
    geometry: &ImageGeometry,
) -> Result<PlacementSpec, LoadError> {
    if template_px >= geometry.width_px.min(geometry.height_px) {
        let message = format!("must fit into the {}×{} picture", geometry.width_px, geometry.height_px);
        return Err(document.fail("tracker.template_px", message));
    }
    let depth_m = -insertion.axis_in_world.z * insertion.start_depth_m;
    let [u, v] = geometry.px_from_probe(&Point::new(m(raw.tip_lateral_mm), 0.0, depth_m));
    // One more pixel on every side for the gradients.
    let margin_px = f64::from(template_px) / 2.0 + 1.0;
    if !geometry.contains([u, v], margin_px) {
        let (key, what) = if geometry.contains([u, geometry.centre_column_px()], margin_px) {
            ("insertion.start_depth_mm", "row")
        } else {
            ("placement.tip_lateral_mm", "column")
        };
        let message = format!(
            "puts the tip at column {u:.0}, row {v:.0} of the first picture; its {what} must lie at least \
             {margin_px} px (half a template) from the border of {}×{}",
            geometry.width_px, geometry.height_px
        );
        return Err(document.fail(key, message));
    }
    Ok(PlacementSpec {
        tip_lateral_m: m(raw.tip_lateral_mm),
        contact_force_n: raw.contact_force_n,
        yaw_rad: rad(raw.yaw_deg),
        tilt_rad: rad(raw.tilt_deg),
        alignment_sigma_m: m(raw.alignment_mm),
        alignment_sigma_rad: rad(raw.alignment_deg),
    })
}
