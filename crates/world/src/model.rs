//! What does not change during a run, and where it begins.

use sonoloop_scenario::Scenario;
use sonoloop_types::{Init, Point, Pose, Setup, Tissue, Vector, View};

use crate::WorldError;
use crate::arm::{Arm, ArmModel};
use crate::chain::Joints;
use crate::contact::Contact;
use crate::hand::{self, Hand};
use crate::hidden::{Hidden, encoder_noise};
use crate::needle_feed::FeedLimits;
use crate::needle_force::Resistance;
use crate::needle_path::Path;
use crate::needle_robot::{NeedleRobot, displaced};
use crate::phantom::{self, Anatomy};
use crate::placement;
use crate::scene::{MARGIN_M, Scene};
use crate::sway::{self, Sway};
use crate::truth;

/// Version of the protocol that [`Setup::protocol`] states.
pub const PROTOCOL: u32 = 1;

/// Immutable: the scenario, what was drawn from its seed, and what follows from both.
pub(crate) struct Model {
    pub scenario: Scenario,
    pub tissue: Tissue,
    pub arm: ArmModel,
    pub contact: Contact,
    pub path: Path,
    pub resistance: Resistance,
    pub needle_robot: NeedleRobot,
    /// Inserts the needle in the robot's place.
    pub hand: Option<Hand>,
    /// What scenario, needle and the needle robot's joints leave of the feed.
    pub feed_limits: FeedLimits,
    /// Where the needle robot really stands.
    world_from_needle_base: Pose,
    /// True mount of the probe before any slip.
    pub flange_from_mounted_probe: Pose,
    /// True target as a point of the resting phantom: pressed as at the start it lies on the needle's way.
    pub target_at_rest: Point,
    /// Measured pose of the probe at the start.
    pub base_from_probe_at_start: Pose,
    /// The rest of what the tracker is told.
    entry_in_base: Point,
    needle_axis_in_base: Vector,
    target_in_base: Point,
    click_px: [f64; 2],
}

