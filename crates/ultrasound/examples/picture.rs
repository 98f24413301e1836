//! Writes pictures to look at: `cargo run --release -p sonoloop-ultrasound --example picture -- FOLDER [ROUGH_DB TIP_DB]`.

#[path = "../tests/common/mod.rs"]
mod common;

use std::path::{Path, PathBuf};

use common::{material, needle, needle_in_probe, pose, probe, slice};
use sonoloop_types::{ColumnSegment, Image, Pose, Slice, Tissue};
use sonoloop_ultrasound::Renderer;

const ANGLE_DEG: f64 = 40.0;

/// A gel with a clear cyst, a bright ball and a dark ball, over a bright floor.
fn phantom() -> Tissue {
    let balls = [
        ([-8.0, 0.0, -15.0], 4.0, 1),
        ([-12.0, 0.0, -32.0], 5.0, 2),
        ([11.0, 0.0, -12.0], 3.5, 3),
        ([12.0, 1.0, -36.0], 4.0, 1),
    ];
    let materials = vec![
        material(Some(0.0), 0.5),
        material(None, 0.002),
        material(Some(8.0), 0.7),
        material(Some(-8.0), 0.4),
    ];
    Tissue::new([0.2, 0.1, 0.06], materials, move |x, y, out| {
        let mut push = |top: f64, bottom: f64, material: u16| {
            out.push(ColumnSegment { top_z_m: top * 1e-3, bottom_z_m: bottom * 1e-3, material });
        };
        let (x, y) = (x * 1e3, y * 1e3);
        if x.abs() > 100.0 || y.abs() > 50.0 {
            return;
        }
        let mut hits: Vec<(f64, f64, u16)> = balls
            .iter()
            .filter_map(|&([cx, cy, cz], r, m): &([f64; 3], f64, u16)| {
                let h = r * r - (x - cx).powi(2) - (y - cy).powi(2);
                (h > 0.0).then(|| (cz + h.sqrt(), cz - h.sqrt(), m))
            })
            .collect();
        hits.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut z = 0.0;
        for (top, bottom, m) in hits {
            push(z, top, 0);
            push(top, bottom, m);
            z = bottom;
        }
        push(z, -60.0, 0);
    })
}

fn write(image: &Image, path: &Path) {
    image::save_buffer(path, &image.pixels, image.width_px, image.height_px, image::ExtendedColorType::L8)
        .expect("the folder can be written");
}

fn lateral(phantom_from_probe: Pose, elevation_mm: f64) -> Slice {
    let mut slice = slice(phantom_from_probe);
    let (sin, cos) = ANGLE_DEG.to_radians().sin_cos();
    slice.needle =
        Some(needle_in_probe(&phantom_from_probe, [4.0, elevation_mm, 24.0], [cos, 0.0, sin], 24.0 / sin));
    slice
}

fn main() {
    let folder: PathBuf = std::env::args().nth(1).map_or_else(std::env::temp_dir, PathBuf::from);
    let level = |index: usize, default: f64| {
        std::env::args().nth(index).map_or(default, |a| a.parse().expect("levels are numbers in dB"))
    };
    let mut spec = needle();
    spec.rough_level_db = level(2, spec.rough_level_db);
    spec.tip_level_db = level(3, spec.tip_level_db);
    let mut renderer = Renderer::new(probe(), spec, phantom(), 7);
    let mut image = Image::black(640, 480);
    let mut draw = |name: &str, slice: &Slice| {
        renderer.render(slice, &mut image);
        write(&image, &folder.join(name));
    };
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for elevation_mm in [0.0, 0.5, 1.0, 2.0, 3.0] {
        draw(&format!("lateral_{elevation_mm}.png"), &lateral(rest, elevation_mm));
    }
    let mut transverse = slice(rest);
    let (sin, cos) = ANGLE_DEG.to_radians().sin_cos();
    transverse.needle = Some(needle_in_probe(&rest, [2.0, 3.0, 22.0], [0.0, cos, sin], 30.0));
    draw("transverse.png", &transverse);
    let mut lifted = lateral(rest, 0.0);
    lifted.element_gap_m.iter_mut().skip(120).for_each(|gap| *gap = 1e-3);
    draw("contact_partly_lost.png", &lifted);
    lifted.element_gap_m.fill(5e-3);
    draw("contact_lost.png", &lifted);
    let tilted = pose(0.0, 0.0, -2.0, 15.0, 10.0, 8.0);
    draw("tilted.png", &lateral(tilted, 0.0));
    let mut flat = slice(rest);
    flat.needle = Some(needle_in_probe(&rest, [6.0, 0.0, 20.0], [1.0, 0.0, 0.03], 24.0));
    draw("flat.png", &flat);
}
