//! What a suite of runs comes to: per scenario, per folder, and in all.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::Serialize;

use super::summary::median;
use super::{Summary, wilson};
use crate::judge::{Value, passes};

/// The metrics whose medians are told, and whether a low value is the worse one.
const TOLD: [(&str, bool); 10] = [
    ("tip_rmse_mm", false),
    ("coverage", true),
    ("recovery_time_s", false),
    ("travel_after_loss_mm", false),
    ("stop_delay_s", false),
    ("silent_loss_s", false),
    ("plane_to_tip_rms_mm", false),
    ("final_target_distance_mm", false),
    ("max_contact_force_n", false),
    (REALTIME_FACTOR, true),
];
/// Not one of the metrics: how fast the run was.
const REALTIME_FACTOR: &str = "realtime_factor";

/// One run: its scenario's file, its seed, and its summary unless it could not be judged.
pub type Run<'a> = (&'a Path, u64, Option<&'a Summary>);

/// How many runs passed, with Wilson's 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rate {
    /// Runs in which every expectation held.
    pub passed: u64,
    /// All runs.
    pub runs: u64,
    /// Lower end of the interval.
    pub wilson_low: f64,
    /// Upper end.
    pub wilson_high: f64,
    /// Recoveries on a place where the tip was not, over all runs.
    pub false_recoveries: u64,
}

/// A metric over the seeds of one scenario.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median over the runs in which it has a value.
    pub median: f64,
    /// The worst value.
    pub worst: f64,
    /// The first seed that has it.
    pub worst_seed: u64,
}

/// All runs of one scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScenarioRates {
    /// Its file.
    pub scenario: String,
    /// How many passed.
    #[serde(flatten)]
    pub rate: Rate,
    /// Seeds that did not pass.
    pub failed_seeds: Vec<u64>,
    /// Metrics by name; those without any value are left out.
    pub metrics: BTreeMap<&'static str, Spread>,
}

/// All runs of the scenarios in one folder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupRates {
    /// The folder.
    pub group: String,
    /// How many passed.
    #[serde(flatten)]
    pub rate: Rate,
}

/// What a suite comes to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rates {
    /// By file.
    pub rates: Vec<ScenarioRates>,
    /// By folder.
    pub groups: Vec<GroupRates>,
    /// All runs together.
    pub all: Rate,
}

impl Rates {
    /// Sums up runs, in whatever order they come.
    pub fn of(runs: &[Run<'_>]) -> Self {
        let mut by_file: BTreeMap<&Path, Vec<Run<'_>>> = BTreeMap::new();
        let mut by_folder: BTreeMap<String, Vec<Run<'_>>> = BTreeMap::new();
        for run in runs {
            by_file.entry(run.0).or_default().push(*run);
            let folder = run.0.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new(".")).display().to_string();
            by_folder.entry(folder).or_default().push(*run);
        }
        let of_scenario = |(file, runs): (&Path, Vec<Run<'_>>)| ScenarioRates {
            scenario: file.display().to_string(),
            rate: Rate::of(&runs),
            failed_seeds: failed(&runs),
            metrics: TOLD.iter().filter_map(|&(name, low)| Some((name, spread(&runs, name, low)?))).collect(),
        };
        Self {
            rates: by_file.into_iter().map(of_scenario).collect(),
            groups: by_folder
                .into_iter()
                .map(|(group, runs)| GroupRates { group, rate: Rate::of(&runs) })
                .collect(),
            all: Rate::of(runs),
        }
    }

    /// For people: two or three lines per scenario, one per folder, one for all.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for scenario in &self.rates {
            line(&mut text, &scenario.scenario, &scenario.rate);
            let told = TOLD.iter().filter_map(|(name, _)| {
                let Spread { median, worst, worst_seed } = scenario.metrics.get(name)?;
                Some(format!("{name} {median:.2} ({worst:.2}, seed {worst_seed})"))
            });
            for part in told.collect::<Vec<_>>().chunks(4) {
                let _ = writeln!(text, "    {}", part.join("  "));
            }
            if !scenario.failed_seeds.is_empty() {
                let seeds: Vec<String> = scenario.failed_seeds.iter().map(u64::to_string).collect();
                let _ = writeln!(text, "    failed with seed {}", seeds.join(", "));
            }
        }
        let _ = writeln!(text, "metrics: median (worst)");
        for group in &self.groups {
            line(&mut text, &format!("{}/", group.group), &group.rate);
        }
        line(&mut text, "all", &self.all);
        text
    }
}

fn line(text: &mut String, name: &str, rate: &Rate) {
    let Rate { passed, runs, wilson_low, wilson_high, false_recoveries } = rate;
    let _ = writeln!(
        text,
        "{name:<44} {passed:>3}/{runs:<3}  95 % interval {wilson_low:.3}–{wilson_high:.3}  false recoveries \
         {false_recoveries}"
    );
}

