//! `sonoloop render`: one image of a phantom, from a pose.

use std::path::Path;

use sonoloop_types::Image;
use sonoloop_ultrasound::Renderer;

use super::gallery::gallery;
use super::view::{NeedleView, View};
use crate::cli::RenderArgs;
use crate::error::{AppError, Outcome};
use crate::paths::file_is_there;
use crate::say::say;

/// Writes the picture, or the gallery.
pub fn render(args: &RenderArgs) -> Result<Outcome, AppError> {
    if let Some(folder) = &args.gallery {
        return gallery(folder, args);
    }
    check_numbers(args)?;
    check_out(&args.out)?;
    let phantom_file = args
        .phantom
        .as_deref()
        .ok_or_else(|| AppError::BadInput("error: render needs a PHANTOM, or --gallery DIR".into()))?;
    file_is_there("PHANTOM", phantom_file)?;
    file_is_there("--probe", &args.probe)?;
    file_is_there("--needle", &args.needle)?;
    let phantom = sonoloop_scenario::load_phantom(phantom_file)?;
    let probe = sonoloop_scenario::load_probe_with(&args.probe, &args.set)?;
    let needle = sonoloop_scenario::load_needle(&args.needle)?;

    let slice = view(args).slice(&probe);
    let mut image = Image::black(probe.geometry.width_px, probe.geometry.height_px);
    Renderer::new(probe, needle, sonoloop_world::tissue(&phantom), args.seed).render(&slice, &mut image);
    crate::output::write_png(&args.out, &image)
        .map_err(|e| AppError::Fault(format!("{}: {e}", args.out.display())))?;
    say(args.out.display());
    Ok(Outcome::Pass)
}

fn view(args: &RenderArgs) -> View {
    View {
        x_m: args.x_mm * 1e-3,
        y_m: args.y_mm * 1e-3,
        yaw_rad: args.yaw_deg.to_radians(),
        tilt_rad: args.tilt_deg.to_radians(),
        needle: args.needle_angle_deg.map(|angle_deg| NeedleView {
            angle_rad: angle_deg.to_radians(),
            tip_depth_m: args.tip_depth_mm * 1e-3,
            offset_m: args.offset_mm * 1e-3,
            transverse: args.transverse,
            yaw_rad: 0.0,
        }),
        gain_db: args.gain_db,
        ..View::default()
    }
}

fn check_numbers(args: &RenderArgs) -> Result<(), AppError> {
    let values = [
        ("--x-mm", args.x_mm, 500.0),
        ("--y-mm", args.y_mm, 500.0),
        ("--yaw-deg", args.yaw_deg, 360.0),
        ("--tilt-deg", args.tilt_deg, 80.0),
        ("--tip-depth-mm", args.tip_depth_mm, 200.0),
        ("--offset-mm", args.offset_mm, 100.0),
        ("--gain-db", args.gain_db, 60.0),
        ("--needle-angle-deg", args.needle_angle_deg.unwrap_or(0.0), 90.0),
    ];
    for (name, value, bound) in values {
        // Asked this way round because NaN must be refused too.
        let is_within = value.abs() <= bound;
        if !is_within {
            return Err(AppError::BadInput(format!("error: {name} = {value} must be within ±{bound}")));
        }
    }
    Ok(())
}

/// A name that ends in something else would promise a format that is not written.
fn check_out(out: &Path) -> Result<(), AppError> {
    let no_folder = || out.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir());
    let why = if !out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        "must end in .png, the only format that is written"
    } else if no_folder() {
        "there is no such folder"
    } else if out.is_dir() {
        "this is a folder"
    } else {
        return Ok(());
    };
    Err(AppError::BadInput(format!("error: --out {}: {why}", out.display())))
}
