//! The command line: help, JSON, exit codes, and bad input of every kind.

use std::path::{Path, PathBuf};
use std::process::Stdio;

mod common;
use common::{file, finish, program, root, sonoloop, start};

/// A copy of the repository's data files that a test may spoil.
struct Box {
    folder: tempfile::TempDir,
}

impl Box {
    fn new() -> Self {
        fn copy(from: &Path, to: &Path) {
            std::fs::create_dir_all(to).expect("folder");
            for entry in std::fs::read_dir(from).expect("folder") {
                let path = entry.expect("entry").path();
                let target = to.join(path.file_name().expect("name"));
                if path.is_dir() {
                    copy(&path, &target);
                } else {
                    std::fs::copy(&path, &target).expect("copy");
                }
            }
        }
        let folder = tempfile::tempdir().expect("temporary folder");
        for name in ["scenarios", "robots", "phantoms"] {
            copy(&root().join(name), &folder.path().join(name));
        }
        Self { folder }
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    /// Replaces the first `from` in a file; the file must hold it.
    fn edit(&self, relative: &str, from: &str, to: &str) {
        let path = self.path(relative);
        let text = std::fs::read_to_string(&path).expect("text");
        assert!(text.contains(from), "{relative} holds no {from:?}");
        std::fs::write(path, text.replacen(from, to, 1)).expect("write");
    }

    /// Runs the plain lateral scenario and expects refusal with all of `parts` in the message.
    fn refused(&self, parts: &[&str]) {
        self.refused_with(&[], parts);
    }

    fn refused_with(&self, arguments: &[&str], parts: &[&str]) {
        let out = self.path("out");
        let mut command = program();
        command
            .arg("run")
            .arg(self.path("scenarios/lateral_plain.yaml"))
            .arg("--out")
            .arg(&out)
            .args(arguments);
        let finished = finish(start(command));
        assert_eq!(finished.code(), 2, "{}\n{}", finished.stdout, finished.stderr);
        assert_eq!(finished.stdout, "", "an error goes to stderr");
        for part in parts {
            assert!(finished.stderr.contains(part), "no {part:?} in:\n{}", finished.stderr);
        }
        assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
        assert!(!out.exists(), "nothing may be written");
    }
}

const SCENARIO: &str = "scenarios/lateral_plain.yaml";
const URDF: &str = "robots/kuka_kr6_r900/robot.urdf";

/// The path is relative to the scenario, the description's to the robot's file; the meshes are nowhere.
#[test]
fn a_users_own_arm_with_missing_meshes_carries_a_scenario() {
    let files = Box::new();
    for link in ["forearm_link", "upper_arm_link", "wrist_1_link"] {
        let named = format!("<link name=\"{link}\">");
        let mesh =
            "<collision><geometry><mesh filename=\"package://nowhere/part.dae\"/></geometry></collision>";
        files.edit("robots/ur5e/robot.urdf", &named, &format!("{named}{mesh}"));
    }
    std::fs::rename(files.path("robots/ur5e"), files.path("mine")).expect("another place");
    let mut command = program();
    command.arg("run").arg(files.path("scenarios/lateral_plain.yaml"));
    command.args(["--set", "robot=../mine/robot.yaml", "--in-process", "--json"]);
    let finished = finish(start(command));
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    assert_eq!(finished.json()["verdict"], "pass");
}

#[test]
fn an_unknown_key_is_named_with_file_and_line() {
    let files = Box::new();
    files.edit(SCENARIO, "insertion:\n", "insertion:\n  speed_of_light: 3\n");
    files.refused(&["lateral_plain.yaml", "speed_of_light"]);
}

#[test]
fn a_wrong_unit_is_an_unknown_key() {
    let files = Box::new();
    files.edit(SCENARIO, "angle_deg:", "angle_rad:");
    files.refused(&["lateral_plain.yaml", "angle_rad"]);
}

#[test]
fn a_value_out_of_range_is_named_with_its_bound() {
    let files = Box::new();
    files.edit(SCENARIO, "duration_s:", "duration_s: -4 #");
    files.refused(&["lateral_plain.yaml", "duration_s", "-4"]);
}

#[test]
fn a_missing_robot_is_named() {
    let files = Box::new();
    files.edit(SCENARIO, "kuka_kr6_r900/robot.yaml", "nobody/robot.yaml");
    files.refused(&["nobody/robot.yaml"]);
}

#[test]
fn an_arm_with_five_joints_is_refused() {
    let files = Box::new();
    let text = std::fs::read_to_string(files.path(URDF)).expect("urdf");
    let joint = text.find("type=\"revolute\"").expect("a revolute joint");
    let mut fewer = text.clone();
    fewer.replace_range(joint..joint + "type=\"revolute\"".len(), "type=\"fixed\"");
    std::fs::write(files.path(URDF), fewer).expect("write");
    files.refused(&["robot.urdf", "5", "6"]);
}

#[test]
fn a_dangling_joint_is_refused() {
    let files = Box::new();
    let text = std::fs::read_to_string(files.path(URDF)).expect("urdf");
    let at = text.find("<child link=\"").expect("a child") + "<child link=\"".len();
    let end = at + text[at..].find('"').expect("closing quote");
    let mut dangling = text.clone();
    dangling.replace_range(at..end, "nowhere");
    std::fs::write(files.path(URDF), dangling).expect("write");
    files.refused(&["robot.urdf", "nowhere"]);
}

#[test]
fn a_phantom_of_negative_size_is_refused_in_its_own_file() {
    let files = Box::new();
    let phantom = "phantoms/gelatin_agar.yaml";
    files.edit(phantom, "size_mm: [200", "size_mm: [-200");
    files.refused(&["gelatin_agar.yaml", "size_mm", "-200"]);
}

#[test]
fn a_target_that_the_arm_cannot_reach_is_refused() {
    let files = Box::new();
    files.edit("robots/kuka_kr6_r900/robot.yaml", "xyz_mm: [", "xyz_mm: [3000, 0, 0] #");
    files.refused(&["reach"]);
}

#[test]
fn empty_and_binary_files_are_refused() {
    let files = Box::new();
    std::fs::write(files.path(SCENARIO), "").expect("write");
    files.refused(&["lateral_plain.yaml", "empty"]);
    std::fs::write(files.path(SCENARIO), [0x7f, b'E', b'L', b'F', 0, 0xff, 0xfe, 0]).expect("write");
    files.refused(&["lateral_plain.yaml"]);
    std::fs::remove_file(files.path(SCENARIO)).expect("remove");
    files.refused(&["lateral_plain.yaml"]);
}

#[test]
fn an_override_of_a_key_that_does_not_exist_is_refused() {
    let files = Box::new();
    files.refused_with(&["--set", "servo.no_such_gain=1"], &["no_such_gain", "--set"]);
    files.refused_with(&["--set", "duration_s=soon"], &["duration_s", "soon"]);
    files.refused_with(&["--set", "nonsense"], &["nonsense"]);
}

#[test]
fn a_truncated_recording_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let sequence = folder.path().join("cut.mha");
    let header = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
                  CompressedData = False\nDimSize = 64 48 3\nUltrasoundImageOrientation = MF\n\
                  ElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(std::iter::repeat_n(7u8, 64 * 48 * 2));
    for (contents, part) in [(bytes, "cut.mha"), (Vec::new(), "empty"), (vec![0xff; 100], "cut.mha")] {
        std::fs::write(&sequence, contents).expect("write");
        let out = folder.path().join("out");
        let mut command = program();
        command.arg("track").arg(&sequence).args(["--init", "30,20", "--out"]).arg(&out);
        let finished = finish(start(command));
        assert_eq!(finished.code(), 2, "{}", finished.stderr);
        assert!(finished.stderr.contains(part), "{}", finished.stderr);
        assert!(!out.exists(), "nothing may be written");
    }
}

