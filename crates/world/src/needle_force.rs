//! What holds a needle back on its way, and what it takes along before it gets through.
//!
//! Structure after Simone and Okamura (ICRA 2002) and Okamura, Simone and O'Leary (IEEE TBME 2004): on the tip
//! a₁x + a₂x² while a face gives way by x, a drop when it is pierced, then the force of cutting; on the shaft friction
//! along what is buried. A face counts where the material beyond it takes more force to pierce than the one before. While
//! a face holds nothing is cut: the tip goes where the hub puts it, and the tissue goes with it; pierced, it slips back
//! over the tip. Friction takes no tissue along, force does not fade while the needle rests, and shaft and hub are rigid
//! until the tip stands on something hard. Those four are assumed.
//!
//! Symbols: x what a face has given way, a₁ and a₂ its stiffness.

use sonoloop_scenario::PassageSpec;
use sonoloop_types::{Drag, TICKS_PER_SECOND};

use crate::needle_path::Path;
use crate::phantom::Anatomy;

/// Diameter of the needle that the forces in the materials' file are for, 22G; others scale by theirs. Assumed.
pub(crate) const REFERENCE_DIAMETER_M: f64 = 0.718e-3;
/// Hub and shaft against a tip that stands on bone: the needle bows. Assumed.
const STANDING_STIFFNESS_N_M: f64 = 3e3;
/// Time constant with which pierced tissue slips back: most of it within one image. Assumed.
const RELEASE_S: f64 = 0.01;
/// Less than this is not carried along.
const NOTHING_M: f64 = 1e-6;

/// A face that holds until it is pierced.
#[derive(Debug, Clone, Copy)]
struct Face {
    depth_m: f64,
    beyond: PassageSpec,
    /// Force on the tip that it begins with: that of cutting before the face.
    from_n: f64,
    /// x at which it is pierced.
    dent_m: f64,
}

/// A stretch of the path in one material.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    start_m: f64,
    cutting_n: f64,
    friction_n_m: f64,
    /// Friction of all stretches above.
    friction_above_n: f64,
}

/// The unchanging part: what lies on the path. Forces are those on a 22G needle until [`Self::force_n`] scales them.
#[derive(Debug, Clone)]
pub(crate) struct Resistance {
    faces: Vec<Face>,
    stretches: Vec<Stretch>,
    stop_m: Option<f64>,
    scale: f64,
}

/// How far the needle has got.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Passage {
    /// Depth of the tip in space.
    pub tip_m: f64,
    /// How far the hub went on after the tip met what it cannot enter.
    pressed_m: f64,
    /// x: what the tip carries along of the tissue ahead, back along the path.
    carried_m: f64,
    /// ℓ of that tissue.
    decay_m: f64,
    /// The first face that is not pierced.
    next_face: usize,
    /// The tip is at that face.
    held: bool,
}

impl Resistance {
    pub(crate) fn new(path: &Path, anatomy: &Anatomy, diameter_m: f64) -> Self {
        let mut faces = Vec::new();
        let mut stretches: Vec<Stretch> = Vec::new();
        let mut before: Option<PassageSpec> = None;
        for piece in path.pieces() {
            let here = piece.material.and_then(|index| anatomy.passage(index)).copied();
            let [from_n, puncture_n] = before.map_or([0.0; 2], |p| [p.cutting_n, p.puncture_n]);
            if let Some(beyond) = here.filter(|here| here.puncture_n > puncture_n) {
                let dent_m = beyond.dent_m(from_n);
                if dent_m > 0.0 {
                    faces.push(Face { depth_m: piece.start_m, beyond, from_n, dent_m });
                }
            }
            let friction_above_n = stretches.last().map_or(0.0, |last| last.friction_to_n(piece.start_m));
            let [cutting_n, friction_n_m] = here.map_or([0.0; 2], |p| [p.cutting_n, p.friction_n_m]);
            stretches.push(Stretch { start_m: piece.start_m, cutting_n, friction_n_m, friction_above_n });
            before = here;
        }
        Self { faces, stretches, stop_m: path.stop_m(), scale: diameter_m / REFERENCE_DIAMETER_M }
    }

