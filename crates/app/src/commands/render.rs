//! `sonoloop render`: one image of a phantom, from a pose.

use sonoloop_types::{Image, NeedlePath, Point, Pose, Slice, Vector};
use sonoloop_ultrasound::Renderer;

use crate::cli::RenderArgs;
use crate::error::{AppError, Outcome};
use crate::say::say;

/// The probe stands on the top face, pointing down, before yaw and tilt.
fn phantom_from_probe(args: &RenderArgs) -> Pose {
    let down = Pose::rotation(Vector::x() * std::f64::consts::PI);
    Pose::translation(args.x_mm * 1e-3, args.y_mm * 1e-3, 0.0)
        * Pose::rotation(Vector::z() * args.yaw_deg.to_radians())
        * down
        * Pose::rotation(Vector::x() * args.tilt_deg.to_radians())
}

/// A straight needle whose tip lies in the middle of the picture at the asked depth.
fn needle(args: &RenderArgs, angle_rad: f64, phantom_from_probe: &Pose) -> NeedlePath {
    let (sin, cos) = angle_rad.sin_cos();
    let (axis, offset) = if args.transverse {
        (Vector::new(0.0, cos, sin), Vector::new(0.0, cos, sin) * (args.offset_mm * 1e-3))
    } else {
        (Vector::new(cos, 0.0, sin), Vector::new(0.0, args.offset_mm * 1e-3, 0.0))
    };
    let tip = Point::new(0.0, 0.0, args.tip_depth_mm * 1e-3) + offset;
    let length_m = 60e-3;
    let points = 60;
    let line = (0..=points)
        .map(|k| phantom_from_probe * (tip - axis * (length_m * f64::from(points - k) / f64::from(points))));
    // The bevel's face looks up to the probe.
    let up = if args.transverse { Vector::new(0.0, sin, -cos) } else { Vector::new(sin, 0.0, -cos) };
    NeedlePath {
        centreline_in_phantom: line.collect(),
        axis_in_phantom: phantom_from_probe * axis,
        bevel_normal_in_phantom: phantom_from_probe * up,
    }
}

/// Writes the picture.
pub fn render(args: &RenderArgs) -> Result<Outcome, AppError> {
    let values = [
        ("--x-mm", args.x_mm, 500.0),
        ("--y-mm", args.y_mm, 500.0),
        ("--yaw-deg", args.yaw_deg, 360.0),
        ("--tilt-deg", args.tilt_deg, 80.0),
        ("--tip-depth-mm", args.tip_depth_mm, 200.0),
        ("--offset-mm", args.offset_mm, 100.0),
        ("--needle-angle-deg", args.needle_angle_deg.unwrap_or(0.0), 90.0),
    ];
    for (name, value, bound) in values {
        // Asked this way round because NaN must be refused too.
        let is_within = value.abs() <= bound;
        if !is_within {
            return Err(AppError::BadInput(format!("error: {name} = {value} must be within ±{bound}")));
        }
    }
    if args.out.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        return Err(AppError::BadInput(format!(
            "error: --out {}: there is no such folder",
            args.out.display()
        )));
    }
    let phantom = sonoloop_scenario::load_phantom(&args.phantom).map_err(AppError::bad_input)?;
    let probe = sonoloop_scenario::load_probe(&args.probe).map_err(AppError::bad_input)?;
    let needle_spec = sonoloop_scenario::load_needle(&args.needle).map_err(AppError::bad_input)?;

    let phantom_from_probe = phantom_from_probe(args);
    let slice = Slice {
        sequence: 0,
        phantom_from_probe,
        needle: args.needle_angle_deg.map(|deg| needle(args, deg.to_radians(), &phantom_from_probe)),
        needle_gain_db: 0.0,
        element_gap_m: vec![0.0; probe.elements as usize],
        gain_db: 0.0,
    };
    let mut image = Image::black(probe.geometry.width_px, probe.geometry.height_px);
    Renderer::new(probe, needle_spec, sonoloop_world::tissue(&phantom), args.seed).render(&slice, &mut image);
    crate::output::write_png(&args.out, &image)
        .map_err(|e| AppError::Fault(format!("{}: {e}", args.out.display())))?;
    say(args.out.display());
    Ok(Outcome::Pass)
}
