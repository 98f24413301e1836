//! Probe on gel: a flat punch on an elastic layer with Kelvin–Voigt damping.
//!
//! F = κ·2aE*·(δ + τδ̇) ≥ 0, a = √(A/π), E* = E/(1 − ν²): the flat circular punch of the footprint's area, κ for the
//! phantom's thickness ([`crate::punch`]). δ is the mean indentation of the face along the probe's axis. The tissue
//! that the renderer sees is pressed as far, see [`Indentation`]. All poses are of the probe in the phantom.

use sonoloop_scenario::PhantomSpec;
use sonoloop_types::{Indentation, Pose, ProbeSpec, TICKS_PER_SECOND, Vector};

use crate::punch::layer_factor;

/// Elevational width of a linear probe's face. Assumed: typical of the housings, no source.
const FACE_WIDTH_M: f64 = 12e-3;
/// Gels are nearly incompressible. Assumed.
const POISSON: f64 = 0.49;
/// Time constant of the damping. Assumed: gelatin relaxes within some tens of milliseconds.
const DAMPING_S: f64 = 0.02;
/// The face is held this far below a surface that bears no force.
pub(crate) const LIQUID_IMMERSION_M: f64 = 2e-3;

/// The unchanging part: how stiff the phantom is under this probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contact {
    /// κ·2aE*, newtons per metre; `None` for a liquid.
    pub stiffness_n_m: Option<f64>,
    half_aperture_m: f64,
    half_size_m: [f64; 2],
    thickness_m: f64,
}

impl Contact {
    pub(crate) fn new(probe: &ProbeSpec, phantom: &PhantomSpec) -> Self {
        let modulus_pa = phantom.materials[usize::from(phantom.background)].youngs_modulus_pa;
        let area_m2 = probe.aperture_m() * FACE_WIDTH_M;
        let radius_m = (area_m2 / std::f64::consts::PI).sqrt();
        Self {
            stiffness_n_m: modulus_pa.map(|e| {
                let half_space_n_m = 2.0 * radius_m * e / (1.0 - POISSON * POISSON);
                half_space_n_m * layer_factor(radius_m, phantom.size_m[2], POISSON)
            }),
            half_aperture_m: probe.aperture_m() / 2.0,
            half_size_m: [phantom.size_m[0] / 2.0, phantom.size_m[1] / 2.0],
            thickness_m: phantom.size_m[2],
        }
    }

    /// Indentation of the face's centre along the probe's axis; negative above the surface.
    pub(crate) fn centre_indentation_m(&self, phantom_from_probe: &Pose) -> f64 {
        let down = -(phantom_from_probe.rotation * Vector::z()).z;
        -phantom_from_probe.translation.vector.z / down.max(0.1)
    }

    /// Mean over the array of what lies below the surface, along the probe's axis; the slope across the
    /// array is left out. 0 beside the phantom.
    pub(crate) fn mean_indentation_m(&self, phantom_from_probe: &Pose) -> f64 {
        let centre = phantom_from_probe.translation.vector;
        if centre.x.abs() > self.half_size_m[0] || centre.y.abs() > self.half_size_m[1] {
            return 0.0;
        }
        let middle = self.centre_indentation_m(phantom_from_probe);
        let down = -(phantom_from_probe.rotation * Vector::z()).z;
        let slope = ((phantom_from_probe.rotation * Vector::x()).z / down.max(0.1)).abs();
        let (low, high) = (middle - slope * self.half_aperture_m, middle + slope * self.half_aperture_m);
        if low >= 0.0 {
            middle
        } else if high <= 0.0 {
            0.0
        } else {
            // Triangle: a share high/(high − low) of the array is in, by high/2 on average.
            0.5 * high * high / (high - low)
        }
    }