#[test]
fn help_shows_examples_and_wrong_usage_exits_2() {
    let help = sonoloop(&["--help"]);
    assert_eq!(help.code(), 0);
    assert!(help.stdout.contains("Examples:") && help.stdout.contains("Exit codes"));
    assert_eq!(sonoloop(&["run"]).code(), 2);
    assert_eq!(sonoloop(&["fly"]).code(), 2);
    let track = sonoloop(&["track"]);
    assert_eq!(track.code(), 2);
    assert!(track.stderr.contains("SEQUENCE --init U,V"), "{}", track.stderr);
    assert_eq!(sonoloop(&["render", "phantoms/gelatin_agar.yaml", "--out", "no/such/folder.png"]).code(), 2);
    assert_eq!(
        sonoloop(&["suite", SCENARIO, "--set", "seed=18446744073709551615", "--seeds", "2"]).code(),
        2
    );
}

#[test]
fn json_is_all_that_stdout_holds_and_a_failed_expectation_exits_1() {
    let passed = sonoloop(&["run", SCENARIO, "--json"]);
    assert_eq!(passed.code(), 0, "{}", passed.stderr);
    let summary = passed.json();
    assert_eq!(summary["verdict"], "pass");
    for key in ["scenario", "seed", "version", "expectations", "metrics", "timing"] {
        assert!(!summary[key].is_null(), "summary has no {key}");
    }
    let failed = sonoloop(&["run", SCENARIO, "--json", "--in-process", "--set", "duration_s=3"]);
    assert_eq!(failed.code(), 1, "{}", failed.stderr);
    assert_eq!(failed.json()["verdict"], "fail");
}

