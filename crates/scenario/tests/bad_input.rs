//! Bad files and bad options: each gives one message that names file, line, key, value and bound.

mod common;

use std::path::Path;

use sonoloop_scenario::{LoadError, LoadOptions, load};

const SCENARIO: &str = "scenarios/lateral_recovery.yaml";
const ARM: &str = "robots/kuka_kr6_r900/robot.yaml";
const URDF: &str = "robots/kuka_kr6_r900/robot.urdf";
const NEEDLE_ROBOT: &str = "robots/needle_robot/robot.yaml";
const NEEDLE_URDF: &str = "robots/needle_robot/robot.urdf";
const PHANTOM: &str = "phantoms/gelatin_agar_heterogeneous.yaml";

/// One edit of a sound file, and what the message must say.
struct Case {
    file: &'static str,
    from: &'static str,
    to: &'static str,
    says: &'static [&'static str],
}

fn case(file: &'static str, from: &'static str, to: &'static str, says: &'static [&'static str]) -> Case {
    Case { file, from, to, says }
}

fn cases() -> Vec<Case> {
    let mut cases = scenario_cases();
    cases.extend(robot_cases());
    cases.extend(phantom_and_tool_cases());
    cases
}

/// The knock of [`SCENARIO`], to put something else in its place.
const KNOCK: &str = "probe_knock: {elevation_mm: 3, duration_s: 0.1}";

fn scenario_cases() -> Vec<Case> {
    let s = SCENARIO;
    vec![
        // Keys and types.
        case(
            s,
            "duration_s: 40",
            "duration_s: 40\nbreathing: 1",
            &["breathing", "unknown field", "duration_s"],
        ),
        case(s, "angle_deg: 40", "angle_rad: 0.7", &["insertion.angle_rad", "unknown field", "angle_deg"]),
        case(
            s,
            "angle_deg: 40",
            "angle_deg: steep",
            &["insertion.angle_deg = \"steep\"", "must be a number"],
        ),
        case(s, "seed: 0", "seed: -1", &["seed = -1", "whole number, 0 or more"]),
        case(s, "view: lateral", "view: sideways", &["view = \"sideways\"", "lateral", "transverse"]),
        case(s, "  angle_deg: 40\n", "", &["insertion:", "missing field", "angle_deg"]),
        case(s, "seed: 0", "seed: 0\nseed: 1", &["duplicate", "seed"]),
        case(s, "entry_mm: [-32, 0]", "entry_mm: [-32, 0", &["lateral_recovery.yaml:13:12", "':'"]),
        // Ranges.
        case(
            s,
            "tracker:\n",
            "calibration: {robot_deg: 6}\ntracker:\n",
            &["calibration.robot_deg = 6", "at most 5"],
        ),
        case(
            s,
            "tracker:\n",
            "calibration: {encoder_deg: -0.1}\ntracker:\n",
            &["calibration.encoder_deg = -0.1", "at least 0"],
        ),
        case(s, "angle_deg: 40", "angle_deg: 95", &["insertion.angle_deg = 95", "at most 85"]),
        case(s, "duration_s: 40", "duration_s: 0", &["duration_s = 0", "at least 0.1"]),
        case(s, "angle_deg: 40", "angle_deg: .nan", &["insertion.angle_deg = NaN", "finite"]),
        case(s, "duration_s: 40", "duration_s: .inf", &["duration_s = inf", "finite"]),
        case(s, "template_px: 20", "template_px: 7", &["tracker.template_px = 7", "at least 8"]),
        case(
            s,
            "elevation_mm: 3,",
            "elevation_mm: 30,",
            &["disturbances.0.probe_knock.elevation_mm = 30", "at most 20"],
        ),
        // More than one value.
        case(
            s,
            "duration_s: 40",
            "duration_s: 40\nimage_rate_hz: 24",
            &["image_rate_hz = 24", "divide", "1000"],
        ),
        case(
            s,
            "duration_s: 40",
            "duration_s: 40\nimages: 1001",
            &["images = 1001", "at most 1000", "duration_s = 40"],
        ),
        case(s, "duration_s: 40", "duration_s: 40\nimages: 0", &["images = 0", "at least 1"]),
        case(
            s,
            "target_depth_mm: 62",
            "target_depth_mm: 145",
            &["insertion.target_depth_mm = 145", "at most 140", "needle robot"],
        ),
        case(
            s,
            "target_depth_mm: 62",
            "target_depth_mm: 160",
            &["target_depth_mm = 160", "at most 150", "22G"],
        ),
        case(
            s,
            "target_depth_mm: 62",
            "target_depth_mm: 100",
            &["target_depth_mm = 100", "z = -64.3 mm", "[-60, 0]"],
        ),
        case(
            s,
            "target_depth_mm: 62",
            "target_depth_mm: 80",
            &["target_depth_mm = 80", "51.4 mm", "48.0 mm"],
        ),
        case(s, "start_depth_mm: 14", "start_depth_mm: 65", &["start_depth_mm = 65", "target_depth_mm = 62"]),
        case(
            s,
            "start_depth_mm: 14",
            "start_depth_mm: 1",
            &["start_depth_mm = 1", "row 6", "at least 11 px"],
        ),
        case(
            s,
            "tip_lateral_mm: -8",
            "tip_lateral_mm: -31.5",
            &["tip_lateral_mm = -31.5", "column", "at least 11 px"],
        ),
        case(
            s,
            "entry_mm: [-32, 0]",
            "entry_mm: [-32, 51]",
            &["entry_mm = [-32, 51]", "top face", "[-50, 50]"],
        ),
        case(
            s,
            "contact_force_n: 1",
            "contact_force_n: 9",
            &["contact_force_n = 9", "max_contact_force_n = 8"],
        ),
        case(
            s,
            "  sweep_speed_mm_s: 7",
            "  feed_mm_s: 13",
            &["servo.feed_mm_s = 13", "limits.max_feed_mm_s = 12"],
        ),
        case(
            s,
            "randomize:",
            "limits: {max_feed_mm_s: 13}\nrandomize:",
            &["max_feed_mm_s = 13", "at most 12", "needle robot"],
        ),
        // The timeline.
        case(
            s,
            KNOCK,
            "gain_change: {gain_db: 3}\n    lift_off: {height_mm: 3, duration_s: 1}",
            &["disturbances.0.at_s = 3:", "exactly one", "probe_knock"],
        ),
        case(
            s,
            "    probe_knock: {elevation_mm: 3, duration_s: 0.1}\n",
            "",
            &["disturbances.0", "exactly one"],
        ),
        case(s, "elevation_mm: 3,", "elevation_mm: 0,", &["disturbances.0.probe_knock", "must move"]),
        case(
            s,
            "elevation_mm: 3,",
            "roll_deg: 31,",
            &["disturbances.0.probe_knock.roll_deg = 31", "at most 30"],
        ),
        case(
            s,
            KNOCK,
            "gel_lost: {from_mm: -120, to_mm: 5, gap_mm: 0.3, duration_s: 1}",
            &["gel_lost.from_mm = -120", "at least -100"],
        ),
        case(
            s,
            KNOCK,
            "gel_lost: {from_mm: 5, to_mm: 5, gap_mm: 0.3, duration_s: 1}",
            &["gel_lost.to_mm = 5", "above from_mm = 5"],
        ),
        case(
            s,
            KNOCK,
            "gel_lost: {from_mm: 0, to_mm: 5, gap_mm: 0, duration_s: 1}",
            &["gel_lost.gap_mm = 0", "at least 0.001"],
        ),
        case(s, KNOCK, "noise: {gain_db: 70}", &["noise.gain_db = 70", "at most 60"]),
        case(
            s,
            KNOCK,
            "shadow: {x_mm: 0, width_mm: 0, loss_db: 20, duration_s: 1}",
            &["shadow.width_mm = 0", "at least 0.1"],
        ),
        case(
            s,
            KNOCK,
            "shadow: {x_mm: 0, width_mm: 5, loss_db: -3, duration_s: 1}",
            &["shadow.loss_db = -3", "at least 0.1"],
        ),
        case(s, KNOCK, "frozen_images: {duration_s: 0}", &["frozen_images.duration_s = 0", "at least 0.001"]),
        case(s, KNOCK, "frozen_images: {duration_s: 38}", &["disturbances.0.at_s", "at most 2", "38 s"]),
        case(
            s,
            KNOCK,
            "dropped_images: {share: 1.5, duration_s: 1}",
            &["dropped_images.share = 1.5", "at most 1"],
        ),
        case(s, KNOCK, "dropped_images: {share: 0.5}", &["disturbances.0", "missing field", "duration_s"]),
        case(s, KNOCK, "command_delay: {command_ms: 0}", &["command_delay.command_ms = 0", "at least 1"]),
        case(s, KNOCK, "arm_stall: {duration_s: 700}", &["arm_stall.duration_s = 700", "at most 600"]),
        case(s, KNOCK, "tracker_hung: {down_s: 1}", &["tracker_hung.down_s", "unknown field", "duration_s"]),
        case(
            s,
            KNOCK,
            "tracker_garbage: {duration_s: -1}",
            &["tracker_garbage.duration_s = -1", "at least 0.001"],
        ),
        case(
            s,
            KNOCK,
            "tracker_hung: {duration_s: 1}\n    tracker_garbage: {duration_s: 1}",
            &["exactly one", "tracker_hung"],
        ),
        case(
            s,
            KNOCK,
            "breathing: {z_mm: 25, period_s: 4}",
            &["disturbances.0.breathing.z_mm = 25", "at most 20"],
        ),
        case(
            s,
            KNOCK,
            "breathing: {z_mm: 2, period_s: 0.1}",
            &["disturbances.0.breathing.period_s = 0.1", "at least 0.5"],
        ),
        case(
            s,
            KNOCK,
            "phantom_drift: {duration_s: 1}",
            &["disturbances.0.phantom_drift", "must move the phantom"],
        ),
        case(s, KNOCK, "phantom_step: {x_mm: 1, duration_s: 38}", &["disturbances.0.at_s = 3", "at most 2"]),
        case(s, "duration_s: 40", "duration_s: 3", &["disturbances.0.at_s", "at most 2.9", "duration_s = 3"]),
        // Randomize.
        case(
            s,
            "insertion.angle_deg, uniform",
            "insertion.angel_deg, uniform",
            &["insertion.angel_deg", "unknown field", "randomize.2"],
        ),
        case(s, "disturbances.0.at_s", "disturbances.1.at_s", &["randomize.1.key", "index below 1"]),
        case(
            s,
            "uniform: [36, 44]",
            "uniform: [36, 95]",
            &["insertion.angle_deg = 95", "at most 85", "which randomize.2 may draw"],
        ),
        case(
            s,
            "uniform: [36, 44]",
            "uniform: [36, 80]",
            &["target_depth_mm = 62", "with insertion.angle_deg = 80 which randomize.2 may draw"],
        ),
        case(s, "uniform: [36, 44]", "uniform: [44, 36]", &["randomize.2.uniform = [44, 36]", "low ≤ high"]),
        case(s, "uniform: [36, 44]", "uniform: [36, 44], choice: [40]", &["randomize.2.key", "exactly one"]),
        case(s, "choice: [-3, 3]", "choice: []", &["randomize.0.choice", "1"]),
        case(s, "key: insertion.angle_deg", "key: disturbances.0.at_s", &["randomize.2.key", "twice"]),
        case(
            s,
            "key: insertion.angle_deg",
            "key: seed",
            &["randomize.2.key = \"seed\"", "must not be drawn"],
        ),
        // Expect.
        case(
            s,
            "tip_rmse_mm: {max: 0.5}",
            "tip_rsme_mm: {max: 0.5}",
            &["expect.tip_rsme_mm", "no metric", "tip_rmse_mm"],
        ),
        case(s, "coverage: {min: 0.9}", "coverage: true", &["expect.coverage = true", "number"]),
        case(s, "success: true", "success: {min: 1}", &["expect.success", "true or false"]),
        case(s, "coverage: {min: 0.9}", "coverage: {}", &["expect.coverage", "min, max or both"]),
        case(
            s,
            "coverage: {min: 0.9}",
            "coverage: {min: 0.9, max: 0.1}",
            &["expect.coverage.min = 0.9", "max = 0.1"],
        ),
        case(
            s,
            "coverage: {min: 0.9}",
            "coverage: {least: 0.9}",
            &["expect.coverage.least", "unknown field"],
        ),
        case(s, "coverage: {min: 0.9}", "coverage: 0.9", &["expect.coverage = 0.9", "{min: …, max: …}"]),
        // A hand.
        case(
            s,
            "target_tolerance_mm: 2",
            "target_tolerance_mm: 2\n  manual: {tremor_mm: 9}",
            &["insertion.manual.tremor_mm = 9", "at most 5"],
        ),
        case(
            s,
            "target_tolerance_mm: 2",
            "target_tolerance_mm: 2\n  manual: {speed_mm_s: [14, 6]}",
            &["insertion.manual.speed_mm_s = [14, 6]", "low ≤ high"],
        ),
        case(
            s,
            "target_tolerance_mm: 2",
            "target_tolerance_mm: 2\n  manual: {reaction_ms: [300, 9000]}",
            &["insertion.manual.reaction_ms.1 = 9000", "at most 5000"],
        ),
        case(
            s,
            "target_tolerance_mm: 2",
            "target_tolerance_mm: 2\n  manual: {feed_mm_s: 3}",
            &["insertion.manual.feed_mm_s", "unknown field"],
        ),
        // Named files.
        case(
            s,
            "kuka_kr6_r900/robot.yaml",
            "kuka/robot.yaml",
            &["robot = \"../robots/kuka/robot.yaml\"", "no such file", "robots/kuka/robot.yaml"],
        ),
        case(
            s,
            "phantom: ../phantoms/gelatin_agar_heterogeneous.yaml",
            "phantom: ../phantoms",
            &["is not a file"],
        ),
    ]
}

fn robot_cases() -> Vec<Case> {
    let fixed = "name=\"joint_a5\" type=\"revolute\"";
    vec![
        case(ARM, "urdf: robot.urdf", "urdf: missing.urdf", &["urdf = \"missing.urdf\"", "no such file"]),
        case(
            ARM,
            "flange_link: tool0",
            "flange_link: tool1",
            &["flange_link = \"tool1\"", "robot.urdf", "tool0"],
        ),
        case(ARM, "base_link: base_link", "base_link: base", &["base_link = \"base\"", "robot.urdf"]),
        case(ARM, "base_link: base_link", "base_link: link_1", &["has 5 actuated joints", "exactly 6"]),
        case(
            ARM,
            "home_deg: [0, -58.54",
            "home_deg: [0, 46",
            &["home_deg.1 = 46", "[-190.0, 45.0]", "joint_a2"],
        ),
        case(ARM, "signs: [-1, 1", "signs: [-1, 0", &["opw.signs.1 = 0", "1 or -1"]),
        case(ARM, "max_jerk_rad_s3: 400", "max_jerk_rad_s3: 0", &["max_jerk_rad_s3 = 0", "at least 1"]),
        case(URDF, fixed, "name=\"joint_a5\" type=\"fixed\"", &["has 5 actuated joints", "exactly 6"]),
        case(
            URDF,
            fixed,
            "name=\"joint_a5\" type=\"prismatic\"",
            &["joint `joint_a5`", "prismatic", "revolute"],
        ),
        case(
            URDF,
            "<child link=\"link_5\"/>",
            "<child link=\"link_9\"/>",
            &["joint `joint_a5`", "dangles", "child link `link_9`"],
        ),
        case(
            URDF,
            "<parent link=\"link_4\"/>",
            "<parent link=\"link_9\"/>",
            &["joint `joint_a5`", "dangles", "parent link `link_9`"],
        ),
        case(URDF, "<parent link=\"link_4\"/>", "<parent link=\"link_6\"/>", &["no chain", "base_link"]),
        case(
            URDF,
            "<parent link=\"link_4\"/>",
            "<parent link=\"link_5\"/>",
            &["joint `joint_a5`", "to itself"],
        ),
        case(URDF, "<child link=\"link_5\"/>", "<child link=\"link_3\"/>", &["second joint", "link_3"]),
        case(
            URDF,
            "lower=\"-2.96706\"",
            "lower=\"3\"",
            &["joint `joint_a1`", "lower = 3", "upper = 2.96706", "lower < upper"],
        ),
        case(URDF, "upper=\"2.96706\"", "upper=\"inf\"", &["joint `joint_a1`", "upper = inf", "finite"]),
        case(URDF, "<axis xyz=\"0 0 -1\"/>", "<axis xyz=\"0 0 0\"/>", &["joint `joint_a1`", "axis 0 0 0"]),
        case(URDF, "velocity=\"6.283185\"", "velocity=\"-1\"", &["joint `joint_a1`", "velocity = -1", "> 0"]),
        case(URDF, "<origin xyz=\"0.025 0 0\"", "<origin xyz=\"nan 0 0\"", &["joint `joint_a2`", "finite"]),
        case(URDF, "</robot>", "", &["is not a URDF"]),
        case(URDF, "<robot name", "<machine name", &["is not a URDF"]),
        // A seventh joint; one without limits; limits of a sort that turns; links in a loop.
        case(
            URDF,
            "<joint name=\"flange-tool0\" type=\"fixed\">",
            "<joint name=\"flange-tool0\" type=\"continuous\"><limit effort=\"0\" velocity=\"1\"/>",
            &["has 7 actuated joints", "exactly 6"],
        ),
        case(
            URDF,
            "<limit lower=\"-2.96706\" upper=\"2.96706\" effort=\"0\" velocity=\"6.283185\"/>",
            "",
            &["joint `joint_a1`", "lower = 0, upper = 0", "lower < upper (rad)"],
        ),
        case(
            URDF,
            fixed,
            "name=\"joint_a5\" type=\"floating\"",
            &["joint `joint_a5`", "is floating", "revolute"],
        ),
        case(
            URDF,
            "<parent link=\"base_link\"/>",
            "<parent link=\"tool0\"/>",
            &["no chain of joints", "`base_link`", "`tool0`", "loop"],
        ),
        case(NEEDLE_ROBOT, "hub_link: hub", "hub_link: tip", &["hub_link = \"tip\"", "robot.urdf", "chuck"]),
        case(NEEDLE_ROBOT, "hub_link: hub", "hub_link: yaw_head", &["has 4 actuated joints", "exactly 5"]),
        case(NEEDLE_ROBOT, "urdf: robot.urdf\n", "", &["missing field", "urdf"]),
        case(
            NEEDLE_URDF,
            "name=\"lift\" type=\"prismatic\"",
            "name=\"lift\" type=\"revolute\"",
            &["joint `lift`", "is revolute", "joint 3 of the 5", "must be prismatic"],
        ),
        case(
            NEEDLE_URDF,
            "lower=\"-0.220\"",
            "lower=\"0.3\"",
            &["joint `lift`", "lower = 0.3, upper = 0.22", "lower < upper (m)"],
        ),
        case(
            NEEDLE_URDF,
            "upper=\"0.150\" effort=\"0\" velocity=\"0.050\"",
            "upper=\"0.150\" effort=\"0\" velocity=\"0\"",
            &["joint `reach`", "velocity = 0", "> 0 (m/s)"],
        ),
        case(NEEDLE_ROBOT, "max_force_n: 8", "max_force_n: 0", &["max_force_n = 0", "at least 0.1"]),
        case(NEEDLE_ROBOT, "watchdog_ms: 200", "watchdog_ms: 0", &["watchdog_ms = 0", "at least 1"]),
    ]
}

fn phantom_and_tool_cases() -> Vec<Case> {
    let probe = "robots/probes/l12_3v.yaml";
    let materials = "phantoms/materials.yaml";
    vec![
        case(
            PHANTOM,
            "size_mm: [200, 100, 60]",
            "size_mm: [200, -100, 60]",
            &["size_mm.1 = -100", "at least 5"],
        ),
        case(
            PHANTOM,
            "background: gelatin_agar",
            "background: jelly",
            &["background = \"jelly\"", "materials.yaml", "gelatin_agar"],
        ),
        case(
            PHANTOM,
            "material: clear_liquid",
            "material: liquid",
            &["inclusions.8.material = \"liquid\"", "clear_liquid"],
        ),
        case(
            PHANTOM,
            "name: pale lump",
            "name: dense lump",
            &["inclusions.4.name = \"dense lump\"", "unique"],
        ),
        case(
            PHANTOM,
            "centre_mm: [23, 1, -16]",
            "centre_mm: [23, 1, -4]",
            &["inclusions.8.centre_mm", "-9.00 to 1.00 mm along z", "[-60, 0]"],
        ),
        case(
            PHANTOM,
            "radius_mm: 0.15",
            "radius_mm: 0",
            &["inclusions.9.cylinder.radius_mm = 0", "at least 0.01"],
        ),
        case(
            PHANTOM,
            "ellipsoid: {radii_mm: [6, 7, 5]}",
            "sphere: {radius_mm: 5}",
            &["inclusions.8.sphere", "unknown field", "ellipsoid"],
        ),
        case(PHANTOM, "    ellipsoid: {radii_mm: [6, 7, 5]}\n", "", &["inclusions.8", "exactly one"]),
        case(
            PHANTOM,
            "materials: materials.yaml",
            "materials: stuff.yaml",
            &["materials = \"stuff.yaml\"", "no such file"],
        ),
        case(
            materials,
            "sound_speed_m_s: 1483",
            "sound_speed_m_s: 1.483",
            &["materials.water.sound_speed_m_s = 1.483", "at least 300"],
        ),
        case(
            materials,
            "backscatter_db: 18",
            "backscatter_db: loud",
            &["materials.echogenic.backscatter_db = \"loud\""],
        ),
        case(
            materials,
            "friction_n_m: 15",
            "friction_n_m: -15",
            &["materials.agar.needle.friction_n_m = -15", "at least 0"],
        ),
        case(
            materials,
            "cutting_n: 0.3, puncture_n: 0.8, stiffness_n_m: 400",
            "cutting_n: 0.3, puncture_n: 0.2, stiffness_n_m: 400",
            &["materials.agar.needle.puncture_n = 0.2", "at least cutting_n = 0.3"],
        ),
        case(
            materials,
            "stiffness_n_m: 400, stiffening_n_m2: 200000",
            "stiffness_n_m: 0, stiffening_n_m2: 0",
            &["materials.agar.needle.puncture_n = 0.8", "given way by inf mm", "at most 3.2 mm"],
        ),
        case(probe, "depth_mm: 18,", "depth_mm: 11,", &["elevation.4.depth_mm = 11", "above 15"]),
        case(probe, "pitch_mm: 0.2", "pitch_mm: 0.5", &["pitch_mm = 0.5", "96.0 mm", "64.0 mm"]),
        case(probe, "elements: 192", "elements: 192.5", &["elements = 192.5"]),
        case(
            "robots/needles/22g_150mm.yaml",
            "length_mm: 150",
            "length_mm: -150",
            &["length_mm = -150", "at least 10"],
        ),
    ]
}

/// Makes the edit in the copy under `dir`.
fn spoil(dir: &Path, case: &Case) {
    let path = dir.join(case.file);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(case.from), "{} does not hold {:?}", case.file, case.from);
    std::fs::write(&path, text.replacen(case.from, case.to, 1)).unwrap();
}

