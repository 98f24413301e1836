//! Beyond the paper: its plain configuration beside this project's, over seeds; and where each breaks.

use std::path::{Path, PathBuf};

use sonoloop_scenario::{LoadOptions, load};
use sonoloop_types::Profile;

use crate::commands::execute_in_process;
use crate::controller::ControllerKind;
use crate::error::AppError;
use crate::judge::Metrics;
use crate::parallel::each;
use crate::scenarios::prepare;
use crate::session::Session;

/// Seeds of the success rates.
pub(super) const SEEDS: u64 = 10;
/// Seeds of each cell of a map.
pub(super) const MAP_SEEDS: u64 = 3;
/// What the maps are made of: nothing goes wrong in it by itself.
pub(super) const MAPPED: &str = "lateral_04.yaml";
/// How much less the needle echoes than its file says.
pub(super) const FAINTER_DB: [f64; 5] = [0.0, 3.0, 6.0, 9.0, 12.0];
/// Images per second; at 10 mm/s the tip moves 0.2 to 1.25 mm from one to the next. Slower ones would let the needle robot's
/// watchdog stop the needle.
pub(super) const RATES_HZ: [u32; 5] = [50, 25, 20, 10, 8];
/// From taking a picture to handing it out.
pub(super) const DELAYS_MS: [u32; 5] = [0, 100, 200, 300, 400];
/// Both profiles with their names in files.
pub(super) const PROFILES: [(Profile, &str); 2] = [(Profile::Robust, "robust"), (Profile::Paper, "paper")];

/// One run of one sequence.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub name: String,
    pub profile: &'static str,
    pub seed: u64,
    pub passed: bool,
    pub metrics: Metrics,
    pub failures: String,
}

/// One run of a map.
#[derive(Debug, Clone)]
pub(super) struct MapTrial {
    pub profile: &'static str,
    pub fainter_db: f64,
    pub rate_hz: u32,
    pub delay_ms: u32,
    pub seed: u64,
    pub passed: bool,
    pub metrics: Metrics,
}

/// All of them.
pub(super) struct Studies {
    pub trials: Vec<Trial>,
    pub by_motion: Vec<MapTrial>,
    pub by_delay: Vec<MapTrial>,
}

/// Runs all studies; `say` hears of every tenth of each.
pub(super) fn studies(
    files: &[PathBuf],
    jobs: usize,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Studies, AppError> {
    let mapped = files.iter().find(|file| file.ends_with(MAPPED));
    let mapped = mapped.ok_or_else(|| AppError::BadInput(format!("error: {MAPPED} is missing")))?;
    Ok(Studies {
        trials: trials(files, jobs, say)?,
        by_motion: maps(mapped, &RATES_HZ, &[0], jobs, "contrast and motion", say)?,
        by_delay: maps(mapped, &[25], &DELAYS_MS, jobs, "contrast and delay", say)?,
    })
}

fn trials(files: &[PathBuf], jobs: usize, say: &(dyn Fn(&str) + Sync)) -> Result<Vec<Trial>, AppError> {
    let mut cases = Vec::new();
    for file in files {
        for (_, profile) in PROFILES {
            cases.extend((0..SEEDS).map(|seed| (file, profile, seed)));
        }
    }
    let heard = Heard::new("profiles over seeds", cases.len(), say);
    let results = each(jobs, &cases, |&(file, profile, seed)| {
        let (scenario, session) = prepare(file, Some(seed), &[format!("tracker.profile={profile}")])?;
        let finished = execute_in_process(&scenario, session, ControllerKind::Tracker)?;
        heard.one();
        Ok(Trial {
            name: scenario.name.clone(),
            profile,
            seed,
            passed: finished.passed(),
            metrics: finished.summary.metrics,
            failures: finished.failed().join("; "),
        })
    });
    results.into_iter().collect()
}

fn maps(
    file: &Path,
    rates_hz: &[u32],
    delays_ms: &[u32],
    jobs: usize,
    what: &str,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Vec<MapTrial>, AppError> {
    let mut cases = Vec::new();
    for (_, profile) in PROFILES {
        for fainter_db in FAINTER_DB {
            for rate_hz in rates_hz {
                for delay_ms in delays_ms {
                    cases.extend((0..MAP_SEEDS).map(|seed| (profile, fainter_db, *rate_hz, *delay_ms, seed)));
                }
            }
        }
    }
    let heard = Heard::new(what, cases.len(), say);
    let results = each(jobs, &cases, |&(profile, fainter_db, rate_hz, delay_ms, seed)| {
        // It ends at its target, however many images that takes.
        let set = [
            format!("tracker.profile={profile}"),
            "images=null".to_owned(),
            "duration_s=20".to_owned(),
            format!("image_rate_hz={rate_hz}"),
            format!("delays.image_ms={delay_ms}"),
        ];
        let options = LoadOptions { seed: Some(seed), set: set.to_vec(), ..LoadOptions::default() };
        let mut scenario = load(file, &options)?;
        let needle = &mut scenario.needle;
        for level_db in [&mut needle.specular_level_db, &mut needle.rough_level_db, &mut needle.tip_level_db]
        {
            *level_db -= fainter_db;
        }
        let session = Session::new(&scenario).map_err(AppError::fault)?;
        let finished = execute_in_process(&scenario, session, ControllerKind::Tracker)?;
        heard.one();
        let (passed, metrics) = (finished.passed(), finished.summary.metrics);
        Ok(MapTrial { profile, fainter_db, rate_hz, delay_ms, seed, passed, metrics })
    });
    results.into_iter().collect()
}

/// Says how far a study is.
struct Heard<'a> {
    what: &'a str,
    all: usize,
    done: std::sync::atomic::AtomicUsize,
    say: &'a (dyn Fn(&str) + Sync),
}

impl<'a> Heard<'a> {
    fn new(what: &'a str, all: usize, say: &'a (dyn Fn(&str) + Sync)) -> Self {
        Self { what, all, done: 0.into(), say }
    }

    fn one(&self) {
        let done = 1 + self.done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        if done.is_multiple_of((self.all / 10).max(1)) {
            (self.say)(&format!("{}: {done} of {}", self.what, self.all));
        }
    }
}