impl Model {
    /// Draws, checks and places; the arm at rest and the scene come along.
    pub(crate) fn new(scenario: &Scenario) -> Result<(Self, Arm, Scene), WorldError> {
        check_values(scenario)?;
        let insertion = &scenario.insertion;
        let hidden = Hidden::draw(scenario.seed, &scenario.calibration, &scenario.placement);
        let arm = ArmModel::new(&scenario.arm, &scenario.limits, scenario.probe.aperture_m())?;
        let contact = Contact::new(&scenario.probe, &scenario.phantom);

        // The robot does what it is told in its own frame; where that frame stands it does not know.
        let robot_spec = &scenario.needle_robot;
        let needle_base_from_world = robot_spec.world_from_base.inverse();
        let needle_robot = NeedleRobot::new(
            robot_spec,
            scenario.needle.length_m,
            needle_base_from_world * insertion.entry_in_world,
            needle_base_from_world * insertion.axis_in_world,
        )?;
        let hand = insertion
            .hand
            .map(|spec| Hand::draw(scenario.seed, &spec, scenario.servo.feed_m_s, scenario.duration_ticks));
        let max_depth_m = match hand {
            Some(_) => scenario.needle.length_m,
            None => robot_spec.max_depth_m.min(scenario.needle.length_m),
        };
        if insertion.target_depth_m > max_depth_m {
            return Err(WorldError::TargetTooDeep {
                depth_mm: insertion.target_depth_m * 1e3,
                max_mm: max_depth_m * 1e3,
            });
        }
        let feed_limits = if let Some(hand) = &hand {
            FeedLimits {
                max_feed_m_s: hand.max_speed_m_s(),
                max_acceleration_m_s2: hand::MAX_ACCELERATION_M_S2,
                max_depth_m,
            }
        } else {
            for depth_m in [insertion.start_depth_m, insertion.target_depth_m] {
                needle_robot.check(depth_m)?;
            }
            FeedLimits {
                max_feed_m_s: robot_spec.max_feed_m_s.min(needle_robot.max_feed_m_s()),
                max_acceleration_m_s2: robot_spec.max_acceleration_m_s2,
                max_depth_m: max_depth_m.min(needle_robot.max_depth_m()),
            }
        };
        // World and phantom coincide while the phantom rests.
        let (entry_in_world, axis_in_world) = displaced(
            &robot_spec.world_from_base,
            &hidden.nominal_from_true_needle_base,
            insertion.entry_in_world,
            insertion.axis_in_world,
        );
        let anatomy = Anatomy::new(&scenario.phantom);
        let path = Path::new(
            &scenario.needle,
            &anatomy,
            entry_in_world + hidden.entry_error_in_world,
            hidden.axis_error * axis_in_world,
            insertion.bevel_roll_rad,
            max_depth_m,
        );

        if let Some(stop_m) = path.stop_m().filter(|stop_m| *stop_m <= insertion.start_depth_m) {
            let why = format!("something that no needle enters lies at {:.1} mm already", stop_m * 1e3);
            return Err(WorldError::Value { key: "insertion.start_depth_mm", why });
        }

        let flange_from_mounted_probe = scenario.arm.flange_from_probe * hidden.nominal_from_true_probe;
        let world_from_probe = placement::world_from_probe_at_start(scenario, &path, &hidden, &contact);
        let angles = placement::angles_at_start(&arm, &world_from_probe, &flange_from_mounted_probe)?;
        placement::check_follow_path(
            scenario,
            &arm,
            &path,
            &world_from_probe,
            &flange_from_mounted_probe,
            &angles,
        )?;
        let arm_at_rest = Arm::at_rest(&arm, angles);

        let world_from_needle_base = robot_spec.world_from_base * hidden.nominal_from_true_needle_base;
        let mut scene = Scene::new(scenario, &arm.chain, &needle_robot, &world_from_needle_base);
        let needle_links =
            needle_robot.link_poses(insertion.start_depth_m).map(|link| world_from_needle_base * link);
        scene.excuse_own_neighbours(arm_at_rest.link_poses(), &needle_links);
        if let Some(nearest) = scene.nearest(arm_at_rest.link_poses(), &needle_links) {
            let key = if nearest.with_needle_robot { "insertion" } else { "robot.world_from_base" };
            return Err(WorldError::StartCollision {
                key,
                between: nearest.between,
                margin_mm: MARGIN_M * 1e3,
            });
        }

        // From here on what the operator sees and marks: the measured pose, not the true one.
        let base_from_world = scenario.arm.world_from_base.inverse();
        let base_from_probe_at_start = arm_at_rest.base_from_flange() * scenario.arm.flange_from_probe;
        // The mark is set in image 0, with the encoders as they were then.
        let (noise_rad, _) = encoder_noise(scenario.seed, 0, &scenario.calibration);
        let base_from_probe_on_mark = measured(&arm, arm_at_rest.angles_rad(), &noise_rad);
        let true_world_from_probe =
            scenario.arm.world_from_base * arm_at_rest.base_from_flange() * flange_from_mounted_probe;
        let probe_from_world = true_world_from_probe.inverse();
        let target_in_phantom = Point::from(path.pose_at(insertion.target_depth_m).translation.vector);
        let mut target_in_probe = probe_from_world * target_in_phantom;
        if scenario.view == View::Lateral {
            // A mark in the picture has no elevation.
            target_in_probe.y = 0.0;
        }
        let sight = truth::sight(scenario, &path, &probe_from_world, insertion.start_depth_m);
        let click_px = [0, 1].map(|i| sight.reference_px[i] + hidden.click_error_px[i]);

        let model = Self {
            tissue: phantom::tissue(&scenario.phantom),
            arm,
            resistance: Resistance::new(&path, &anatomy, scenario.needle.outer_diameter_m),
            path,
            needle_robot,
            hand,
            feed_limits,
            world_from_needle_base,
            flange_from_mounted_probe,
            target_at_rest: contact
                .indentation(&true_world_from_probe)
                .map_or(target_in_phantom, |press| press.rest(target_in_phantom)),
            contact,
            base_from_probe_at_start,
            entry_in_base: base_from_world * insertion.entry_in_world,
            needle_axis_in_base: base_from_world * insertion.axis_in_world,
            target_in_base: base_from_probe_on_mark * target_in_probe,
            click_px,
            scenario: scenario.clone(),
        };
        Ok((model, arm_at_rest, scene))
    }