/// Nothing here depends on how fast the machine is: only that the clock, not the tracker, paces the run, and says so.
#[test]
fn a_run_in_real_time_waits_for_no_tracker_and_tells_how_stale_its_commands_were() {
    let short = ["--json", "--realtime", "--set", "duration_s=1"];
    let run = |extra: &[&str]| sonoloop(&[&["run", SCENARIO][..], &short, extra].concat());
    for tracker in [&[][..], &["--tracker", "none"]] {
        let finished = run(tracker);
        assert_eq!(finished.code(), 1, "{}", finished.stderr);
        let summary = finished.json();
        assert_eq!((&summary["realtime"], &summary["end"]), (&true.into(), &"time_over".into()));
        assert_eq!(summary["metrics"]["images"], 25);
        let timing = &summary["timing"];
        // The last tick is due 0.999 s after the first one; how long the run took is counted from a moment later.
        assert!(timing["wall_s"].as_f64().is_some_and(|wall_s| wall_s >= 0.9), "{timing}");
        for key in ["staleness_ms_p50", "staleness_ms_max", "images_without_answer", "behind_ms_max"] {
            assert!(timing[key].is_number(), "{key}: {timing}");
        }
        if tracker.last() == Some(&"none") {
            assert_eq!(
                (&timing["images_without_answer"], &timing["staleness_ms_max"]),
                (&25.into(), &960.0.into())
            );
        }
    }
    assert_eq!(run(&["--in-process"]).code(), 2);
}

#[test]
fn check_and_list_know_every_committed_file() {
    let checked = sonoloop(&["check", "scenarios"]);
    assert_eq!(checked.code(), 0, "{}", checked.stderr);
    let listed = sonoloop(&["list"]);
    assert_eq!(listed.code(), 0);
    for file in common::scenarios() {
        let name = file.file_name().expect("name").to_str().expect("text");
        assert!(checked.stdout.contains(name), "check is silent on {name}");
        assert!(listed.stdout.contains(name), "list is silent on {name}");
    }
    let checked = sonoloop(&["check", "phantoms", "robots"]);
    assert_eq!(checked.code(), 0, "{}", checked.stderr);
    for folder in ["phantoms", "robots/probes", "robots/needles"] {
        for entry in std::fs::read_dir(root().join(folder)).expect("folder") {
            let name = entry.expect("entry").file_name().into_string().expect("text");
            assert!(checked.stdout.contains(&format!("{name}: ok (")), "check is silent on {name}");
            assert!(listed.stdout.contains(&name), "list is silent on {name}");
        }
    }
}

