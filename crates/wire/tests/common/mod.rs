//! What the tests of the wire share: a set-up, an acquisition, a domain of their own and a watchdog.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::{
    path::PathBuf,
    process::{Child, Command as Process, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use sonoloop_types::{
    Acquisition, ArmStatus, Command, CommandReceipt, Estimate, Image, ImageGeometry, Limits, Point, Pose,
    Profile, Reason, Refusal, ServoSettings, Setup, TrackState, TrackerSettings, Vector, View,
};
use sonoloop_wire::{Domain, TrackerEndpoint};

/// Long enough for a loaded machine; nothing waits this long when all is well.
pub const PATIENCE: Duration = Duration::from_secs(60);

pub fn setup(run_id: u64) -> Setup {
    Setup {
        protocol: 1,
        run_id,
        tick_rate_hz: 1000,
        image_period_ticks: 40,
        view: View::Lateral,
        geometry: ImageGeometry::default(),
        slice_thickness_m: vec![[0.01, 0.003], [0.04, 0.0041]],
        flange_from_probe: pose(0.1),
        entry_in_base: Point::new(0.5, 0.1, 0.2),
        needle_axis_in_base: Vector::new(0.6, 0.0, -0.8),
        target_in_base: Point::new(0.56, 0.1, 0.12),
        click_px: Some([300.25, 120.75]),
        limits: Limits {
            max_feed_m_s: 0.02,
            max_probe_speed_m_s: 0.05,
            max_probe_travel_m: 0.1,
            max_probe_turn_rad: 0.5,
            max_contact_force_n: 10.0,
        },
        tracker: TrackerSettings::profile(Profile::Robust, 20),
        servo: ServoSettings {
            feed_m_s: 0.01,
            approach_m: 0.003,
            lateral_deadband_m: 0.005,
            slide_speed_m_s: 0.02,
            elevation_gain_per_s: 0.0,
            dither_m: 0.0,
            dither_period_s: 1.0,
            sweep_speed_m_s: 0.005,
            sweep_reach_m: 0.006,
            yaw_reach_rad: 0.1,
            yaw_speed_rad_s: 0.1,
            max_search_travel_m: 0.1,
            max_search_s: 20.0,
            ..ServoSettings::default()
        },
    }
}

/// A pose whose numbers have no round binary form.
pub fn pose(seed: f64) -> Pose {
    Pose::new(Vector::new(seed, -0.3 * seed, 0.7 + seed), Vector::new(0.2 * seed, 0.1, -0.4))
}

pub fn acquisition(sequence: u64) -> Acquisition {
    Acquisition {
        sequence,
        acquisition_tick: 40 * sequence,
        publication_tick: 40 * sequence + 3,
        pose_tick: 40 * sequence + 1,
        base_from_probe: pose(0.01 * sequence as f64),
        depth_m: (!sequence.is_multiple_of(3)).then_some(1e-4 * sequence as f64),
        feed_m_s: (!sequence.is_multiple_of(3)).then_some(0.01),
        contact_force_n: 3.1,
        arm_status: if sequence.is_multiple_of(2) { ArmStatus::Ready } else { ArmStatus::Holding },
        last_command: match sequence % 3 {
            0 => None,
            1 => Some(CommandReceipt { answers: sequence - 1, refused: None }),
            _ => Some(CommandReceipt { answers: sequence - 1, refused: Some(Refusal::Stale) }),
        },
    }
}

/// A picture that differs from image to image.
pub fn image(sequence: u64) -> Image {
    let mut image = Image::black(640, 480);
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        *pixel = (index as u64).wrapping_mul(31).wrapping_add(sequence.wrapping_mul(7)) as u8;
    }
    image
}

pub fn command(answers: u64) -> Command {
    let mut estimate =
        Estimate::bare(TrackState::Recovering, Reason::Candidate, Some([1.5 + answers as f64, 0.1]));
    estimate.ncc_previous = Some(0.93);
    estimate.brightness_ratio = Some(0.2);
    estimate.iterations = 7;
    Command {
        answers,
        estimate,
        target_base_from_probe: (!answers.is_multiple_of(2)).then(|| pose(0.02 * answers as f64)),
        feed_m_s: 0.01,
        compute_us: 250.0,
    }
}

/// A domain in the folder all runs use; each test has its own.
pub fn domain() -> Domain {
    Domain::create().expect("a domain can be made")
}

/// Another process's or thread's view of `domain`.
pub fn joined(domain: &Domain) -> Domain {
    Domain::open(domain.name(), domain.root()).expect("the simulator lives")
}

pub fn tracker(domain: &Domain) -> TrackerEndpoint {
    TrackerEndpoint::open(&joined(domain), PATIENCE).expect("the services open")
}

/// What is left of a domain anywhere.
pub fn leftovers(name: &str, root: &std::path::Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir("/dev/shm")
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(name))
        .map(|entry| entry.path())
        .collect();
    let lock = PathBuf::from(format!("{}.lock", root.display()));
    found.extend([root.to_path_buf(), lock].into_iter().filter(|path| path.exists()));
    found
}

/// Ends the test process when a test hangs, so that it fails instead of blocking everything.
pub struct Watchdog {
    done: Arc<AtomicBool>,
}

impl Watchdog {
    pub fn start() -> Self {
        let done = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&done);
        let deadline = Instant::now() + 3 * PATIENCE;
        std::thread::spawn(move || {
            while !seen.load(Ordering::Relaxed) {
                if Instant::now() >= deadline {
                    eprintln!("watchdog: a test hangs");
                    std::process::abort();
                }
                std::thread::sleep(Duration::from_millis(200));
            }
        });
        Self { done }
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
    }
}

/// A child process that does not outlive its test.
pub struct Kid(pub Child);

impl Kid {
    /// Runs one of this test binary's ignored tests, which are helper processes, in a process of its own.
    pub fn helper(test: &str, variables: &[(&str, &str)]) -> Self {
        let mut process = Process::new(std::env::current_exe().expect("a test knows its binary"));
        process.args(["--ignored", "--exact", test, "--nocapture", "--test-threads=1"]);
        process.envs(variables.iter().copied()).stdout(Stdio::piped()).stdin(Stdio::piped());
        Self(process.spawn().expect("the helper starts"))
    }

    /// Reads lines of the helper's output until one begins with `key` and returns the rest of it.
    pub fn read(&mut self, key: &str) -> String {
        use std::io::BufRead;
        let output = self.0.stdout.as_mut().expect("output is piped");
        let mut reader = std::io::BufReader::with_capacity(1, output);
        loop {
            let mut line = String::new();
            assert!(
                reader.read_line(&mut line).expect("output is text") > 0,
                "the helper ended without {key}"
            );
            if let Some((_, rest)) = line.split_once(key) {
                return rest.trim().to_owned();
            }
        }
    }
}

impl Drop for Kid {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
