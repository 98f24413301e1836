//! Bodies in speckle: how much brighter, how sharp their edges; and the noise that the compensation lifts.

mod common;

use common::{material, needle, pose, probe, slice, water};
use sonoloop_types::{ColumnSegment, Effects, Image, ProbeSpec, Tissue};
use sonoloop_ultrasound::Renderer;

const HALF_WIDTH_M: f64 = 6e-3;

/// No loss, so that levels are those of the scatterers.
fn plain() -> ProbeSpec {
    ProbeSpec { effects: Effects { attenuation: false, downshift: false, ..Effects::default() }, ..probe() }
}

/// Unit backscatter, and in the middle 12 mm a wall to wall body with more; two materials, nothing else different.
fn with_body(backscatter_db: Option<f64>) -> Tissue {
    let materials = vec![material(Some(0.0), 0.0), material(backscatter_db, 0.0)];
    Tissue::new([0.1, 0.06, 0.06], materials, |x, _, out| {
        let inside = u16::from(x.abs() < HALF_WIDTH_M);
        out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: -0.06, material: inside });
    })
}

/// Mean intensity of each column of the field between two depths, over some seeds.
fn by_column(tissue: &Tissue, rows: core::ops::Range<usize>, seeds: u64) -> (Vec<f64>, usize) {
    let mut sums: Vec<f64> = Vec::new();
    let mut first_px = 0;
    for seed in 0..seeds {
        let field = Renderer::new(plain(), needle(), tissue.clone(), seed)
            .field(&slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
        sums.resize(field.columns, 0.0);
        first_px = field.first_px;
        for row in rows.clone() {
            for (sum, [re, im]) in sums.iter_mut().zip(&field.values[row * field.columns..]) {
                *sum += f64::from(re * re + im * im);
            }
        }
    }
    (sums, first_px)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn truth_a_body_of_four_times_the_scatter_power_is_6_db_brighter_than_what_is_around_it() {
    // Inside and outside are different scatterers: some 4000 grains each and seed, a standard error of 0.05 dB together.
    let (columns, first_px) = by_column(&with_body(Some(6.020_6)), 150..350, 3);
    let at = |x_mm: f64| (319.5 + 10.0 * x_mm) as usize - first_px;
    let inside = mean(&columns[at(-5.0)..at(5.0)]);
    let outside = (mean(&columns[at(-16.0)..at(-7.0)]) + mean(&columns[at(7.0)..at(16.0)])) / 2.0;
    let contrast_db = 10.0 * (inside / outside).log10();
    assert!((contrast_db - 6.02).abs() < 0.3, "{contrast_db} dB");
}

#[test]
fn truth_edges_are_as_sharp_as_the_beam() {
    // The intensity is the scatterers' power under the squared beam, a Gaussian of σ_l/√2: across an edge its integral.
    let (columns, first_px) = by_column(&with_body(None), 150..350, 12);
    let sigma_px = 0.886 * 1540.0 / 7.54e6 * 2.0 / 2.3548 / 2f64.sqrt() * 1e4;
    let outside = mean(&columns[..100]);
    for side in [-1.0, 1.0] {
        let profile: Vec<f64> = (0..40)
            .map(|i| {
                // From the inside out.
                let u = 319.5 + side * (60.0 + f64::from(i) - 20.0);
                columns[u.round() as usize - first_px] / outside
            })
            .collect();
        let crossing = |level: f64| {
            let i = profile.iter().position(|&v| v > level).expect("an edge").max(1);
            i as f64 - (profile[i] - level) / (profile[i] - profile[i - 1])
        };
        // From 16 to 84 % are 2σ. The lattice's columns, of all three kinds of rows, stand 0.8 px apart: an edge is made of
        // few, and its width is that of a smooth one to a fraction of that.
        let width_px = crossing(0.841) - crossing(0.159);
        assert!((width_px - 2.0 * sigma_px).abs() < 0.4, "{width_px} px for {}", 2.0 * sigma_px);
        // The body itself is silent.
        assert!(profile[..5].iter().all(|&v| v < 1e-3), "{:?}", &profile[..5]);
    }
}

#[test]
fn truth_noise_rises_with_the_compensation() {
    let effects = Effects { downshift: false, ..Effects::default() };
    let probe = ProbeSpec {
        noise_level_db: -40.0,
        tgc_db_cm_mhz: 0.5,
        dynamic_range_db: 100.0,
        speckle_level_db: 40.0,
        effects,
        ..probe()
    };
    let mut image = Image::black(1, 1);
    Renderer::new(probe, needle(), water(), 3).render(&slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)), &mut image);
    let level_db = |rows: core::ops::Range<u32>| {
        let count = f64::from(rows.end - rows.start) * 300.0;
        rows.flat_map(|v| image.row(v)[170..470].iter().map(|&g| f64::from(g))).sum::<f64>() / count / 255.0
            * 100.0
    };
    // Electronic noise knows no depth; 0.5 dB/cm/MHz both ways over 3 cm at 7.54 MHz are 22.6 dB.
    let rise_db = level_db(390..410) - level_db(90..110);
    assert!((rise_db - 22.62).abs() < 0.3, "{rise_db} dB");
}
