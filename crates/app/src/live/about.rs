use serde::Serialize;
use sonoloop_scenario::{Scenario, Shape};

use super::lessons::{Lesson, Lessons};
use super::plan::Plan;
use super::row::{PoseLine, pose_line};
use crate::output::{Setting, snake};

/// What stands for all of a run.
#[derive(Serialize)]
struct About<'a> {
    name: &'a str,
    seed: u64,
    lesson: Option<&'a str>,
    setting: Setting,
    phantom: PhantomLine<'a>,
    needle_length_m: f64,
    arm: RobotLine<'a>,
    needle_robot: Option<RobotLine<'a>>,
    form: Vec<Field>,
    set: &'a [String],
    lessons: &'a [Lesson],
}

#[derive(Serialize)]
struct PhantomLine<'a> {
    name: &'a str,
    size_m: [f64; 3],
    inclusions: Vec<InclusionLine<'a>>,
    target_in_world: [f64; 3],
}

#[derive(Serialize)]
struct InclusionLine<'a> {
    name: &'a str,
    material: &'a str,
    pose: PoseLine,
    ellipsoid: Option<[f64; 3]>,
    cylinder: Option<[f64; 2]>,
    cuboid: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct RobotLine<'a> {
    name: &'a str,
    urdf: String,
    base_link: &'a str,
    /// The link that carries probe or needle.
    end_link: &'a str,
    joints: &'a [String],
    world_from_base: PoseLine,
}

/// A setting that the page offers to change, by its key in a scenario.
#[derive(Serialize)]
struct Field {
    key: &'static str,
    label: &'static str,
    value: String,
    /// What it may be, where that is not a number.
    choices: &'static [&'static str],
}

/// The run as JSON.
pub(super) fn about(scenario: &Scenario, plan: &Plan, lessons: &Lessons) -> Result<String, String> {
    let (arm, robot) = (&scenario.arm, &scenario.needle_robot);
    let text = |urdf| urdf_rs::write_to_string(urdf).map_err(|error| error.to_string());
    let by_robot = scenario.insertion.hand.is_none();
    let needle_robot = by_robot.then(|| {
        Ok::<_, String>(RobotLine {
            name: &robot.name,
            urdf: text(&robot.urdf)?,
            base_link: &robot.base_link,
            end_link: &robot.hub_link,
            joints: &robot.joint_names,
            world_from_base: pose_line(&robot.world_from_base),
        })
    });
    let insertion = &scenario.insertion;
    let target = insertion.entry_in_world + insertion.axis_in_world * insertion.target_depth_m;
    let about = About {
        name: &scenario.name,
        seed: scenario.seed,
        lesson: plan.lesson.as_deref(),
        setting: Setting::of(scenario),
        phantom: PhantomLine {
            name: &scenario.phantom.name,
            size_m: scenario.phantom.size_m,
            inclusions: inclusions(scenario),
            target_in_world: target.coords.into(),
        },
        needle_length_m: scenario.needle.length_m,
        arm: RobotLine {
            name: &arm.name,
            urdf: text(&arm.urdf)?,
            base_link: &arm.base_link,
            end_link: &arm.flange_link,
            joints: &arm.joint_names,
            world_from_base: pose_line(&arm.world_from_base),
        },
        needle_robot: needle_robot.transpose()?,
        form: form(scenario),
        set: &plan.set,
        lessons: &lessons.0,
    };
    serde_json::to_string(&about).map_err(|error| error.to_string())
}

fn inclusions(scenario: &Scenario) -> Vec<InclusionLine<'_>> {
    let phantom = &scenario.phantom;
    let line = |inclusion: &'_ sonoloop_scenario::Inclusion| {
        let (mut ellipsoid, mut cylinder, mut cuboid) = (None, None, None);
        match inclusion.shape {
            Shape::Ellipsoid { radii_m } => ellipsoid = Some(radii_m),
            Shape::Cylinder { radius_m, length_m } => cylinder = Some([radius_m, length_m]),
            Shape::Cuboid { size_m } => cuboid = Some(size_m),
        }
        (ellipsoid, cylinder, cuboid)
    };
    let lines = phantom.inclusions.iter().map(|inclusion| {
        let (ellipsoid, cylinder, cuboid) = line(inclusion);
        InclusionLine {
            name: &inclusion.name,
            material: &phantom.materials[usize::from(inclusion.material)].name,
            pose: pose_line(&inclusion.phantom_from_inclusion),
            ellipsoid,
            cylinder,
            cuboid,
        }
    });
    lines.collect()
}

/// What the page offers to change. Their bounds are those of the scenario's files, whose complaint the page shows.
fn form(scenario: &Scenario) -> Vec<Field> {
    let (tracker, servo) = (&scenario.tracker, &scenario.servo);
    let choice = |key, label, value: String, choices| Field { key, label, value, choices };
    let number = |key, label, value: f64| {
        // Six digits: no 0.30000000000000004 from a change of units.
        let value = format!("{value:.6}");
        Field {
            key,
            label,
            value: value.trim_end_matches('0').trim_end_matches('.').to_owned(),
            choices: &[],
        }
    };
    vec![
        choice("tracker.similarity", "similarity", snake(&tracker.similarity), &["ssd", "scv"]),
        choice(
            "tracker.update",
            "template update",
            snake(&tracker.update),
            &["none", "naive", "drift_corrected"],
        ),
        choice("tracker.warp", "warp", snake(&tracker.warp), &["translation", "rigid", "affine"]),
        number("tracker.template_px", "template, px", tracker.template_px.into()),
        number("tracker.loss_ncc_previous", "lost below NCC with last image", tracker.loss_ncc_previous),
        number("tracker.loss_ncc_anchor", "lost below NCC with first image", tracker.loss_ncc_anchor),
        number("tracker.recovery_ncc", "found above NCC", tracker.recovery_ncc),
        number("servo.feed_mm_s", "feed, mm/s", servo.feed_m_s * 1e3),
        number("servo.elevation_gain", "elevation gain, 1/s", servo.elevation_gain_per_s),
        number("servo.slide_gain", "slide gain, 1/s", servo.slide_gain_per_s),
        number("servo.along_gain", "gain along the needle, 1/s", servo.along_gain_per_s),
        number("servo.dither_mm", "dither, mm", servo.dither_m * 1e3),
        number("servo.sweep_speed_mm_s", "search speed, mm/s", servo.sweep_speed_m_s * 1e3),
        number("servo.sweep_reach_mm", "search reach, mm", servo.sweep_reach_m * 1e3),
    ]
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::cli::ScenarioArgs;

    #[test]
    fn every_value_that_the_form_offers_is_one_that_a_scenario_takes() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/lateral_recovery.yaml");
        let mut plan = Plan::new(&ScenarioArgs { file, seed: None, set: Vec::new() });
        let (scenario, _) = plan.prepare(&Lessons::default()).expect("sound");
        let fields = form(&scenario);
        plan.set = fields.iter().map(|field| format!("{}={}", field.key, field.value)).collect();
        let (again, _) = plan.prepare(&Lessons::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((again.tracker, again.servo), (scenario.tracker, scenario.servo));
        for field in &fields {
            for choice in field.choices {
                plan.set = vec![format!("{}={choice}", field.key)];
                plan.check(&Lessons::default()).unwrap_or_else(|error| panic!("{error}"));
            }
        }
        assert!(about(&scenario, &plan, &Lessons::default()).expect("JSON").contains("<robot"));
    }
}