#[test]
fn check_names_what_is_wrong_in_a_phantom_and_in_its_materials() {
    let files = Box::new();
    for (file, from, to, part) in [
        ("phantoms/water.yaml", "background: water", "background: wine", "wine"),
        ("phantoms/materials.yaml", "sound_speed_m_s: 343", "sound_speed_m_s: 3", "sound_speed_m_s = 3"),
    ] {
        files.edit(file, from, to);
        let path = files.path(file);
        let finished = sonoloop(&["check", path.to_str().expect("path")]);
        assert_eq!(finished.code(), 2, "{}", finished.stderr);
        assert!(finished.stderr.contains(part), "{}", finished.stderr);
    }
}

#[test]
fn render_writes_a_picture_with_a_needle_in_it() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let picture = |name: &str, extra: &[&str]| {
        let out = folder.path().join(name);
        let mut command = program();
        command.args(["render", "phantoms/gelatin_agar.yaml", "--out"]).arg(&out).args(extra);
        let finished = finish(start(command));
        assert_eq!(finished.code(), 0, "{}", finished.stderr);
        image::open(&out).expect("a picture").to_luma8()
    };
    let plain = picture("plain.png", &[]);
    let needle = picture("needle.png", &["--needle-angle-deg", "30", "--tip-depth-mm", "25"]);
    assert_eq!(plain.dimensions(), (640, 480));
    let around_tip = |image: &image::GrayImage| {
        (245..256)
            .flat_map(|v| (312..328).map(move |u| (u, v)))
            .map(|(u, v)| u32::from(image.get_pixel(u, v)[0]))
            .max()
    };
    assert!(around_tip(&needle) > around_tip(&plain), "the tip is drawn where it was asked for");
}

#[test]
fn a_picture_that_cannot_be_made_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let jpeg = folder.path().join("picture.jpg");
    let jpeg = jpeg.to_str().expect("path");
    let phantom = file("phantoms/agar.yaml");
    let phantom = phantom.to_str().expect("path");
    for (arguments, part) in [
        (&["render", phantom, "--out", jpeg][..], "must end in .png"),
        (&["render", phantom, "--out", "picture"], "must end in .png"),
        (&["render", phantom], "robots/probes/l12_3v.yaml: there is no such file"),
        (&["render", phantom], "relative to the current folder"),
        (&["render", "nothing.yaml"], "nothing.yaml: there is no such file"),
        (&["render"], "PHANTOM"),
        (&["render", "--gallery", "atlas"], "phantoms/gelatin_agar.yaml: there is no such file"),
        (&["render", "--gallery", "atlas", "--tilt-deg", "3"], "cannot be used with"),
    ] {
        let mut command = program();
        command.current_dir(folder.path()).args(arguments);
        let finished = finish(start(command));
        assert_eq!(finished.code(), 2, "{arguments:?}: {}", finished.stderr);
        assert!(finished.stderr.contains(part), "{arguments:?}: {}", finished.stderr);
        let left = std::fs::read_dir(folder.path()).expect("folder").count();
        assert_eq!(left, 0, "{arguments:?} left something behind");
    }
}

