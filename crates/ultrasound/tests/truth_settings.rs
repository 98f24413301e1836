//! The scanner's knobs do what they say: frequency, dynamic range, gain, depth.

mod common;

use common::{gel, needle, needle_in_probe, pose, probe, slice, water};
use sonoloop_types::{Effects, Image, ImageGeometry, NeedleSpec, ProbeSpec, Slice};
use sonoloop_ultrasound::{Field, Renderer};

/// σ of the profile whose speckle correlates with itself so many rows and columns on, in pixels: the field behind a
/// Gaussian profile exp(−x²/2σ²) correlates as exp(−δ²/4σ²).
fn grain_px(fields: &[Field], down: usize, right: usize) -> f64 {
    let (mut re, mut im, mut power) = (0.0, 0.0, 0.0);
    for field in fields {
        // The middle, where the aperture is whole.
        for row in 150..300 {
            let line = |row: usize, first: usize| &field.values[row * field.columns + first..][..144];
            for (a, b) in line(row, 120).iter().zip(line(row + down, 120 + right)) {
                let ([a, b], [c, d]) = (a.map(f64::from), b.map(f64::from));
                re += a * c + b * d;
                im += b * c - a * d;
                power += (a * a + b * b + c * c + d * d) / 2.0;
            }
        }
    }
    (down + right) as f64 / (2.0 * (-(re.hypot(im) / power).ln()).sqrt())
}

#[test]
fn truth_grain_goes_with_the_wavelength_both_ways() {
    let measured = [5e6, 7.54e6].map(|centre_frequency_hz| {
        let effects = Effects { downshift: false, ..Effects::default() };
        let probe = ProbeSpec { centre_frequency_hz, effects, ..probe() };
        let fields: Vec<Field> = (0..12u64)
            .map(|i| {
                let mut renderer = Renderer::new(probe.clone(), needle(), gel(), 5 + i);
                renderer.field(&slice(pose(0.0, -11.0 + 2.0 * i as f64, 0.0, 0.0, 0.0, 0.0)))
            })
            .collect();
        [grain_px(&fields, 0, 2), grain_px(&fields, 2, 0)]
    });
    println!("σ across and down at 5 and 7.54 MHz: {measured:.3?} px");
    for ([across, down], frequency_hz) in measured.into_iter().zip([5e6, 7.54e6]) {
        // −6 dB widths: 0.886·λ·F# across; down that of a Gaussian pulse of bandwidth B·f, c·2·ln 2/(π·B·f).
        let wavelength_px = 1540.0 / frequency_hz / 1e-4;
        let expected =
            [0.886 * wavelength_px * 2.0, wavelength_px * 2.0 * 2f64.ln() / core::f64::consts::PI / 0.6]
                .map(|width_px| width_px / 2.3548);
        for (measured, expected) in [across, down].into_iter().zip(expected) {
            // Some ten thousand cells of speckle leave a per cent or two.
            assert!(
                (measured / expected - 1.0).abs() < 0.05,
                "{measured} px for {expected}, {frequency_hz} Hz"
            );
        }
    }
}

fn picture(probe: &ProbeSpec, gain_db: f64) -> Image {
    let mut image = Image::black(1, 1);
    let slice = Slice { gain_db, ..slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)) };
    Renderer::new(probe.clone(), needle(), gel(), 9).render(&slice, &mut image);
    image
}

/// Pairs of grey levels of the same pixels, both between black and white.
fn pairs(a: &Image, b: &Image) -> Vec<[f64; 2]> {
    let both = a.pixels.iter().zip(&b.pixels).map(|(&a, &b)| [a, b]);
    let inside: Vec<_> = both
        .filter(|pair| pair.iter().all(|grey| (1..255).contains(grey)))
        .map(|pair| pair.map(f64::from))
        .collect();
    assert!(inside.len() > 50_000, "{} pixels", inside.len());
    inside
}

#[test]
fn truth_dynamic_range_is_255_levels_for_so_many_db_below_white() {
    let [wide, narrow] = [60.0, 40.0].map(|dynamic_range_db| ProbeSpec { dynamic_range_db, ..probe() });
    for [a, b] in pairs(&picture(&wide, 0.0), &picture(&narrow, 0.0)) {
        let [a_db, b_db] = [(255.0 - a) * 60.0 / 255.0, (255.0 - b) * 40.0 / 255.0];
        // Half a level of rounding each, and 1e-4 for the single precision in between.
        assert!((a_db - b_db).abs() <= 0.5 * (60.0 + 40.0) / 255.0 + 1e-4, "{a} and {b}");
    }
}

#[test]
fn truth_gain_and_speckle_level_move_every_pixel_by_their_db() {
    // 8 dB of 60 are 34 levels, half a level of rounding each way.
    let base = picture(&probe(), 0.0);
    let darker = ProbeSpec { speckle_level_db: probe().speckle_level_db + 8.0, ..probe() };
    for (image, levels) in [(picture(&probe(), 8.0), 34.0), (picture(&darker, 0.0), -34.0)] {
        for [a, b] in pairs(&base, &image) {
            assert!((b - a - levels).abs() <= 1.0, "{a} became {b}");
        }
    }
}

#[test]
fn truth_noise_moves_every_pixel_of_an_empty_picture_by_its_db() {
    let noisy = ProbeSpec { noise_level_db: -25.0, ..probe() };
    let empty = |noise_gain_db: f64| {
        let slice = Slice { noise_gain_db, ..slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)) };
        let mut image = Image::black(640, 480);
        Renderer::new(noisy.clone(), needle(), water(), 9).render(&slice, &mut image);
        image
    };
    // 8 dB of 60 are 34 levels.
    for [a, b] in pairs(&empty(0.0), &empty(8.0)) {
        assert!((b - a - 34.0).abs() <= 1.0, "{a} became {b}");
    }
    // Nonsense changes nothing.
    assert!(empty(f64::NAN) == empty(0.0));
}

#[test]
fn truth_a_target_lies_at_its_depth_over_the_spacing() {
    // A tip without a shaft, 20 mm deep and 3 mm to the right.
    let tip = NeedleSpec { specular_level_db: -300.0, rough_level_db: -300.0, ..needle() };
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let slice = Slice {
        needle: Some(needle_in_probe(&rest, [3.0, 0.0, 20.0], [0.866, 0.0, 0.5], 30.0)),
        ..slice(rest)
    };
    for depth_mm in [30.0, 48.0, 80.0, 120.0] {
        let spacing_mm = depth_mm / 480.0;
        let geometry = ImageGeometry { spacing_m: spacing_mm * 1e-3, ..probe().geometry };
        let field = Renderer::new(ProbeSpec { geometry, ..probe() }, tip.clone(), water(), 9).field(&slice);
        let power = |v: &[f32; 2]| v[0] * v[0] + v[1] * v[1];
        let brightest = (0..field.values.len())
            .max_by(|&a, &b| power(&field.values[a]).total_cmp(&power(&field.values[b])))
            .expect("a pixel");
        let row = (brightest / field.columns) as f64;
        let column = (field.first_px + brightest % field.columns) as f64 - geometry.centre_column_px();
        println!("{depth_mm} mm: row {row}, {column} columns right");
        // Half a pixel, and what the facet and the tail behind the tip add: 0.1 mm down, 0.05 mm across.
        assert!((row - 20.0 / spacing_mm).abs() <= 0.5 + 0.1 / spacing_mm, "row {row} at {depth_mm} mm");
        assert!(
            (column - 3.0 / spacing_mm).abs() <= 0.5 + 0.05 / spacing_mm,
            "column {column} at {depth_mm} mm"
        );
    }
}