    /// Force along the needle on its hub, against the insertion.
    pub(crate) fn force_n(&self, passage: &Passage) -> f64 {
        let cut_m = passage.cut_m();
        let index = self.stretches.partition_point(|stretch| stretch.start_m <= cut_m);
        let Some(stretch) = index.checked_sub(1).and_then(|index| self.stretches.get(index)) else {
            return 0.0;
        };
        let on_tip_n = match self.faces.get(passage.next_face).filter(|_| passage.held) {
            Some(face) => {
                let x = passage.carried_m;
                face.from_n + (face.beyond.stiffness_n_m + face.beyond.stiffening_n_m2 * x) * x
            }
            None => stretch.cutting_n,
        };
        self.scale * (on_tip_n + stretch.friction_to_n(cut_m)) + STANDING_STIFFNESS_N_M * passage.pressed_m
    }
}

impl Stretch {
    fn friction_to_n(&self, depth_m: f64) -> f64 {
        self.friction_above_n + self.friction_n_m * (depth_m - self.start_m)
    }
}

impl Passage {
    /// A needle that has pierced everything down to a depth, and rests.
    pub(crate) fn at_rest(resistance: &Resistance, depth_m: f64) -> Self {
        Self {
            tip_m: depth_m,
            pressed_m: 0.0,
            carried_m: 0.0,
            decay_m: 1.0,
            next_face: resistance.faces.partition_point(|face| face.depth_m < depth_m),
            held: false,
        }
    }

    /// One tick later, with the hub where a needle that nothing stops has its tip at `free_tip_m`. True when a face was
    /// pierced. A phantom that moves may take the tip back: what is pierced stays pierced, a face that is not pierced
    /// is let go.
    pub(crate) fn step(&mut self, resistance: &Resistance, free_tip_m: f64) -> bool {
        self.tip_m = resistance.stop_m.map_or(free_tip_m, |stop_m| free_tip_m.min(stop_m));
        self.pressed_m = free_tip_m - self.tip_m;
        let next = resistance.faces.get(self.next_face);
        let mut pierced = false;
        if let Some(face) = next.filter(|_| self.held) {
            self.carried_m = (self.tip_m - face.depth_m).max(0.0);
            pierced = self.carried_m >= face.dent_m;
            self.held = self.carried_m > 0.0 && !pierced;
            self.next_face += usize::from(pierced);
        } else {
            let kept = libm::exp(-1.0 / (RELEASE_S * TICKS_PER_SECOND as f64));
            self.carried_m = if self.carried_m > NOTHING_M { self.carried_m * kept } else { 0.0 };
            if let Some(face) = next.filter(|face| self.cut_m() >= face.depth_m) {
                self.held = true;
                self.carried_m = self.tip_m - face.depth_m;
                self.decay_m = face.beyond.drag_decay_m;
            }
        }
        pierced
    }

    /// Depth that the tip has reached in the tissue.
    fn cut_m(&self) -> f64 {
        self.tip_m - self.carried_m
    }