    /// How the tissue is pressed: `None` without contact, in a liquid, and beyond what tissue can follow. Under its middle
    /// line the top face comes to lie where the probe's face is, along as much of the array as presses.
    pub(crate) fn indentation(&self, phantom_from_probe: &Pose) -> Option<Indentation> {
        self.stiffness_n_m?;
        if self.mean_indentation_m(phantom_from_probe) <= 0.0 {
            return None;
        }
        let array = phantom_from_probe.rotation * Vector::x();
        let level = libm::hypot(array.x, array.y).max(0.1);
        let mut pressed = Indentation {
            x_m: phantom_from_probe.translation.vector.x,
            y_m: phantom_from_probe.translation.vector.y,
            yaw_rad: libm::atan2(array.y, array.x),
            half_size_m: [self.half_aperture_m, FACE_WIDTH_M / 2.0],
            depth_m: -phantom_from_probe.translation.vector.z,
            lean: -array.z / level,
            thickness_m: self.thickness_m,
        };
        // What the model leaves of the press under the middle of the face.
        let left = pressed.lengthwise(0.0) * pressed.crosswise(0.0)[0];
        pressed.depth_m /= left;
        pressed.lean /= left;
        Some(pressed).filter(Indentation::is_sound)
    }

    /// Force along the probe's axis, positive when pressed.
    pub(crate) fn force_n(&self, indentation_m: f64, rate_m_s: f64) -> f64 {
        let Some(stiffness) = self.stiffness_n_m else { return 0.0 };
        if indentation_m <= 0.0 { 0.0 } else { (stiffness * (indentation_m + DAMPING_S * rate_m_s)).max(0.0) }
    }

    /// Indentation at which the face rests with a given force; the immersion in a liquid.
    pub(crate) fn rest_indentation_m(&self, force_n: f64) -> f64 {
        self.stiffness_n_m.map_or(LIQUID_IMMERSION_M, |stiffness| force_n / stiffness)
    }

    /// Gap between each element and the surface along the probe's axis; beside the phantom, its thickness.
    pub(crate) fn element_gaps_m(&self, phantom_from_probe: &Pose, probe: &ProbeSpec) -> Vec<f32> {
        (0..probe.elements).map(|i| self.gap_m(phantom_from_probe, element_x_m(probe, i)) as f32).collect()
    }

    /// Gap under the point of the face at `x_m` along the array.
    pub(crate) fn gap_m(&self, phantom_from_probe: &Pose, x_m: f64) -> f64 {
        let along = phantom_from_probe.rotation * Vector::x();
        let axis = phantom_from_probe.rotation * Vector::z();
        let element = phantom_from_probe.translation.vector + along * x_m;
        let gap_m = (element.z / (-axis.z).max(0.1)).max(0.0);
        let foot = element + axis * gap_m;
        let beside = foot.x.abs() > self.half_size_m[0] || foot.y.abs() > self.half_size_m[1];
        if beside { self.thickness_m } else { gap_m }
    }
}

/// Position of an element along the array.
pub(crate) fn element_x_m(probe: &ProbeSpec, element: u32) -> f64 {
    (f64::from(element) - f64::from(probe.elements - 1) / 2.0) * probe.pitch_m
}

/// What the contact is like at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Touch {
    pub indentation_m: f64,
    pub force_n: f64,
}

impl Touch {
    /// At rest.
    pub(crate) fn resting(contact: &Contact, phantom_from_probe: &Pose) -> Self {
        let indentation_m = contact.mean_indentation_m(phantom_from_probe);
        Self { indentation_m, force_n: contact.force_n(indentation_m, 0.0) }
    }

    /// One tick later.
    pub(crate) fn step(&mut self, contact: &Contact, phantom_from_probe: &Pose) {
        let indentation_m = contact.mean_indentation_m(phantom_from_probe);
        let rate_m_s = (indentation_m - self.indentation_m) * TICKS_PER_SECOND as f64;
        *self = Self { indentation_m, force_n: contact.force_n(indentation_m, rate_m_s) };
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use sonoloop_types::Point;

    use super::*;
    use crate::fixture;

    fn down_at(z_m: f64, tilt_rad: f64) -> Pose {
        // Probe z down, x along world x, then leaned about y so that one end of the array rises.
        let down = UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI);
        Pose::from_parts(
            Vector::new(0.0, 0.0, z_m).into(),
            down * UnitQuaternion::from_axis_angle(&Vector::y_axis(), tilt_rad),
        )
    }

