//! The rules between crates, read from `cargo metadata`.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

mod common;

/// Package name → names of all packages it needs to run, directly or not.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked"])
        .current_dir(common::root())
        .output()
        .expect("cargo metadata");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let text = |v: &serde_json::Value| v.as_str().expect("string").to_owned();
    let names: BTreeMap<String, String> = metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .map(|p| (text(&p["id"]), text(&p["name"])))
        .collect();
    let mut direct: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for node in metadata["resolve"]["nodes"].as_array().expect("nodes") {
        let normal = node["deps"]
            .as_array()
            .expect("deps")
            .iter()
            .filter(|d| d["dep_kinds"].as_array().expect("kinds").iter().any(|k| k["kind"].is_null()));
        direct.insert(text(&node["id"]), normal.map(|d| text(&d["pkg"])).collect());
    }
    let mut all = BTreeMap::new();
    for (id, name) in &names {
        if !name.starts_with("sonoloop") {
            continue;
        }
        let mut seen = BTreeSet::new();
        let mut open = direct[id].clone();
        while let Some(next) = open.pop() {
            if seen.insert(names[&next].clone()) {
                open.extend(direct[&next].iter().cloned());
            }
        }
        all.insert(name.clone(), seen);
    }
    all
}

#[test]
fn tracker_and_servo_never_reach_the_simulation() {
    let all = dependencies();
    for package in ["sonoloop-tracker", "sonoloop-servo"] {
        for forbidden in ["sonoloop-world", "sonoloop-scenario", "sonoloop-ultrasound", "rapier3d", "parry3d"]
        {
            assert!(!all[package].contains(forbidden), "{package} depends on {forbidden}");
        }
    }
}

#[test]
fn only_wire_and_what_uses_it_depends_on_iceoryx2() {
    for (package, needs) in dependencies() {
        let may = ["sonoloop-wire", "sonoloop-viewer", "sonoloop"].contains(&package.as_str());
        assert_eq!(needs.contains("iceoryx2"), may, "{package}");
    }
}

#[test]
fn the_world_knows_no_images_and_the_renderer_no_world() {
    let all = dependencies();
    assert!(!all["sonoloop-world"].contains("sonoloop-ultrasound"));
    assert!(!all["sonoloop-ultrasound"].contains("sonoloop-world"));
    assert!(!all["sonoloop-scenario"].contains("sonoloop-world"));
    for simulation in ["sonoloop-world", "sonoloop-scenario", "sonoloop-ultrasound", "sonoloop-tracker"] {
        assert!(
            !all["sonoloop-viewer"].contains(simulation),
            "the page shows what it is given: {simulation}"
        );
    }
}
