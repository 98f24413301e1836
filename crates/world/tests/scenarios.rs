//! Every scenario that comes with the program makes a world.

use std::path::{Path, PathBuf};

use sonoloop_scenario::{LoadOptions, load};
use sonoloop_world::World;

fn yaml_files(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            yaml_files(&path, out);
        } else if path.extension().is_some_and(|extension| extension == "yaml") {
            out.push(path);
        }
    }
}

#[test]
fn every_scenario_of_the_repository_starts_with_the_tip_in_sight() {
    let mut files = Vec::new();
    yaml_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios"), &mut files);
    assert!(!files.is_empty());
    for file in files {
        for seed in 0..10 {
            let options = LoadOptions { seed: Some(seed), ..LoadOptions::default() };
            let scenario = load(&file, &options).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
            let world =
                World::new(&scenario).unwrap_or_else(|e| panic!("{}, seed {seed}: {e}", file.display()));
            let truth = world.truth();
            assert!(truth.visible, "{}, seed {seed}: {truth:?}", file.display());
            assert!(truth.min_joint_margin_rad > 0.1, "{}, seed {seed}", file.display());
        }
    }
}