    #[test]
    fn truth_flat_punch_on_gelatin() {
        // Worked by hand: 60 × 12 mm on 5 % gelatin (E = 3 · 4.18 kPa) is about 0.5 N per mm.
        let mut probe = fixture::probe();
        (probe.elements, probe.pitch_m) = (200, 0.3e-3);
        let mut phantom = fixture::phantom();
        let background = usize::from(phantom.background);
        phantom.materials[background].youngs_modulus_pa = Some(3.0 * 4180.0);
        let contact = Contact::new(&probe, &phantom);
        let radius = (0.060f64 * 0.012 / std::f64::consts::PI).sqrt();
        let half_space = 2.0 * radius * 12_540.0 / (1.0 - 0.49f64.powi(2)) * 1e-3;
        let expected = half_space * layer_factor(radius, phantom.size_m[2], 0.49);
        let pressed = down_at(-1e-3, 0.0);
        let force = contact.force_n(contact.mean_indentation_m(&pressed), 0.0);
        assert!((force - expected).abs() < 1e-12 && (half_space - 0.5).abs() < 0.01, "{force}");
    }

    #[test]
    fn force_never_pulls() {
        let contact = Contact::new(&fixture::probe(), &fixture::phantom());
        assert_eq!(contact.force_n(-1e-3, 0.1), 0.0);
        assert_eq!(contact.force_n(1e-4, -10.0), 0.0);
        assert!(contact.force_n(1e-4, 0.01) > contact.force_n(1e-4, 0.0));
    }

    #[test]
    fn truth_partial_contact_matches_a_sum_over_the_array() {
        let probe = fixture::probe();
        let contact = Contact::new(&probe, &fixture::phantom());
        for (z, tilt) in [(0.0, 0.05), (-1e-3, 0.1), (1e-3, -0.2), (-5e-3, 0.02), (2e-3, 0.0)] {
            let pose = down_at(z, tilt);
            let count = 20_000;
            let mut sum = 0.0;
            for i in 0..count {
                let x = ((i as f64 + 0.5) / count as f64 - 0.5) * probe.aperture_m();
                let height = (pose.rotation * Vector::x()).z * x + z;
                sum += (-height / tilt.cos()).max(0.0);
            }
            let mean = sum / count as f64;
            assert!((contact.mean_indentation_m(&pose) - mean).abs() < 1e-9, "{z} {tilt}");
        }
    }

    #[test]
    fn leaning_opens_a_gap_at_one_end_only() {
        let probe = fixture::probe();
        let contact = Contact::new(&probe, &fixture::phantom());
        let gaps = contact.element_gaps_m(&down_at(0.0, 0.1), &probe);
        assert_eq!(gaps.len(), probe.elements as usize);
        let open = gaps.iter().filter(|g| **g > 0.0).count();
        assert_eq!(open, gaps.len() / 2);
        let largest = f64::from(gaps.iter().fold(0.0f32, |a, &b| a.max(b)));
        let expected = element_x_m(&probe, probe.elements - 1) * 0.1f64.tan();
        assert!((largest - expected).abs() < 1e-7, "{largest} {expected}");
    }

    #[test]
    fn truth_the_top_face_lies_where_a_leaning_face_presses_and_rests_where_it_does_not() {
        let probe = fixture::probe();
        let contact = Contact::new(&probe, &fixture::phantom());
        for lean_rad in [-0.1, -0.03, 0.0, 0.06] {
            let pose = down_at(-1e-3, lean_rad);
            let press = contact.indentation(&pose).expect("pressed");
            for element in (20..probe.elements - 20).step_by(7) {
                let face = pose * Point::new(element_x_m(&probe, element), 0.0, 0.0);
                let top = Point::new(face.x, face.y, 0.0);
                let sunk_m = -press.displacement_m(top).z;
                // Within what the ends of the face leave of the press.
                let expected_m =
                    (-face.z).max(0.0) * press.lengthwise(face.x - press.x_m) / press.lengthwise(0.0);
                assert!((sunk_m - expected_m).abs() < 1e-6, "{lean_rad} {element}: {sunk_m} {expected_m}");
            }
        }
    }

    #[test]
    fn an_array_beside_the_phantom_has_no_contact() {
        let (probe, phantom) = (fixture::probe(), fixture::phantom());
        let contact = Contact::new(&probe, &phantom);
        let mut pose = down_at(-1e-3, 0.0);
        pose.translation.x = phantom.size_m[0] / 2.0;
        let gaps = contact.element_gaps_m(&pose, &probe);
        assert_eq!(gaps.iter().filter(|g| **g > 0.0).count(), gaps.len() / 2);
    }
}
