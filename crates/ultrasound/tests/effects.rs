//! Each effect that can be switched off: without it, it is gone and the rest is as before.

mod common;

use common::{gel, material, needle, needle_in_probe, pose, probe, slice, water};
use sonoloop_types::{Acoustics, ColumnSegment, Effects, Image, NeedleSpec, Pose, ProbeSpec, Slice, Tissue};
use sonoloop_ultrasound::{Field, Renderer, reference};

fn without(effects: Effects) -> ProbeSpec {
    ProbeSpec { effects, ..probe() }
}

fn picture(probe: &ProbeSpec, tissue: &Tissue, slice: &Slice) -> Image {
    let mut image = Image::black(1, 1);
    Renderer::new(probe.clone(), needle(), tissue.clone(), 9).render(slice, &mut image);
    image
}

fn field(probe: &ProbeSpec, needle: &NeedleSpec, tissue: &Tissue, slice: &Slice) -> Field {
    Renderer::new(probe.clone(), needle.clone(), tissue.clone(), 9).field(slice)
}

fn rest() -> Pose {
    pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
}

/// A needle at this angle below the horizontal.
fn with_needle(angle_deg: f64) -> Slice {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    Slice { needle: Some(needle_in_probe(&rest(), [2.0, 0.0, 20.0], [cos, 0.0, sin], 30.0)), ..slice(rest()) }
}

#[test]
fn without_contact_no_element_is_blind() {
    let off = without(Effects { contact: false, ..Effects::default() });
    let mut lifted = with_needle(30.0);
    let touching = picture(&probe(), &gel(), &lifted);
    lifted.element_gap_m[40..].fill(1e-3);
    assert!(picture(&probe(), &gel(), &lifted) != touching);
    assert!(picture(&off, &gel(), &lifted) == touching);
}

#[test]
fn without_noise_water_is_black_and_the_rest_as_with_very_little() {
    let off = without(Effects { noise: false, ..Effects::default() });
    assert!(picture(&probe(), &water(), &slice(rest())).pixels.iter().any(|&grey| grey > 0));
    assert!(picture(&off, &water(), &slice(rest())).pixels.iter().all(|&grey| grey == 0));
    let little = ProbeSpec { noise_level_db: -300.0, ..probe() };
    assert!(picture(&off, &gel(), &with_needle(30.0)) == picture(&little, &gel(), &with_needle(30.0)));
}

#[test]
fn without_speckle_tissue_is_silent_and_absorbs_as_before() {
    let off = without(Effects { speckle: false, ..Effects::default() });
    let silent = Tissue::homogeneous([0.1, 0.06, 0.06], material(None, 0.5));
    assert!(picture(&off, &gel(), &with_needle(0.0)) == picture(&probe(), &silent, &with_needle(0.0)));
    let slice = slice(rest());
    assert!(field(&off, &needle(), &gel(), &slice).values.iter().all(|v| *v == [0.0; 2]));
    assert!(reference::field(&off, &needle(), &silent, 9, &slice).iter().all(|v| *v == [0.0; 2]));
    assert!(reference::field(&off, &needle(), &gel(), 9, &slice).iter().all(|v| *v == [0.0; 2]));
}

#[test]
fn without_speckle_surfaces_are_as_they_were() {
    // The denser half begins 20 mm deep.
    let denser = Acoustics { density_kg_m3: 1500.0, ..material(Some(0.0), 0.5) };
    let layers = Tissue::new([0.1, 0.06, 0.06], vec![material(Some(0.0), 0.5), denser], |_, _, out| {
        out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: -0.02, material: 0 });
        out.push(ColumnSegment { top_z_m: -0.02, bottom_z_m: -0.06, material: 1 });
    });
    let rms = |effects: Effects, rows: core::ops::Range<usize>| {
        let field = field(&without(effects), &needle(), &layers, &slice(rest()));
        let values = &field.values[rows.start * field.columns..rows.end * field.columns];
        let power: f32 = values.iter().flatten().map(|v| v * v).sum();
        (power / values.len() as f32).sqrt()
    };
    let off = Effects { speckle: false, ..Effects::default() };
    assert_eq!([rms(off, 20..180), rms(off, 220..400)], [0.0; 2]);
    // The mirror stands 40 dB over the speckle, which interferes with it: by a hundredth of its amplitude at one place, by
    // less in the mean.
    let [with, only] = [rms(Effects::default(), 195..206), rms(off, 195..206)];
    assert!((only / with - 1.0).abs() < 0.01, "{only} for {with}");
}

#[test]
fn without_the_specular_echo_roughness_and_tip_are_left() {
    let off = without(Effects { specular: false, ..Effects::default() });
    let rough = NeedleSpec { specular_level_db: -300.0, ..needle() };
    let flat = with_needle(0.0);
    let [with, gone] = [&probe(), &off].map(|probe| field(probe, &needle(), &gel(), &flat));
    assert!(with != gone);
    assert!(gone == field(&probe(), &rough, &gel(), &flat));
}
