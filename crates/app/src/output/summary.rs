use serde::{Deserialize, Serialize};
use sonoloop_scenario::Scenario;
use sonoloop_types::{EndReason, TICKS_PER_SECOND};

use super::Setting;
use crate::judge::{Judged, Metrics, passes};
use crate::peer::TrackerName;
use crate::record::Recording;

/// `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of the run.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Who answered the images.
    pub tracker: TrackerName,
    /// What became of the expectations together.
    pub verdict: Verdict,
    /// Why the run ended; after anything but `target_reached` and `time_over` its bytes are not comparable.
    pub end: EndReason,
    /// Paced by the clock: the same seed gives other bytes next time.
    pub realtime: bool,
    /// What the run was set to.
    pub setting: Setting,
    /// Every expectation and what became of it.
    pub expectations: Vec<Judged>,
    /// All metrics; null without a value.
    pub metrics: Metrics,
    /// How long it took.
    pub timing: TimingSummary,
}

/// What became of the expectations together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All held.
    Pass,
    /// At least one did not.
    Fail,
}

impl Summary {
    /// Sums up a judged run.
    pub fn new(
        scenario: &Scenario,
        tracker: &TrackerName,
        version: &str,
        metrics: &Metrics,
        judged: &[Judged],
        recording: &Recording,
    ) -> Self {
        Self {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            version: version.to_owned(),
            tracker: tracker.clone(),
            verdict: if passes(judged) { Verdict::Pass } else { Verdict::Fail },
            end: recording.end,
            realtime: recording.timing.behind_ticks.is_some(),
            setting: Setting::of(scenario),
            expectations: judged.to_vec(),
            metrics: *metrics,
            timing: TimingSummary::of(recording),
        }
    }

    /// The file's bytes: indented, in the order above, a line break at the end.
    pub fn to_json(&self) -> String {
        let json = serde_json::to_string_pretty(self).unwrap_or_default();
        format!("{json}\n")
    }
}

/// Medians and totals of a run's [`Timing`](crate::record::Timing).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimingSummary {
    /// Median time to render an image.
    pub render_ms_p50: Option<f64>,
    /// Median time to step the world to the next image.
    pub physics_ms_p50: Option<f64>,
    /// Median time of tracker and servo per image.
    pub track_us_p50: Option<f64>,
    /// Median time an image and its answer spend on the way.
    pub wire_us_p50: Option<f64>,
    /// From the first image published to the last answer, by the clock.
    pub wall_s: f64,
    /// Simulated time over the same stretch.
    pub simulated_s: f64,
    /// Simulated over wall-clock time.
    pub realtime_factor: Option<f64>,
    /// Median age of the command in effect when an image was handed out: since the image was taken that it answers.
    pub staleness_ms_p50: Option<f64>,
    /// The largest such age.
    pub staleness_ms_max: Option<f64>,
    /// Images without an answer, or with none that was sound.
    pub images_without_answer: u64,
    /// Farthest that simulated time fell behind the clock; null in lockstep, which has no clock.
    pub behind_ms_max: Option<f64>,
}

impl TimingSummary {
    /// Sums up a run's timing; a median of nothing is `None`.
    pub fn of(recording: &Recording) -> Self {
        let (timing, images) = (&recording.timing, &recording.images);
        let ms = |ticks: u64| (ticks * 1000 / TICKS_PER_SECOND) as f32;
        let ages_ms: Vec<f32> = images.iter().map(|row| ms(row.command_age_ticks)).collect();
        Self {
            render_ms_p50: median(&timing.render_ms),
            physics_ms_p50: median(&timing.physics_ms),
            track_us_p50: median(&timing.track_us),
            wire_us_p50: median(&timing.wire_us),
            wall_s: timing.wall_s,
            simulated_s: timing.simulated_s,
            realtime_factor: (timing.wall_s > 0.0).then(|| timing.simulated_s / timing.wall_s),
            staleness_ms_p50: median(&ages_ms),
            staleness_ms_max: ages_ms.iter().copied().reduce(f32::max).map(f64::from),
            images_without_answer: images.iter().filter(|row| row.command.is_none()).count() as u64,
            behind_ms_max: timing.behind_ticks.map(ms).map(f64::from),
        }
    }
}

/// Median; of nothing there is none.
pub(crate) fn median<T: Copy + Into<f64>>(values: &[T]) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().map(T::into).collect();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let upper = *sorted.get(middle)?;
    Some(if sorted.len() % 2 == 1 { upper } else { (sorted[middle - 1] + upper) / 2.0 })
}

#[cfg(test)]
mod tests {
    use sonoloop_types::ImageGeometry;

    use super::*;
    use crate::judge::test_recording::{facts, scripted};
    use crate::judge::{metrics, verdict};
    use crate::output::test_run::scenario;
    use crate::record::Timing;

    #[test]
    fn summary_has_the_shape_of_the_contract() {
        let mut recording = scripted("---", "SSS");
        recording.end = EndReason::Interrupted;
        let metrics = metrics(&recording, &facts());
        recording.timing = Timing {
            render_ms: vec![3.0, 1.0, 2.0, 9.0],
            wall_s: 2.0,
            simulated_s: 12.0,
            ..Timing::default()
        };
        let summary = Summary::new(
            &scenario(ImageGeometry::default()),
            &TrackerName::own(),
            "0.1.0",
            &metrics,
            &verdict(&metrics, &[]),
            &recording,
        );
        let json: serde_json::Value = serde_json::from_str(&summary.to_json()).unwrap();
        let keys = |value: &serde_json::Value| -> Vec<String> {
            value.as_object().unwrap().keys().cloned().collect()
        };
        let mut top = keys(&json);
        top.sort();
        assert_eq!(json["end"], "interrupted");
        assert_eq!(
            top,
            [
                "end",
                "expectations",
                "metrics",
                "realtime",
                "scenario",
                "seed",
                "setting",
                "timing",
                "tracker",
                "verdict",
                "version"
            ]
        );
        let mut timing = keys(&json["timing"]);
        timing.sort();
        assert_eq!(
            timing,
            [
                "behind_ms_max",
                "images_without_answer",
                "physics_ms_p50",
                "realtime_factor",
                "render_ms_p50",
                "simulated_s",
                "staleness_ms_max",
                "staleness_ms_p50",
                "track_us_p50",
                "wall_s",
                "wire_us_p50"
            ]
        );
        assert_eq!(serde_json::from_str::<Summary>(&summary.to_json()).unwrap(), summary, "reads back");
        assert_eq!(json["verdict"], "fail");
        assert_eq!(json["metrics"]["tip_rmse_px"], serde_json::Value::Null);
        assert_eq!(json["metrics"]["success"], false);
        assert_eq!(json["expectations"][0]["metric"], "success");
        assert_eq!(json["expectations"][0]["bound"], true);
        assert_eq!(json["timing"]["render_ms_p50"], 2.5);
        assert_eq!(json["timing"]["track_us_p50"], serde_json::Value::Null);
        assert_eq!(json["timing"]["realtime_factor"], 6.0);
        assert_eq!(
            (&json["realtime"], &json["timing"]["behind_ms_max"]),
            (&false.into(), &serde_json::Value::Null)
        );
    }
}