    /// How a hand has the needle sway; `None` in the robot's grip.
    pub(crate) fn sway(&self, tick: u64, depth_m: f64) -> Option<Sway> {
        let hand = self.hand.as_ref()?;
        let axis = self.path.axis_at_entry();
        Some(Sway {
            entry: self.path.point_at(0.0),
            axis,
            turn: hand.turn(tick, &axis, self.scenario.needle.length_m - depth_m),
            reach_m: sway::reach_m(self.scenario.needle.outer_diameter_m),
        })
    }

    /// Force on the needle at which whoever holds it stops for good.
    pub(crate) fn max_needle_force_n(&self) -> f64 {
        if self.hand.is_some() { hand::MAX_FORCE_N } else { self.scenario.needle_robot.max_force_n }
    }

    /// Links of the needle robot with the tip at a depth, world frame.
    pub(crate) fn needle_links(&self, depth_m: f64) -> [Pose; 5] {
        self.needle_robot.link_poses(depth_m).map(|link| self.world_from_needle_base * link)
    }

    /// What the encoders of both robots say with image `sequence`: the probe's pose under the nominal mount, and the
    /// needle's depth.
    pub(crate) fn measure(&self, angles_rad: &Joints, depth_m: f64, sequence: u64) -> (Pose, f64) {
        let scenario = &self.scenario;
        let (noise_rad, noise_m) = encoder_noise(scenario.seed, sequence, &scenario.calibration);
        (measured(&self.arm, angles_rad, &noise_rad), (depth_m + noise_m).max(0.0))
    }

    /// Nominal calibrations, marks and settings; nothing of the truth.
    pub(crate) fn setup(&self, run_id: u64) -> Setup {
        let scenario = &self.scenario;
        Setup {
            protocol: PROTOCOL,
            run_id,
            tick_rate_hz: sonoloop_types::TICKS_PER_SECOND as u32,
            image_period_ticks: scenario.image_period_ticks,
            view: scenario.view,
            geometry: scenario.probe.geometry,
            slice_thickness_m: scenario.probe.elevation.iter().map(|s| [s.depth_m, s.width_m]).collect(),
            flange_from_probe: scenario.arm.flange_from_probe,
            entry_in_base: self.entry_in_base,
            needle_axis_in_base: self.needle_axis_in_base,
            target_in_base: self.target_in_base,
            click_px: (scenario.tracker.init == Init::Click).then_some(self.click_px),
            limits: scenario.limits,
            tracker: scenario.tracker,
            servo: scenario.servo,
        }
    }
}

/// Pose of the probe under the nominal mount, base frame, as encoders with this noise tell it.
fn measured(arm: &ArmModel, angles_rad: &Joints, noise_rad: &Joints) -> Pose {
    let angles_rad = std::array::from_fn(|i| angles_rad[i] + noise_rad[i]);
    arm.chain.base_from_flange(&angles_rad) * arm.spec.flange_from_probe
}

/// What the loader already holds for files; a scenario built in code may not.
fn check_values(scenario: &Scenario) -> Result<(), WorldError> {
    let materials = scenario.phantom.materials.len();
    let bad = |key: &'static str, why: String| Err(WorldError::Value { key, why });
    if usize::from(scenario.phantom.background) >= materials {
        return bad("phantom.background", format!("material {} is not listed", scenario.phantom.background));
    }
    if let Some(inclusion) = scenario.phantom.inclusions.iter().find(|i| usize::from(i.material) >= materials)
    {
        return bad(
            "phantom.inclusions",
            format!("`{}` is made of a material that is not listed", inclusion.name),
        );
    }
    if scenario.probe.elevation.is_empty() || scenario.probe.elements == 0 {
        return bad("probe", "needs elements and a table of slice thickness".into());
    }
    let norm = scenario.insertion.axis_in_world.norm();
    if norm.is_nan() || (norm - 1.0).abs() > 1e-6 {
        return bad("insertion.angle_deg", "the needle's axis is not a unit vector".into());
    }
    let speed_m_s = scenario.limits.max_probe_speed_m_s;
    if speed_m_s.is_nan() || speed_m_s <= 0.0 {
        return bad("limits.max_probe_speed_mm_s", "must be above 0".into());
    }
    if scenario.image_period_ticks == 0 {
        return bad("image_rate_hz", "at least one tick lies between images".into());
    }
    Ok(())
}