fn one_line(error: &LoadError) -> String {
    let message = error.to_string();
    assert_eq!(message.lines().count(), 1, "one message: {message}");
    message
}

#[test]
fn every_bad_file_is_told_by_key_value_and_bound() {
    let mut failures = Vec::new();
    for case in cases() {
        let dir = common::sandbox();
        spoil(dir.path(), &case);
        let what = format!("{}: {:?} → {:?}", case.file, case.from, case.to);
        match load(&dir.path().join(SCENARIO), &LoadOptions::default()) {
            Ok(_) => failures.push(format!("{what} was taken")),
            Err(error) => {
                let message = one_line(&error).replace(&dir.path().display().to_string(), "");
                let missing: Vec<_> = case.says.iter().filter(|part| !message.contains(*part)).collect();
                if !missing.is_empty() {
                    failures.push(format!("{what}\n   said {message}\n   without {missing:?}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The line in the message is the line of the edit, in the file that was edited, and is underlined.
#[test]
fn the_offending_line_is_shown_and_underlined() {
    for (file, from, to, line_holds) in [
        (SCENARIO, "angle_deg: 40", "angle_deg: 95", "  angle_deg: 95"),
        (SCENARIO, "angle_deg: 40", "angel_deg: 40", "  angel_deg: 40"),
        (SCENARIO, "angle_deg: 40", "angle_deg: steep", "  angle_deg: steep"),
        (
            SCENARIO,
            "elevation_mm: 3,",
            "elevation_mm: 30,",
            "    probe_knock: {elevation_mm: 30, duration_s: 0.1}",
        ),
        (SCENARIO, "target_depth_mm: 62", "target_depth_mm: 145", "  target_depth_mm: 145"),
        (SCENARIO, "kuka_kr6_r900/robot", "kuka/robot", "robot: ../robots/kuka/robot.yaml"),
        (
            SCENARIO,
            "uniform: [36, 44]",
            "uniform: [36, 95]",
            "  - {key: insertion.angle_deg, uniform: [36, 95]}",
        ),
        (ARM, "urdf: robot.urdf", "urdf: missing.urdf", "urdf: missing.urdf"),
        (
            URDF,
            "<child link=\"link_5\"/>",
            "<child link=\"link_9\"/>",
            "  <joint name=\"joint_a5\" type=\"revolute\">",
        ),
        (PHANTOM, "[23, 1, -16]", "[23, 1, -4]", "    centre_mm: [23, 1, -4]"),
    ] {
        let dir = common::sandbox();
        spoil(dir.path(), &case(file, from, to, &[]));
        let error = load(&dir.path().join(SCENARIO), &LoadOptions::default()).unwrap_err();
        let text = std::fs::read_to_string(dir.path().join(file)).unwrap();
        let line = text.lines().position(|line| line == line_holds).unwrap() + 1;
        assert_eq!(error.path(), dir.path().join(file), "{error}");
        assert_eq!(error.line(), Some(line), "{error}");
        assert!(error.to_string().contains(&format!("{file}:{line}:")), "{error}");
        let shown = error.render();
        assert!(shown.contains(line_holds.trim()), "{shown}");
        assert!(shown.contains("here") && shown.contains('─'), "{shown}");
    }
}

#[test]
fn files_that_are_none_are_told_in_one_message() {
    let dir = common::sandbox();
    let path = dir.path().join("scenarios/odd.yaml");
    let says = |content: &[u8]| {
        std::fs::write(&path, content).unwrap();
        let error = load(&path, &LoadOptions::default()).unwrap_err();
        assert_eq!(error.path(), path);
        one_line(&error)
    };
    assert!(says(b"").contains("empty"));
    assert!(says(b" \n\n").contains("empty"));
    assert!(says(b"# only\n# words\n").contains("comments"));
    assert!(says(b"\x89PNG\r\n\x1a\n\0\0").contains("byte 0 (0x89) is not UTF-8"));
    assert!(says(b"seed: 1\0").contains("byte 7 is 0"));
    assert!(says(b"just a sentence\n").contains("odd.yaml"));
    assert!(says(b"- 1\n- 2\n").contains("odd.yaml"));
    assert!(says(b"---\n").contains("odd.yaml"));
    assert!(says(b"a: &a [*a]\n").contains("odd.yaml"));
    assert!(says("x: [".repeat(100_000).as_bytes()).contains("odd.yaml"));
    let missing = load(&dir.path().join("scenarios/none.yaml"), &LoadOptions::default()).unwrap_err();
    assert!(one_line(&missing).contains("none.yaml: there is no such file"));
    let folder = load(&dir.path().join("scenarios"), &LoadOptions::default()).unwrap_err();
    assert!(one_line(&folder).contains("is not a file"));
}

#[test]
fn bad_overrides_are_told_with_their_origin() {
    let path = common::root().join(SCENARIO);
    for (set, says) in [
        ("servo.elevation_gain=-1", &["servo.elevation_gain = -1", "at least 0", "from --set"][..]),
        ("servo.elevatoin_gain=1", &["servo.elevatoin_gain", "unknown field", "from --set"]),
        ("servo.slide_gain=51", &["servo.slide_gain = 51", "at most 50", "from --set"]),
        ("servo.along_gain=-1", &["servo.along_gain = -1", "at least 0", "from --set"]),
        ("servo.along_walk_mm=3", &["servo.along_walk_mm = 3", "at most 2", "from --set"]),
        ("servo.tip_size_mm=11", &["servo.tip_size_mm = 11", "at most 10", "from --set"]),
        ("servo.level_noise=0", &["servo.level_noise = 0", "at least 0.5", "from --set"]),
        ("servo.lead_ms=2000", &["servo.lead_ms = 2000", "at most 1000", "from --set"]),
        ("servo.arrived_mm=6", &["servo.arrived_mm = 6", "at most 5", "from --set"]),
        ("servo.depth_margin_mm=60", &["servo.depth_margin_mm = 60", "at most 50", "from --set"]),
        ("servo.search=guess", &["servo.search = \"guess\"", "elevation_then_yaw", "spiral", "from --set"]),
        ("servo.look_s=-1", &["servo.look_s = -1", "at least 0", "from --set"]),
        ("servo.confirm_s=0", &["servo.confirm_s = 0", "at least 0.04", "from --set"]),
        ("servo.crest_levels=0", &["servo.crest_levels = 0", "at least 1", "from --set"]),
        ("servo.candidate_reach_mm=101", &["servo.candidate_reach_mm = 101", "at most 100", "from --set"]),
        ("servo.max_jog_mm=0.5", &["servo.max_jog_mm = 0.5", "must be 0, or at least 1", "from --set"]),
        (
            "servo.max_search_force_n=9",
            &["servo.max_search_force_n = 9", "max_contact_force_n = 8", "from --set"],
        ),
        ("insertion.angle_deg=steep", &["insertion.angle_deg = \"steep\"", "from --set"]),
        ("tracker.template_px=20.5", &["tracker.template_px = 20.5", "from --set"]),
        ("tracker.blur_sigma_px=9", &["tracker.blur_sigma_px = 9", "at most 8", "from --set"]),
        (
            "tracker.weight_sigma_px=0.5",
            &["tracker.weight_sigma_px = 0.5", "must be 0, or at least 1", "from --set"],
        ),
        ("tracker.pyramid_levels=4", &["tracker.pyramid_levels = 4", "at most 3", "from --set"]),
        ("tracker.guess=lucky", &["tracker.guess = \"lucky\"", "constant_velocity", "kalman", "from --set"]),
        ("tracker.init=hover", &["tracker.init = \"hover\"", "click", "localize", "from --set"]),
        ("tracker.method=magic", &["tracker.method = \"magic\"", "template", "baseline", "from --set"]),
        ("insertion.angle_deg=.nan", &["insertion.angle_deg = NaN", "finite", "from --set"]),
        ("disturbances.0.probe_knock.elevation_mm=25", &["elevation_mm = 25", "at most 20", "from --set"]),
        ("disturbances.3.at_s=1", &["--set disturbances.3.at_s=1", "index below 1"]),
        ("seed.x=1", &["--set seed.x=1", "inside the value 0"]),
        ("servo..feed_mm_s=1", &["part of the key is empty"]),
        ("servo.feed_mm_s", &["must be key=value"]),
        ("servo.feed_mm_s=", &["value is empty"]),
        ("robot=../robots/none.yaml", &["robot = \"../robots/none.yaml\"", "no such file", "from --set"]),
        ("expect.beauty.min=1", &["expect.beauty", "no metric", "from --set"]),
        ("insertion.target_depth_mm=145", &["at most 140", "from --set"]),
    ] {
        let options = LoadOptions { set: vec![set.to_owned()], ..LoadOptions::default() };
        let error = load(&path, &options).unwrap_err();
        let message = one_line(&error);
        for part in says {
            assert!(message.contains(part), "--set {set}: {message} lacks {part:?}");
        }
        assert!(message.contains("lateral_recovery.yaml"), "{message}");
    }
}

/// What looks for a line finds none in a transverse view.
#[test]
fn a_needle_across_the_picture_is_not_localised() {
    let path = common::root().join("scenarios/transverse_plain.yaml");
    for (set, says) in [
        ("tracker.init=localize", "tracker.init = \"localize\": must be \"click\": it looks for a line"),
        (
            "tracker.method=baseline",
            "tracker.method = \"baseline\": must be \"template\": it looks for a line",
        ),
    ] {
        let options = LoadOptions { set: vec![set.to_owned()], ..LoadOptions::default() };
        let message = one_line(&load(&path, &options).unwrap_err());
        assert!(message.contains(says), "{message}");
    }
}

/// An override that makes another value of the file wrong: the file's line is shown, and the override beside it.
#[test]
fn what_an_override_spoils_is_told_together_with_it() {
    let options = LoadOptions { set: vec!["insertion.entry_mm.0=80".to_owned()], ..LoadOptions::default() };
    let error = load(&common::root().join(SCENARIO), &options).unwrap_err();
    assert_eq!(error.key(), "insertion.target_depth_mm");
    assert!(error.line().is_some());
    assert!(error.render().contains("insertion.entry_mm.0 = 80 from --set"), "{}", error.render());
}

/// Cut and flipped files: an error or a scenario, never a panic.
#[test]
fn damaged_files_never_panic() {
    for file in [SCENARIO, ARM, URDF, PHANTOM] {
        let dir = common::sandbox();
        let path = dir.path().join(file);
        let sound = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for step in 0..80 {
            let mut bytes = sound.clone();
            let at = (step * 7919) % bytes.len();
            if step % 2 == 0 {
                bytes.truncate(at);
            } else {
                bytes[at] ^= 1 << (step % 7);
            }
            std::fs::write(&path, &bytes).unwrap();
            if let Err(error) = load(&dir.path().join(SCENARIO), &LoadOptions::default()) {
                one_line(&error);
                refused += 1;
            }
        }
        assert!(refused > 25, "{file}: only {refused} of 80 damaged files were refused");
    }
}

#[test]
fn an_error_fits_the_apps_reports() {
    fn fits<T: miette::Diagnostic + Send + Sync + 'static>() {}
    fits::<LoadError>();
    let error = load(Path::new("none.yaml"), &LoadOptions::default()).unwrap_err();
    let report = miette::Report::new(error);
    assert_eq!(report.to_string(), "none.yaml: there is no such file");
}
