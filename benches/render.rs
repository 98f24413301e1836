//! One image of 640×480 with needle, attenuation, noise and compensation: `cargo bench -p sonoloop-benches`.

use divan::Bencher;
use rayon::ThreadPoolBuilder;
use sonoloop_benches::{Scene, pose};
use sonoloop_types::{Drag, Point, Precision, Vector};

fn main() {
    divan::main();
    // Where there is such a file: the most memory that any case took.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    if let Some(peak) = status.lines().find_map(|line| line.strip_prefix("VmHWM:")) {
        println!("peak memory {}", peak.trim());
    }
}

/// Files read, renderer made, first image drawn.
#[divan::bench(sample_count = 20)]
fn start() -> u8 {
    Scene::new(Some(40.0), Precision::Usual).render(pose([0.0, 0.0], 0.0, [0.0, 0.0])).pixels[0]
}

/// Yaw, tilt out of plane, tilt in plane.
const POSES: [(&str, [f64; 3]); 4] = [
    ("upright", [0.0, 0.0, 0.0]),
    ("yaw 30", [30.0, 0.0, 0.0]),
    ("tilt 5 / 3", [10.0, 5.0, 3.0]),
    ("tilt 30 / 30", [10.0, 30.0, 30.0]),
];

fn poses() -> impl Iterator<Item = &'static str> {
    POSES.iter().map(|(name, _)| *name)
}

fn move_probe(bencher: Bencher, threads: usize, name: &str, tilt_step_deg: f64, precision: Precision) {
    let [yaw, out_of_plane, in_plane] = POSES.iter().find(|(n, _)| *n == name).expect("a pose").1;
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let mut scene = Scene::new(Some(40.0), precision);
    let mut step = 0;
    bencher.bench_local(|| {
        step += 1;
        let (move_mm, tilt_deg) = (0.013 * f64::from(step % 64), tilt_step_deg * f64::from(step % 64));
        let tilt = [out_of_plane + tilt_deg, in_plane - tilt_deg];
        pool.install(|| scene.render(pose([move_mm, 0.7 * move_mm], yaw, tilt)).pixels[0])
    });
}

/// Every image from another place and tilt: nothing can be used again.
#[divan::bench(args = poses(), consts = [1, 2], sample_count = 60)]
fn tilting<const THREADS: usize>(bencher: Bencher, name: &str) {
    move_probe(bencher, THREADS, name, 0.01, Precision::Usual);
}

/// The probe slides over the phantom without tilting, as an arm moves it that follows a needle.
#[divan::bench(args = poses(), consts = [1, 2], sample_count = 60)]
fn sliding<const THREADS: usize>(bencher: Bencher, name: &str) {
    move_probe(bencher, THREADS, name, 0.0, Precision::Usual);
}

/// [`tilting`] in the fine mode.
#[divan::bench(args = poses(), consts = [1, 2], sample_count = 60)]
fn fine<const THREADS: usize>(bencher: Bencher, name: &str) {
    move_probe(bencher, THREADS, name, 0.01, Precision::Fine);
}

/// The probe presses by 2 mm and slides.
#[divan::bench(consts = [1, 2], sample_count = 60)]
fn pressed<const THREADS: usize>(bencher: Bencher) {
    slide_pressed(bencher, THREADS, None);
}

/// The same, and the needle's tip carries tissue along by 1.5 mm.
#[divan::bench(consts = [1, 2], sample_count = 60)]
fn dragged<const THREADS: usize>(bencher: Bencher) {
    let drag = Drag {
        centre_in_phantom: Point::new(0.0, 0.0, -25e-3),
        displacement_in_phantom: Vector::new(1.2e-3, 0.0, -0.9e-3),
        decay_m: 5e-3,
    };
    slide_pressed(bencher, THREADS, Some(drag));
}

fn slide_pressed(bencher: Bencher, threads: usize, drag: Option<Drag>) {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let mut scene = Scene::new(Some(40.0), Precision::Usual);
    (scene.press_m, scene.drag) = (2e-3, drag);
    let mut step = 0;
    bencher.bench_local(|| {
        step += 1;
        let mut pose = pose([0.013 * f64::from(step % 64), 0.0], 0.0, [0.0, 0.0]);
        pose.translation.vector.z = -scene.press_m;
        pool.install(|| scene.render(pose).pixels[0])
    });
}

/// The probe rests, pressing by so many millimetres, and the needle moves.
#[divan::bench(args = [0.0, 2.0], consts = [1, 2], sample_count = 60)]
fn needle_only<const THREADS: usize>(bencher: Bencher, press_mm: f64) {
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build().expect("threads");
    let mut scene = Scene::new(Some(40.0), Precision::Usual);
    scene.press_m = press_mm * 1e-3;
    let mut pose = pose([0.0, 0.0], 0.0, [0.0, 0.0]);
    pose.translation.vector.z = -scene.press_m;
    bencher.bench_local(|| {
        scene.move_needle(1e-7);
        pool.install(|| scene.render(pose).pixels[0])
    });
}

/// Only the electronic noise changes.
#[divan::bench(consts = [1, 2], sample_count = 60)]
fn at_rest<const THREADS: usize>(bencher: Bencher) {
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build().expect("threads");
    let mut scene = Scene::new(Some(40.0), Precision::Usual);
    bencher.bench_local(|| pool.install(|| scene.render(pose([0.0, 0.0], 0.0, [0.0, 0.0])).pixels[0]));
}