#[test]
fn the_gallery_holds_every_picture_that_its_page_names_and_leaves_foreign_files() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let atlas = folder.path().join("deep/atlas");
    std::fs::create_dir_all(&atlas).expect("folder");
    std::fs::write(atlas.join("summary.json"), "a run's").expect("write");
    let mut command = program();
    command.args(["render", "--gallery"]).arg(&atlas);
    let finished = finish(start(command));
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    assert_eq!(finished.stdout.trim(), atlas.join("index.html").to_str().expect("path"));
    assert_eq!(std::fs::read_to_string(atlas.join("summary.json")).expect("kept"), "a run's");
    assert_eq!(std::fs::read_dir(folder.path().join("deep")).expect("folder").count(), 1);

    let page = std::fs::read_to_string(atlas.join("index.html")).expect("a page");
    assert!(!page.contains("http"), "the page is read offline");
    let named: Vec<&str> =
        page.split("src=\"").skip(1).map(|rest| rest.split('"').next().expect("a name")).collect();
    let mut pictures = Vec::new();
    for entry in std::fs::read_dir(&atlas).expect("folder") {
        let path = entry.expect("entry").path();
        if path.extension().is_none_or(|extension| extension != "png") {
            continue;
        }
        let name = path.file_name().expect("name").to_str().expect("text").to_owned();
        let picture = image::open(&path).expect("a picture").to_luma8();
        assert_eq!(picture.dimensions(), (640, 480), "{name}");
        let lit = picture.pixels().filter(|pixel| pixel[0] > 20).count();
        assert!(lit > 640 * 480 / 100, "{name} is black");
        assert_eq!(named.iter().filter(|n| **n == name).count(), 1, "index.html and {name}");
        // The small atlas of the documentation shows the same.
        let small = root().join("docs/atlas").join(name.replace(".png", ".jpg"));
        assert!(small.is_file(), "no {}: see docs/atlas/README.md", small.display());
        pictures.push((name, picture));
    }
    assert_eq!(named.len(), pictures.len());
    for phantom in std::fs::read_dir(root().join("phantoms")).expect("folder") {
        let name = phantom.expect("entry").file_name().into_string().expect("text");
        let name = format!("phantom_{}", name.replace(".yaml", ".png"));
        assert_eq!(pictures.iter().any(|(n, _)| *n == name), name != "phantom_materials.png", "{name}");
    }
    for (index, (a, picture)) in pictures.iter().enumerate() {
        for (b, other) in &pictures[..index] {
            // Liquids without a scatterer differ in sound speed and a trace of attenuation, which no pixel shows.
            let liquids = [a, b].iter().all(|name| name.contains("water"));
            assert!(liquids || picture != other, "{a} is {b}");
        }
    }
}

#[test]
fn a_suite_reports_each_run_and_writes_junit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let junit = folder.path().join("junit.xml");
    let mut command = program();
    command.args(["suite", SCENARIO, "--seeds", "2", "--json", "--junit"]).arg(&junit);
    let finished = finish(start(command));
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    let report = finished.json();
    assert_eq!(report["runs"].as_array().expect("runs").len(), 2);
    assert_eq!(report["rates"][0]["passed"], 2);
    assert_eq!(
        (&report["groups"][0]["group"], &report["groups"][0]["runs"]),
        (&"scenarios".into(), &2.into())
    );
    assert_eq!(report["all"]["passed"], 2);
    assert!(report["rates"][0]["metrics"]["coverage"]["median"].as_f64() >= Some(0.9), "{}", report["rates"]);
    let xml = std::fs::read_to_string(junit).expect("junit");
    assert!(xml.contains("<testsuite") && xml.matches("<testcase").count() == 2);
}

