//! The same bits whatever the platform's mathematics library chooses for the CPU at hand.
//!
//! glibc picks its sine, arc cosine and so on by CPU. Two libraries below the world call them (analytic
//! inverse kinematics, trajectory planner); what they return is rounded before it lives on. Here a child
//! process runs with the variants for old CPUs, where the C library offers that switch.

#[path = "../src/fixture.rs"]
mod fixture;

use std::process::Command as Process;

use sonoloop_scenario::{Disturbance, DisturbanceKind};
use sonoloop_types::{Command, Estimate, Pose, Reason, TrackState};
use sonoloop_world::World;

/// Folds a value into a running FNV-1a hash.
fn fold(hash: u64, value: f64) -> u64 {
    value
        .to_bits()
        .to_le_bytes()
        .iter()
        .fold(hash, |h, byte| (h ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Hash of everything that moves, over six seconds of following, sweeping, slipping and lifting.
fn run(seed: u64) -> u64 {
    let mut scenario = fixture::scenario();
    scenario.seed = seed;
    scenario.calibration.robot_sigma_m = 1e-3;
    scenario.calibration.robot_sigma_rad = 2e-3;
    scenario.calibration.encoder_sigma_rad = 1e-4;
    scenario.calibration.encoder_sigma_m = 5e-5;
    let kick = Pose::from_parts(
        nalgebra::Translation3::new(0.0, 2e-3, 0.0),
        nalgebra::UnitQuaternion::from_euler_angles(0.01, 0.02, 0.03),
    );
    scenario.disturbances = vec![
        Disturbance {
            tick: 1500,
            kind: DisturbanceKind::ProbeKnock { probe_from_slipped: kick, duration_ticks: 80 },
        },
        Disturbance { tick: 3000, kind: DisturbanceKind::LiftOff { height_m: 5e-3, duration_ticks: 700 } },
    ];
    let mut world = World::new(&scenario).unwrap();
    let start = world.acquisition(0).base_from_probe;
    let mut hash = 0xcbf2_9ce4_8422_2325;
    for tick in 0..6000u64 {
        if tick.is_multiple_of(40) {
            let image = world.acquisition(tick / 40);
            world.note_published(&image);
            // A triangle wave, so that this test calls no sine itself.
            let wave = |period: u64| (tick % period).abs_diff(period / 2) as f64 / period as f64 - 0.25;
            let turn = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3 * wave(1700));
            let shift = nalgebra::Translation3::new(0.03 * wave(2300), 0.02 * wave(1100), 0.0);
            world.submit(&Command {
                answers: image.sequence,
                estimate: Estimate::bare(TrackState::Tracking, Reason::Ok, None),
                target_base_from_probe: Some(start * Pose::from_parts(shift, turn)),
                feed_m_s: 0.005,
                compute_us: 0.0,
            });
        }
        world.step();
        let truth = world.truth();
        hash =
            world.acquisition(tick / 40).base_from_probe.translation.vector.iter().copied().fold(hash, fold);
        hash = world.joint_angles_rad().into_iter().fold(hash, fold);
        hash = truth.tip_in_probe.iter().copied().fold(hash, fold);
        hash = [truth.contact_force_n, truth.depth_m, truth.plane_to_tip_m].into_iter().fold(hash, fold);
    }
    hash
}

/// Not a test of its own: what the child processes run.
#[test]
#[ignore = "run by the test below"]
fn child_prints_its_hash() {
    for seed in 0..4 {
        println!("\nstate {seed} {:016x}", run(seed));
    }
}

#[test]
fn no_bit_depends_on_the_mathematics_library_of_the_cpu() {
    let child = |tunables: &str| {
        let output = Process::new(std::env::current_exe().unwrap())
            .args(["--exact", "child_prints_its_hash", "--ignored", "--nocapture"])
            .env("GLIBC_TUNABLES", tunables)
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let hashes: Vec<String> =
            text.lines().filter_map(|l| l.strip_prefix("state ")).map(str::to_owned).collect();
        assert_eq!(hashes.len(), 4, "{text}");
        hashes
    };
    let without_fma = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable,-AVX,-AVX_Usable";
    assert_eq!(child(""), child(without_fma));
}
