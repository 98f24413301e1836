//! Scenes shared by the tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use sonoloop_types::{
    Acoustics, Effects, ElevationSample, ImageGeometry, Indentation, NeedlePath, NeedleSpec, Point, Pose,
    Precision, ProbeSpec, Slice, Tissue, Vector,
};

/// A probe like an L12-3v, two-way widths of a 5 mm element height focused at 18 mm.
pub fn probe() -> ProbeSpec {
    let elevation =
        [(8.0, 2.02), (12.0, 0.68), (18.0, 0.75), (20.0, 0.84), (25.0, 1.09), (30.0, 1.46), (40.0, 2.77)];
    ProbeSpec {
        name: "linear 192".into(),
        elements: 192,
        pitch_m: 0.2e-3,
        centre_frequency_hz: 7.54e6,
        fractional_bandwidth: 0.6,
        f_number: 2.0,
        transmit_focus_m: None,
        element_height_m: 5e-3,
        elevation_focus_m: 20e-3,
        elevation: elevation
            .iter()
            .map(|&(depth_mm, width_mm)| ElevationSample {
                depth_m: depth_mm * 1e-3,
                width_m: width_mm * 1e-3,
            })
            .collect(),
        assumed_sound_speed_m_s: 1540.0,
        tgc_db_cm_mhz: 0.5,
        tgc_sliders_db: Vec::new(),
        dynamic_range_db: 60.0,
        speckle_level_db: 30.0,
        noise_level_db: -52.0,
        geometry: ImageGeometry::default(),
        effects: Effects::default(),
        precision: Precision::default(),
    }
}

pub fn needle() -> NeedleSpec {
    NeedleSpec {
        name: "22G".into(),
        outer_diameter_m: 0.718e-3,
        length_m: 0.15,
        bevel_rad: 0.35,
        curvature_per_m: 0.0,
        specular_level_db: 45.0,
        rough_level_db: 16.0,
        tip_level_db: 28.0,
    }
}

pub fn material(backscatter_db: Option<f64>, attenuation_db_cm_mhz: f64) -> Acoustics {
    Acoustics {
        sound_speed_m_s: 1540.0,
        attenuation_db_cm_mhz,
        attenuation_exponent: 1.0,
        density_kg_m3: 1000.0,
        backscatter_db,
    }
}

pub fn gel() -> Tissue {
    Tissue::homogeneous([0.1, 0.06, 0.06], material(Some(0.0), 0.5))
}

pub fn water() -> Tissue {
    Tissue::homogeneous([0.1, 0.06, 0.06], material(None, 0.0))
}

/// A probe on the phantom's top at (x, y), looking down, turned by yaw about the beam, then tilted by
/// `roll` about its x axis (out of plane) and `pitch` about its y axis (in plane).
pub fn pose(x_mm: f64, y_mm: f64, z_mm: f64, yaw_deg: f64, roll_deg: f64, pitch_deg: f64) -> Pose {
    let turn = |axis: Vector3<f64>, deg: f64| UnitQuaternion::from_scaled_axis(axis * deg.to_radians());
    // x along the phantom's x, z down, so y along the phantom's −y.
    let down = turn(Vector3::x(), 180.0);
    let rotation =
        down * turn(Vector3::z(), yaw_deg) * turn(Vector3::x(), roll_deg) * turn(Vector3::y(), pitch_deg);
    Pose::from_parts(Translation3::new(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3), rotation)
}

pub fn slice(phantom_from_probe: Pose) -> Slice {
    Slice {
        sequence: 0,
        phantom_from_probe,
        needle: None,
        needle_gain_db: 0.0,
        element_gap_m: vec![0.0; 192],
        element_loss_db: Vec::new(),
        indentation: None,
        drag: None,
        gain_db: 0.0,
        noise_gain_db: 0.0,
    }
}

/// What a probe with a face of this half length presses at a pose, turned a little against it.
pub fn press(phantom_from_probe: &Pose, half_length_m: f64, depth_m: f64) -> Indentation {
    let at = phantom_from_probe.translation.vector;
    Indentation {
        x_m: at.x,
        y_m: at.y,
        yaw_rad: 0.3,
        half_size_m: [half_length_m, 6e-3],
        depth_m,
        lean: 0.03,
        thickness_m: 0.06,
    }
}

/// A straight needle whose tip is given in the probe frame and whose axis points along `axis_in_probe`.
pub fn needle_in_probe(
    phantom_from_probe: &Pose,
    tip_mm: [f64; 3],
    axis_in_probe: [f64; 3],
    length_mm: f64,
) -> NeedlePath {
    let axis = phantom_from_probe * Vector::from(axis_in_probe).normalize();
    let tip = phantom_from_probe * Point::from(tip_mm.map(|v| v * 1e-3));
    let steps = (length_mm / 1.5).ceil() as usize;
    let bevel = phantom_from_probe * Vector::new(0.0, 0.0, -1.0);
    NeedlePath {
        centreline_in_phantom: (0..=steps)
            .map(|i| tip - axis * (length_mm * 1e-3 * (1.0 - i as f64 / steps as f64)))
            .collect(),
        axis_in_phantom: axis,
        bevel_normal_in_phantom: bevel,
    }
}