#[test]
fn a_recorded_run_can_be_tracked_alone() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    let sequence = out.join("sequence.mha");
    let mut command = program();
    command.args(["run", SCENARIO, "--in-process", "--json", "--set", "duration_s=1", "--record", "--out"]);
    command.arg(&out);
    let finished = finish(start(command));
    assert!(finished.code() < 2, "{}", finished.stderr);

    // Each picture is the one of its row, and carries that row's labels.
    let csv = std::fs::read_to_string(out.join("images.csv")).expect("images.csv");
    let mut lines = csv.lines();
    let columns: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let cell = |row: usize, name: &str| {
        rows[row][columns.iter().position(|column| *column == name).unwrap_or_else(|| panic!("no {name}"))]
    };
    assert_eq!(rows.len(), 25, "25 images per second");
    let mut recorded = sonoloop::sequence::Sequence::open(&sequence).expect("a sequence");
    assert_eq!(recorded.image_count(), rows.len());
    for row in 0..rows.len() {
        let image = recorded.next_image().expect("whole").expect("an image");
        assert_eq!(format!("{:016x}", sonoloop::record::image_hash(&image)), cell(row, "image_hash"));
        let fields = recorded.fields().expect("fields");
        let tip = format!("{} {}", cell(row, "tip_u_px"), cell(row, "tip_v_px"));
        assert_eq!(fields.text(row, "TrueTipPx"), Some(tip.as_str()));
        assert_eq!(fields.text(row, "TrueTipVisible"), Some(cell(row, "visible")));
        assert_eq!(fields.timestamp_s(row), Some(0.04 * row as f64));
        for name in ["ProbeToBaseTransform", "TrueProbeToWorldTransform"] {
            let matrix = fields.transform(row, name).unwrap_or_else(|| panic!("image {row} has no {name}"));
            assert_eq!(matrix[12..], [0.0, 0.0, 0.0, 1.0]);
            // The probe stands on the phantom, which is 200 mm long, and points down.
            if name.starts_with("True") {
                assert!(matrix[3].abs() < 100.0 && matrix[10] < -0.9, "{matrix:?}");
            }
        }
    }

    let tracked = folder.path().join("tracked");
    let init = format!("{},{}", cell(0, "tip_u_px"), cell(0, "tip_v_px"));
    let mut command = program();
    command.arg("track").arg(&sequence).args(["--init", &init, "--out"]).arg(&tracked);
    let finished = finish(start(command));
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    let table = std::fs::read_to_string(tracked.join("track.csv")).expect("track.csv");
    assert_eq!(table.lines().count(), rows.len() + 1, "one row per image");

    let finished = sonoloop(&["run", SCENARIO, "--record"]);
    assert_eq!(finished.code(), 2, "--record needs --out: {}", finished.stderr);
}

#[test]
fn a_reader_that_leaves_early_is_no_fault() {
    let mut list = program();
    let mut list = list.arg("list").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    drop(list.stdout.take());
    let finished = list.wait_with_output().expect("ends");
    assert_eq!(finished.status.code(), Some(0), "{}", String::from_utf8_lossy(&finished.stderr));
}

#[test]
fn a_file_where_a_folder_for_results_should_be_is_refused_before_anything_else() {
    // Nothing else that is given exists: whoever looked at it first would say so.
    for (arguments, option) in [
        (&["run", "nothing.yaml", "--out"][..], "--out"),
        (&["sim", "nothing.yaml", "--out"], "--out"),
        (&["suite", "nothing.yaml", "--junit"], "--junit"),
        (&["track", "nothing.mha", "--init", "30,20", "--out"], "--out"),
        (&["render", "nothing.yaml", "--gallery"], "--gallery"),
    ] {
        for place in ["Cargo.toml", "Cargo.toml/deep/below"] {
            // The report is a file itself, in the folder that is asked for.
            let place = if option == "--junit" { format!("{place}/junit.xml") } else { place.to_owned() };
            let finished = sonoloop(&[arguments, &[place.as_str()]].concat());
            assert_eq!(finished.code(), 2, "{arguments:?}: {}", finished.stderr);
            assert_eq!(finished.stderr, format!("error: {option}: Cargo.toml is a file, not a folder\n"));
        }
    }
    let finished = sonoloop(&["suite", "nothing.yaml", "--junit", "scenarios"]);
    assert_eq!(finished.code(), 2);
    assert_eq!(finished.stderr, "error: --junit: scenarios is a folder\n");
}