    /// The tissue that goes along.
    pub(crate) fn drag(&self, path: &Path) -> Option<Drag> {
        (self.carried_m > NOTHING_M).then(|| {
            let centre_in_phantom = path.point_at(self.cut_m());
            Drag {
                centre_in_phantom,
                displacement_in_phantom: path.point_at(self.tip_m) - centre_in_phantom,
                decay_m: self.decay_m,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_scenario::{Inclusion, PhantomSpec, Shape};
    use sonoloop_types::{NeedleSpec, Point, Pose, Vector};

    use super::*;
    use crate::fixture;

    /// Straight down through the fixture's gel; from 20 to 30 mm another material.
    fn rig(layer: Option<PassageSpec>) -> (Path, Resistance) {
        let mut spec: PhantomSpec = fixture::phantom();
        let mut material = spec.materials[0].clone();
        material.needle = layer;
        spec.materials.push(material);
        spec.inclusions.push(Inclusion {
            name: "layer".into(),
            shape: Shape::Cuboid { size_m: [0.2, 0.1, 0.01] },
            phantom_from_inclusion: Pose::translation(0.0, 0.0, -0.025),
            material: 1,
        });
        let needle = NeedleSpec { curvature_per_m: 0.0, ..fixture::needle() };
        let anatomy = Anatomy::new(&spec);
        let path = Path::new(&needle, &anatomy, Point::origin(), -Vector::z(), 0.0, 0.05);
        let resistance = Resistance::new(&path, &anatomy, needle.outer_diameter_m);
        (path, resistance)
    }

    fn harder() -> PassageSpec {
        PassageSpec {
            friction_n_m: 12.0,
            cutting_n: 0.3,
            puncture_n: 0.9,
            stiffness_n_m: 200.0,
            stiffening_n_m2: 1e5,
            drag_decay_m: 4e-3,
            bending: 1.0,
        }
    }

    /// Feeds from `from_m` to `to_m` at 10 mm/s; every passage, force and whether something was pierced.
    fn fed(resistance: &Resistance, from_m: f64, to_m: f64) -> Vec<(Passage, f64, bool)> {
        let mut passage = Passage::at_rest(resistance, from_m);
        let ticks = ((to_m - from_m) / 1e-5).round() as usize;
        let step = |i: usize| {
            let pierced = passage.step(resistance, from_m + (to_m - from_m) * (i + 1) as f64 / ticks as f64);
            (passage, resistance.force_n(&passage), pierced)
        };
        (0..ticks).map(step).collect()
    }

    #[test]
    fn truth_the_face_holds_to_the_root_of_its_parabola_and_then_lets_go() {
        let (_, resistance) = rig(Some(harder()));
        let run = fed(&resistance, 0.015, 0.028);
        let pierced: Vec<_> = run.iter().filter(|(_, _, pierced)| *pierced).collect();
        assert_eq!(pierced.len(), 1);
        // 200x + 10⁵x² = 0.9 − 0.15: x = (−200 + √(200² + 4·10⁵·0.75))/(2·10⁵).
        let dent_m = (-200.0 + (4e4 + 3e5f64).sqrt()) / 2e5;
        let at_m = pierced[0].0.tip_m;
        assert!(at_m >= 0.02 + dent_m && at_m < 0.02 + dent_m + 1.1e-5, "{at_m} {dent_m}");
        // Just before: the puncture force, and the friction of 20 mm at 6 N/m.
        let largest_n = run.iter().map(|(_, force_n, _)| *force_n).fold(0.0, f64::max);
        assert!((largest_n - (0.9 + 0.12)).abs() < 0.01, "{largest_n}");
        // Well after: cutting, friction of 20 mm of the one and 8 mm of the other.
        let (last, force_n, _) = run[run.len() - 1];
        assert!((force_n - (0.3 + 6.0 * 0.02 + 12.0 * 0.008)).abs() < 1e-9, "{force_n}");
        assert_eq!(last.carried_m, 0.0);
    }

    #[test]
    fn truth_force_below_the_face_is_cutting_and_friction_by_length() {
        let (_, resistance) = rig(Some(harder()));
        for (passage, force_n, _) in fed(&resistance, 0.005, 0.0199) {
            assert!((force_n - (0.15 + 6.0 * passage.tip_m)).abs() < 1e-12, "{force_n}");
        }
    }

    #[test]
    fn a_phantom_that_draws_back_takes_an_unpierced_face_off_the_tip() {
        let (_, resistance) = rig(Some(harder()));
        let mut passage = Passage::at_rest(&resistance, 0.0199);
        let mut at =
            |hub_m: f64| (passage.step(&resistance, hub_m), passage.carried_m, resistance.force_n(&passage));
        at(0.02);
        let (pierced, carried_m, pressed_n) = at(0.0205);
        assert!(!pierced && (carried_m - 0.5e-3).abs() < 1e-12);
        let (pierced, carried_m, free_n) = at(0.0195);
        assert!(!pierced && carried_m == 0.0 && free_n < pressed_n);
        // And it is met again.
        at(0.02);
        let (_, carried_m, again_n) = at(0.0205);
        assert!((carried_m - 0.5e-3).abs() < 1e-12 && (again_n - pressed_n).abs() < 1e-12);
    }

    #[test]
    fn truth_a_thicker_needle_meets_more_by_its_diameter() {
        let (path, thin) = rig(Some(harder()));
        let thick = Resistance { scale: 2.0 * thin.scale, ..thin.clone() };
        let force_n = |resistance| resistance_at(resistance, 0.01);
        assert!((force_n(&thick) - 2.0 * force_n(&thin)).abs() < 1e-12);
        assert_eq!(path.stop_m(), None);
    }

    fn resistance_at(resistance: &Resistance, depth_m: f64) -> f64 {
        resistance.force_n(&Passage::at_rest(resistance, depth_m))
    }

    #[test]
    fn tissue_goes_with_the_tip_and_slips_back_within_some_tens_of_milliseconds() {
        let (path, resistance) = rig(Some(harder()));
        let run = fed(&resistance, 0.0195, 0.024);
        let drags: Vec<_> = run.iter().map(|(passage, _, _)| passage.drag(&path)).collect();
        assert!(drags[..49].iter().all(Option::is_none), "nothing before the face");
        let pierced = run.iter().position(|(_, _, pierced)| *pierced).unwrap();
        for (drag, (passage, ..)) in drags[51..pierced].iter().zip(&run[51..]) {
            let drag = drag.unwrap();
            assert!((drag.centre_in_phantom.z + 0.02).abs() < 2e-9, "the face is what the tip pushes");
            let pushed = drag.centre_in_phantom + drag.displacement_in_phantom;
            assert!((pushed - path.point_at(passage.tip_m)).norm() < 1e-12, "and it is at the tip");
            assert_eq!(drag.decay_m, 4e-3);
        }
        let size = |drag: Option<Drag>| drag.map_or(0.0, |drag| drag.displacement_in_phantom.norm());
        let before_m = size(drags[pierced]);
        // Some 1.9 mm; 40 ms later, one image, less than 2 % of it.
        assert!(before_m > 1.5e-3 && size(drags[pierced + 40]) < 0.02 * before_m, "{before_m}");
    }

    #[test]
    fn a_face_that_is_let_go_holds_again_and_one_that_is_pierced_does_not() {
        let (path, resistance) = rig(Some(harder()));
        let mut passage = Passage::at_rest(&resistance, 0.0195);
        let mut to = |depth_m| (0..2).any(|_| passage.step(&resistance, depth_m));
        assert!(!to(0.021) && !to(0.0195) && !to(0.021), "1 mm is not enough, however often");
        assert!(to(0.022) && !to(0.0195) && !to(0.022));
        assert!(passage.drag(&path).is_none_or(|drag| drag.displacement_in_phantom.norm() < 2e-3));
        (0..100).for_each(|_| assert!(!passage.step(&resistance, 0.0215)));
        assert_eq!(passage.drag(&path), None);
    }

    #[test]
    fn what_is_softer_or_the_same_holds_nothing_back() {
        for layer in [fixture::passage(), PassageSpec { puncture_n: 0.2, cutting_n: 0.1, ..harder() }] {
            let (path, resistance) = rig(Some(layer));
            let run = fed(&resistance, 0.005, 0.026);
            assert!(run.iter().all(|(passage, _, pierced)| !pierced && passage.drag(&path).is_none()));
        }
    }

    #[test]
    fn the_top_face_is_the_first_to_hold() {
        let (path, resistance) = rig(Some(fixture::passage()));
        let mut passage = Passage::at_rest(&resistance, 0.0);
        passage.step(&resistance, 1e-3);
        passage.step(&resistance, 1e-3);
        // Pushed in by 1 mm: 100·10⁻³ + 6·10⁴·10⁻⁶.
        let drag = passage.drag(&path).unwrap();
        assert!((drag.displacement_in_phantom + Vector::z() * 1e-3).norm() < 1e-12);
        assert!((resistance.force_n(&passage) - 0.16).abs() < 1e-12);
    }

    #[test]
    fn truth_on_bone_the_tip_stands_and_the_force_rises_with_the_hub() {
        let (_, resistance) = rig(None);
        let run = fed(&resistance, 0.015, 0.022);
        let (last, force_n, _) = run[run.len() - 1];
        assert!((last.tip_m - 0.02).abs() < 2e-9, "{}", last.tip_m);
        // Friction of 20 mm, and 2 mm of hub at 3 N/mm; the tip cuts nothing there.
        let expected_n = 6.0 * 0.02 + STANDING_STIFFNESS_N_M * 2e-3;
        assert!((force_n - expected_n).abs() < 1e-5, "{force_n} {expected_n}");
    }
}
