use std::collections::BTreeMap;

use nalgebra::{Translation3, UnitQuaternion};
use sonoloop_types::{Pose, Vector};

use super::units::{m, rad, ticks, ticks_of_ms};
use crate::document::Document;
use crate::metrics::{METRICS, TRUTH_VALUED};
use crate::raw::{RawBound, RawDisturbance, RawKnock};
use crate::{Bound, Disturbance, DisturbanceKind, Expectation, LoadError, PhantomMotion};

/// The timeline by ascending tick; what happens at one tick keeps the order of the file.
pub(super) fn disturbances(
    document: &Document,
    raw: &[RawDisturbance],
    duration_s: f64,
) -> Result<Vec<Disturbance>, LoadError> {
    let mut timeline = Vec::new();
    for (index, entry) in raw.iter().enumerate() {
        let key = format!("disturbances.{index}");
        let (kind, length_s) = kind(document, &key, entry)?;
        if entry.at_s + length_s > duration_s {
            let message = if length_s > 0.0 {
                format!(
                    "must be at most {}, so that its {length_s} s end within duration_s = {duration_s}",
                    duration_s - length_s
                )
            } else {
                format!("must be at most duration_s = {duration_s}")
            };
            return Err(document.fail(&format!("{key}.at_s"), message));
        }
        timeline.push(Disturbance { tick: ticks(entry.at_s), kind });
    }
    timeline.sort_by_key(|disturbance| disturbance.tick);
    Ok(timeline)
}

/// What happens, and for how many seconds.
fn kind(document: &Document, key: &str, entry: &RawDisturbance) -> Result<(DisturbanceKind, f64), LoadError> {
    let mut kinds = Vec::new();
    if let Some(knock) = &entry.probe_knock {
        if [knock.elevation_mm, knock.lateral_mm, knock.yaw_deg, knock.tilt_deg].iter().all(|v| *v == 0.0) {
            return Err(
                document.fail(&format!("{key}.probe_knock"), "must move the probe; every part of it is 0")
            );
        }
        let kind = DisturbanceKind::ProbeKnock {
            probe_from_slipped: slip(knock),
            duration_ticks: ticks(knock.duration_s),
        };
        kinds.push((kind, knock.duration_s));
    }
    if let Some(lift) = &entry.lift_off {
        let kind =
            DisturbanceKind::LiftOff { height_m: m(lift.height_mm), duration_ticks: ticks(lift.duration_s) };
        kinds.push((kind, lift.duration_s));
    }
    if let Some(gain) = &entry.gain_change {
        kinds.push((DisturbanceKind::GainChange { gain_db: gain.gain_db }, 0.0));
    }
    if let Some(gain) = &entry.needle_brightness {
        kinds.push((DisturbanceKind::NeedleBrightness { gain_db: gain.gain_db }, 0.0));
    }
    if let Some(kill) = &entry.tracker_killed {
        kinds.push((DisturbanceKind::TrackerKilled { down_ticks: ticks(kill.down_s) }, kill.down_s));
    }
    if let Some(delay) = &entry.image_delay {
        kinds.push((DisturbanceKind::ImageDelay { image_ticks: ticks_of_ms(delay.image_ms) }, 0.0));
    }
    if let Some(breath) = &entry.breathing {
        let motion = PhantomMotion::Breathing {
            reach_m: shift(document, &format!("{key}.breathing"), [breath.x_mm, breath.y_mm, breath.z_mm])?,
            period_ticks: ticks(breath.period_s),
            phase_rad: rad(breath.phase_deg),
        };
        kinds.push((DisturbanceKind::PhantomMoves(motion), 0.0));
    }
    if let Some(drift) = &entry.phantom_drift {
        let speed = [drift.x_mm_s, drift.y_mm_s, drift.z_mm_s];
        let motion = PhantomMotion::Drift {
            velocity_m_s: shift(document, &format!("{key}.phantom_drift"), speed)?,
            duration_ticks: ticks(drift.duration_s),
        };
        kinds.push((DisturbanceKind::PhantomMoves(motion), drift.duration_s));
    }
    if let Some(step) = &entry.phantom_step {
        let motion = PhantomMotion::Step {
            shift_m: shift(document, &format!("{key}.phantom_step"), [step.x_mm, step.y_mm, step.z_mm])?,
            duration_ticks: ticks(step.duration_s),
        };
        kinds.push((DisturbanceKind::PhantomMoves(motion), step.duration_s));
    }
    match kinds[..] {
        [one] => Ok(one),
        _ => Err(document.fail(
            &format!("{key}.at_s"),
            "must come with exactly one of the keys probe_knock, lift_off, gain_change, needle_brightness, \
             tracker_killed, image_delay, breathing, phantom_drift, phantom_step",
        )),
    }
}

/// Three values in millimetres (per second) in SI; a motion that moves nothing is a mistake.
fn shift(document: &Document, key: &str, mm: [f64; 3]) -> Result<Vector, LoadError> {
    if mm == [0.0; 3] {
        return Err(document.fail(key, "must move the phantom; every part of it is 0"));
    }
    Ok(Vector::from(mm.map(m)))
}

/// The probe before the slip from the probe after it: y is elevational, z axial, x along the array.
fn slip(knock: &RawKnock) -> Pose {
    Pose::from_parts(
        Translation3::new(m(knock.lateral_mm), m(knock.elevation_mm), 0.0),
        UnitQuaternion::from_euler_angles(rad(knock.tilt_deg), 0.0, rad(knock.yaw_deg)),
    )
}

/// Bounds on metrics, in the order of [`METRICS`].
pub(super) fn expectations(
    document: &Document,
    raw: &BTreeMap<String, RawBound>,
) -> Result<Vec<Expectation>, LoadError> {
    let mut expect = Vec::new();
    for name in METRICS {
        let Some(bound) = raw.get(*name) else { continue };
        let fail = |key: &str, message: &str| Err(document.fail(key, message));
        let key = format!("expect.{name}");
        let is_truth = TRUTH_VALUED.contains(name);
        let bound = match *bound {
            RawBound::Is(value) if is_truth => Bound::Is(value),
            RawBound::Is(_) => return fail(&key, "is a number; must be bounded by {min: …, max: …}"),
            RawBound::Range(_) if is_truth => return fail(&key, "must be true or false"),
            RawBound::Range(range) => match (range.min, range.max) {
                (None, None) => return fail(&key, "must have min, max or both"),
                (Some(min), Some(max)) if min > max => {
                    return Err(document.fail(&format!("{key}.min"), format!("must be at most max = {max}")));
                }
                (min, max) => Bound::Range { min, max },
            },
        };
        expect.push(Expectation { metric: (*name).to_owned(), bound });
    }
    match raw.keys().find(|name| !METRICS.contains(&name.as_str())) {
        Some(name) => Err(document
            .fail(&format!("expect.{name}"), format!("is no metric; known are {}", METRICS.join(", ")))),
        None => Ok(expect),
    }
}
