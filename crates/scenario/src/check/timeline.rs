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
        let parts = [knock.elevation_mm, knock.lateral_mm, knock.yaw_deg, knock.tilt_deg, knock.roll_deg];
        if parts.iter().all(|part| *part == 0.0) {
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
    if let Some(delay) = &entry.command_delay {
        kinds.push((DisturbanceKind::CommandDelay { command_ticks: ticks_of_ms(delay.command_ms) }, 0.0));
    }
    kinds.extend(lost_on_the_way(document, key, entry)?);
    kinds.extend(stuck(entry));
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
            format!("must come with exactly one of the keys {}", RawDisturbance::KINDS),
        )),
    }
}

/// What happens to sound and pictures on their way to the tracker.
fn lost_on_the_way(
    document: &Document,
    key: &str,
    entry: &RawDisturbance,
) -> Result<Vec<(DisturbanceKind, f64)>, LoadError> {
    let mut kinds = Vec::new();
    if let Some(lost) = &entry.gel_lost {
        if lost.from_mm >= lost.to_mm {
            let message = format!("must be above from_mm = {}", lost.from_mm);
            return Err(document.fail(&format!("{key}.gel_lost.to_mm"), message));
        }
        let kind = DisturbanceKind::GelLost {
            from_m: m(lost.from_mm),
            to_m: m(lost.to_mm),
            gap_m: m(lost.gap_mm),
            duration_ticks: ticks(lost.duration_s),
        };
        kinds.push((kind, lost.duration_s));
    }
    if let Some(noise) = &entry.noise {
        kinds.push((DisturbanceKind::Noise { gain_db: noise.gain_db }, 0.0));
    }
    if let Some(shadow) = &entry.shadow {
        let kind = DisturbanceKind::Shadow {
            x_m: m(shadow.x_mm),
            width_m: m(shadow.width_mm),
            loss_db: shadow.loss_db,
            duration_ticks: ticks(shadow.duration_s),
        };
        kinds.push((kind, shadow.duration_s));
    }
    if let Some(span) = &entry.frozen_images {
        let kind = DisturbanceKind::FrozenImages { duration_ticks: ticks(span.duration_s) };
        kinds.push((kind, span.duration_s));
    }
    if let Some(dropped) = &entry.dropped_images {
        let kind = DisturbanceKind::DroppedImages {
            share: dropped.share,
            duration_ticks: ticks(dropped.duration_s),
        };
        kinds.push((kind, dropped.duration_s));
    }
    Ok(kinds)
}

/// Who does not do what it is asked.
fn stuck(entry: &RawDisturbance) -> Vec<(DisturbanceKind, f64)> {
    let mut kinds = Vec::new();
    if let Some(span) = &entry.arm_stall {
        let kind = DisturbanceKind::ArmStall { duration_ticks: ticks(span.duration_s) };
        kinds.push((kind, span.duration_s));
    }
    if let Some(span) = &entry.tracker_hung {
        let kind = DisturbanceKind::TrackerHung { duration_ticks: ticks(span.duration_s) };
        kinds.push((kind, span.duration_s));
    }
    if let Some(span) = &entry.tracker_garbage {
        let kind = DisturbanceKind::TrackerGarbage { duration_ticks: ticks(span.duration_s) };
        kinds.push((kind, span.duration_s));
    }
    kinds
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
        UnitQuaternion::from_euler_angles(rad(knock.tilt_deg), rad(knock.roll_deg), rad(knock.yaw_deg)),
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
