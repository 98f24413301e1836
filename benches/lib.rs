//! Scenes that the benches share: the committed phantom, probe and needle, from given poses.

use std::path::{Path, PathBuf};

use sonoloop_types::{
    Drag, Image, Indentation, NeedlePath, NeedleSpec, Point, Pose, Precision, ProbeSpec, Slice, Tissue,
    Vector,
};
use sonoloop_ultrasound::Renderer;

/// A file of the repository.
fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The probe stands on the top face at (x, y), turned by yaw about its beam, tilted out of plane and in plane.
pub fn pose(at_mm: [f64; 2], yaw_deg: f64, tilt_deg: [f64; 2]) -> Pose {
    let turn = |axis: Vector, deg: f64| Pose::rotation(axis * deg.to_radians());
    Pose::translation(at_mm[0] * 1e-3, at_mm[1] * 1e-3, 0.0)
        * turn(Vector::z(), yaw_deg)
        * turn(Vector::x(), 180.0)
        * turn(Vector::x(), tilt_deg[0])
        * turn(Vector::y(), tilt_deg[1])
}

/// One renderer over the heterogeneous phantom, and a needle that lies in it.
pub struct Scene {
    renderer: Renderer,
    needle: Option<NeedlePath>,
    elements: usize,
    /// How far the probe presses the tissue.
    pub press_m: f64,
    /// What the needle drags.
    pub drag: Option<Drag>,
    image: Image,
    sequence: u64,
}

impl Scene {
    /// `needle_angle_deg` below the surface, tip in the middle of a picture taken at the origin.
    ///
    /// # Panics
    /// When the repository's own files do not load.
    pub fn new(needle_angle_deg: Option<f64>, precision: Precision) -> Self {
        let probe: ProbeSpec =
            sonoloop_scenario::load_probe(&file("robots/probes/l12_3v.yaml")).expect("probe");
        let probe = ProbeSpec { precision, ..probe };
        let needle: NeedleSpec =
            sonoloop_scenario::load_needle(&file("robots/needles/22g_150mm.yaml")).expect("needle");
        let phantom = file("phantoms/gelatin_agar_heterogeneous.yaml");
        let phantom = sonoloop_scenario::load_phantom(&phantom).expect("phantom");
        let tissue: Tissue = sonoloop_world::tissue(&phantom);
        let geometry = probe.geometry;
        Self {
            elements: probe.elements as usize,
            renderer: Renderer::new(probe, needle, tissue, 0),
            needle: needle_angle_deg.map(|deg| path(deg.to_radians())),
            press_m: 0.0,
            drag: None,
            image: Image::black(geometry.width_px, geometry.height_px),
            sequence: 0,
        }
    }

    /// Moves the needle sideways.
    pub fn move_needle(&mut self, by_m: f64) {
        for point in self.needle.iter_mut().flat_map(|needle| &mut needle.centreline_in_phantom) {
            point.y += by_m;
        }
    }

    /// Renders the next image from a pose.
    pub fn render(&mut self, phantom_from_probe: Pose) -> &Image {
        let at = phantom_from_probe.translation.vector;
        let indentation = Indentation {
            x_m: at.x,
            y_m: at.y,
            yaw_rad: 0.0,
            half_size_m: [24e-3, 6e-3],
            depth_m: self.press_m,
            lean: 0.0,
            thickness_m: 60e-3,
        };
        let slice = Slice {
            sequence: self.sequence,
            phantom_from_probe,
            needle: self.needle.clone(),
            needle_gain_db: 0.0,
            element_gap_m: vec![0.0; self.elements],
            element_loss_db: Vec::new(),
            indentation: (self.press_m > 0.0).then_some(indentation),
            drag: self.drag,
            gain_db: 0.0,
            noise_gain_db: 0.0,
        };
        self.sequence += 1;
        self.renderer.render(&slice, &mut self.image);
        &self.image
    }
}

fn path(angle_rad: f64) -> NeedlePath {
    let axis = Vector::new(angle_rad.cos(), 0.0, -angle_rad.sin());
    let tip = Point::new(0.0, 0.0, -25e-3);
    NeedlePath {
        centreline_in_phantom: (0..=40).map(|i| tip - axis * (1.5e-3 * f64::from(40 - i))).collect(),
        axis_in_phantom: axis,
        bevel_normal_in_phantom: Vector::new(angle_rad.sin(), 0.0, angle_rad.cos()),
    }
}