impl Rate {
    fn of(runs: &[Run<'_>]) -> Self {
        let (runs_in_all, passed) = (runs.len() as u64, (runs.len() - failed(runs).len()) as u64);
        let (wilson_low, wilson_high) = wilson(passed, runs_in_all);
        let false_recoveries = runs.iter().filter_map(|run| run.2).map(|s| s.metrics.false_recoveries).sum();
        Self { passed, runs: runs_in_all, wilson_low, wilson_high, false_recoveries }
    }
}

/// Seeds that did not pass, or could not be judged.
fn failed(runs: &[Run<'_>]) -> Vec<u64> {
    let passed = |summary: Option<&Summary>| summary.is_some_and(|summary| passes(&summary.expectations));
    runs.iter().filter(|run| !passed(run.2)).map(|run| run.1).collect()
}

fn spread(runs: &[Run<'_>], name: &str, low_is_worse: bool) -> Option<Spread> {
    let of = |summary: &Summary| match summary.metrics.value(name) {
        _ if name == REALTIME_FACTOR => summary.timing.realtime_factor,
        Some(Value::Number(value)) => Some(value),
        _ => None,
    };
    let values: Vec<(f64, u64)> = runs.iter().filter_map(|run| Some((of(run.2?)?, run.1))).collect();
    let median = median(&values.iter().map(|(value, _)| *value).collect::<Vec<_>>())?;
    let sign = if low_is_worse { -1.0 } else { 1.0 };
    let (worst, worst_seed) =
        values.into_iter().reduce(|worst, next| if sign * next.0 > sign * worst.0 { next } else { worst })?;
    Some(Spread { median, worst, worst_seed })
}

#[cfg(test)]
mod tests {
    use sonoloop_types::ImageGeometry;

    use super::*;
    use crate::judge::test_recording::{facts, scripted};
    use crate::judge::{metrics, verdict};
    use crate::output::test_run::scenario;
    use crate::peer::TrackerName;

    /// A run of so many images, all visible, the last ones LOST.
    fn summary(lost: usize) -> Summary {
        let states = format!("{}{}", "T".repeat(10 - lost), "L".repeat(lost));
        let recording = scripted("vvvvvvvvvv", &states);
        let metrics = metrics(&recording, &facts());
        let expect = sonoloop_scenario::Expectation {
            metric: "coverage".into(),
            bound: sonoloop_scenario::Bound::Range { min: Some(0.75), max: None },
        };
        Summary::new(
            &scenario(ImageGeometry::default()),
            &TrackerName::own(),
            "0",
            &metrics,
            &verdict(&metrics, &[expect]),
            &recording,
        )
    }

    #[test]
    fn rates_medians_and_worst_seeds_by_file_and_folder() {
        let summaries = [summary(0), summary(1), summary(4), summary(2)];
        let [a, b] = [Path::new("s/a.yaml"), Path::new("s/faults/b.yaml")];
        let runs = [
            (a, 0, Some(&summaries[0])),
            (a, 1, Some(&summaries[1])),
            (a, 2, Some(&summaries[2])),
            (b, 5, Some(&summaries[3])),
            (b, 6, None),
        ];
        let rates = Rates::of(&runs);
        let [of_a, of_b] = &rates.rates[..] else { panic!("two files") };
        let passed = |scenario: &ScenarioRates| {
            (
                scenario.scenario.clone(),
                scenario.rate.passed,
                scenario.rate.runs,
                scenario.failed_seeds.clone(),
            )
        };
        assert_eq!(passed(of_a), ("s/a.yaml".into(), 2, 3, vec![2]));
        assert_eq!(passed(of_b), ("s/faults/b.yaml".into(), 1, 2, vec![6]));
        assert_eq!(of_a.metrics["coverage"], Spread { median: 0.9, worst: 0.6, worst_seed: 2 });
        assert!(!of_a.metrics.contains_key("recovery_time_s"), "nothing was recovered");
        assert_eq!((rates.all.passed, rates.all.runs), (3, 5));
        assert_eq!((rates.all.wilson_low, rates.all.wilson_high), wilson(3, 5));
        let groups: Vec<_> =
            rates.groups.iter().map(|g| (g.group.as_str(), g.rate.passed, g.rate.runs)).collect();
        assert_eq!(groups, [("s", 2, 3), ("s/faults", 1, 2)]);
        let text = rates.text();
        assert!(
            text.contains("failed with seed 6") && text.contains("coverage 0.90 (0.60, seed 2)"),
            "{text}"
        );
        let json = serde_json::to_value(&rates).unwrap();
        assert_eq!(json["rates"][0]["passed"], 2);
        assert_eq!(json["groups"][1]["wilson_low"], json["rates"][1]["wilson_low"]);
    }
}
