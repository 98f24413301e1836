//! Sections of the report on what goes beyond the paper.

use super::drawing::{Map, maps};
use super::figures::profile_text;
use super::studies::{
    DELAYS_MS, FAINTER_DB, MAP_SEEDS, MAPPED, MapTrial, PROFILES, RATES_HZ, SEEDS, Studies, Trial,
};
use crate::output::{median, wilson};
use crate::page::{Block, Column, Row, Section, Table};

/// Both sections.
pub(super) fn sections(studies: &Studies) -> [Section; 2] {
    [profiles(studies), breaking(studies)]
}

fn profiles(studies: &Studies) -> Section {
    let mut names: Vec<&str> = Vec::new();
    for trial in &studies.trials {
        if !names.contains(&trial.name.as_str()) {
            names.push(&trial.name);
        }
    }
    let of = |name: Option<&str>, profile: &str| -> Vec<&Trial> {
        let is_meant =
            |trial: &&Trial| trial.profile == profile && name.is_none_or(|name| trial.name == name);
        studies.trials.iter().filter(is_meant).collect()
    };
    let row = |label: &str, name: Option<&str>| {
        let mut cells = vec![label.to_owned()];
        for (_, profile) in PROFILES {
            let trials = of(name, profile);
            let passed = trials.iter().filter(|trial| trial.passed).count();
            let false_recoveries: u64 = trials.iter().map(|trial| trial.metrics.false_recoveries).sum();
            let silent_s: f64 = trials.iter().filter_map(|trial| trial.metrics.silent_loss_s).sum();
            let rmses_mm: Vec<f64> = trials.iter().filter_map(|trial| trial.metrics.tip_rmse_mm).collect();
            cells.extend([
                format!("{passed} of {}", trials.len()),
                median(&rmses_mm).map_or("–".to_owned(), |mm| format!("{mm:.2}")),
                false_recoveries.to_string(),
                format!("{silent_s:.1}"),
            ]);
        }
        Row::new(cells)
    };
    let mut rows: Vec<Row> = names.iter().map(|name| row(name, Some(name))).collect();
    rows.push(row("all", None));
    let numbers = [
        "default: pass",
        "tip RMSE, median mm",
        "false recoveries",
        "silent loss, s",
        "paper's: pass",
        "tip RMSE, median mm",
        "false recoveries",
        "silent loss, s",
    ];
    let columns = std::iter::once(Column::text("sequence")).chain(numbers.map(Column::number)).collect();
    let rates = PROFILES.map(|(profile, name)| {
        let trials = of(None, name);
        let passed = trials.iter().filter(|trial| trial.passed).count();
        let (low, high) = wilson(passed as u64, trials.len() as u64);
        format!(
            "{}: {passed} of {} pass (95 % interval {:.0} to {:.0} %)",
            profile_text(profile),
            trials.len(),
            100.0 * low,
            100.0 * high
        )
    });
    let failed = of(None, PROFILES[0].1).into_iter().filter(|trial| !trial.passed);
    let failed = failed.map(|trial| format!("{} seed {} ({})", trial.name, trial.seed, trial.failures));
    let failed: Vec<_> = failed.collect();
    let mut blocks = vec![
        Block::Text(format!(
            "Every sequence with seeds 0 to {}, once with the default configuration and once with the paper's alone; the servo is the \
             same. {}.",
            SEEDS - 1,
            rates.join("; ")
        )),
        Block::Table(Table { columns, rows }),
    ];
    if !failed.is_empty() {
        blocks.push(Block::Note(format!("The default configuration fails {}.", failed.join("; "))));
    }
    Section::new("Beyond the paper: success over seeds", blocks)
}

fn breaking(studies: &Studies) -> Section {
    let fainter: Vec<String> = FAINTER_DB
        .iter()
        .map(|db| if *db == 0.0 { "as is".to_owned() } else { format!("−{db} dB") })
        .collect();
    let shares = |trials: &[MapTrial], profile: &str| -> Vec<f64> {
        let of_profile: Vec<_> = trials.iter().filter(|trial| trial.profile == profile).collect();
        let cells = of_profile.chunks(MAP_SEEDS as usize);
        cells
            .map(|cell| cell.iter().filter(|trial| trial.passed).count() as f64 / cell.len() as f64)
            .collect()
    };
    let map = |title, across, columns: Vec<String>, shares| Map {
        title,
        across,
        down: "needle",
        columns,
        rows: fainter.clone(),
        shares,
    };
    let motions = || RATES_HZ.iter().map(|hz| format!("{:.2}", 10.0 / f64::from(*hz))).collect();
    let delays = || DELAYS_MS.iter().map(|ms| ms.to_string()).collect();
    let both = |across, columns: &dyn Fn() -> Vec<String>, trials: &[MapTrial]| {
        let drawn = PROFILES
            .map(|(profile, name)| map(profile_text(profile), across, columns(), shares(trials, name)));
        maps(&drawn)
    };
    Section::new(
        "Beyond the paper: where it breaks",
        vec![
            Block::Text(format!(
                "{MAPPED} with the needle's echo made fainter (the contrast to the background), with more motion from image to image (fewer \
                 images per second at 10 mm/s), and with pictures that come late. Share of {MAP_SEEDS} seeds that pass every bound of the file."
            )),
            Block::Figure {
                svg: both("motion from image to image, mm", &motions, &studies.by_motion),
                caption: "contrast and motion".into(),
            },
            Block::Figure {
                svg: both("delay of the pictures, ms", &delays, &studies.by_delay),
                caption: "contrast and delay".into(),
            },
        ],
    )
}
