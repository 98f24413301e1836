use sonoloop_types::{
    Guess, Init, Limits, Method, Optimisation, Profile, SearchPattern, ServoSettings, Similarity,
    TrackerSettings, UpdateStrategy, Warp,
};

use super::units::{m, rad, ticks_of_ms};
use crate::document::Document;
use crate::raw::{
    RawCalibration, RawDelays, RawGuess, RawInit, RawLimits, RawMethod, RawProfile, RawSearchPattern,
    RawServo, RawSimilarity, RawTracker, RawUpdate, RawView, RawWarp,
};
use crate::{CalibrationSpec, DelaySpec, LoadError, NeedleRobotSpec};

/// The profile's values, with what the file says in their place.
pub(super) fn tracker(
    document: &Document,
    raw: &RawTracker,
    view: RawView,
) -> Result<TrackerSettings, LoadError> {
    let sees_a_line = matches!(view, RawView::Lateral);
    let why = "it looks for a line, and in a transverse view the needle is a spot";
    if matches!(raw.init, RawInit::Localize) && !sees_a_line {
        return Err(document.fail("tracker.init", format!("must be \"click\": {why}")));
    }
    if matches!(raw.method, RawMethod::Baseline) && !sees_a_line {
        return Err(document.fail("tracker.method", format!("must be \"template\": {why}")));
    }
    if let Some(sigma_px) = raw.weight_sigma_px.filter(|sigma_px| *sigma_px > 0.0 && *sigma_px < 1.0) {
        // Narrower than this a Gaussian leaves the sums to a handful of pixels.
        return Err(document.fail_value("tracker.weight_sigma_px", sigma_px, "must be 0, or at least 1"));
    }
    let profile = match raw.profile {
        RawProfile::Paper => Profile::Paper,
        RawProfile::Robust => Profile::Robust,
    };
    let base = TrackerSettings::profile(profile, raw.template_px);
    Ok(TrackerSettings {
        profile,
        method: match raw.method {
            RawMethod::Template => Method::Template,
            RawMethod::Baseline => Method::Baseline,
        },
        init: match raw.init {
            RawInit::Click => Init::Click,
            RawInit::Localize => Init::Localize,
        },
        template_px: raw.template_px,
        similarity: raw.similarity.map_or(base.similarity, |similarity| match similarity {
            RawSimilarity::Ssd => Similarity::Ssd,
            RawSimilarity::Scv => Similarity::Scv,
        }),
        optimisation: match raw.order {
            None => base.optimisation,
            Some(1) => Optimisation::FirstOrder,
            Some(_) => Optimisation::SecondOrder, // 1 and 2 are all that the range lets through
        },
        warp: raw.warp.map_or(base.warp, |warp| match warp {
            RawWarp::Translation => Warp::Translation,
            RawWarp::Rigid => Warp::Rigid,
            RawWarp::Affine => Warp::Affine,
        }),
        update: raw.update.map_or(base.update, |update| match update {
            RawUpdate::None => UpdateStrategy::None,
            RawUpdate::Naive => UpdateStrategy::Naive,
            RawUpdate::DriftCorrected => UpdateStrategy::DriftCorrected,
        }),
        refine: raw.refine.unwrap_or(base.refine),
        scv_bins: raw.scv_bins.unwrap_or(base.scv_bins),
        blur_sigma_px: raw.blur_sigma_px.unwrap_or(base.blur_sigma_px),
        weight_sigma_px: raw.weight_sigma_px.unwrap_or(base.weight_sigma_px),
        guess: raw.guess.map_or(base.guess, |guess| match guess {
            RawGuess::None => Guess::None,
            RawGuess::ConstantVelocity => Guess::ConstantVelocity,
            RawGuess::Kalman => Guess::Kalman,
            RawGuess::Insertion => Guess::Insertion,
        }),
        pyramid_levels: raw.pyramid_levels.unwrap_or(base.pyramid_levels),
        velocity_memory: raw.velocity_memory.unwrap_or(base.velocity_memory),
        drift_tolerance_px: raw.drift_tolerance_px.unwrap_or(base.drift_tolerance_px),
        max_iterations: raw.max_iterations.unwrap_or(base.max_iterations),
        epsilon_px: raw.epsilon_px.unwrap_or(base.epsilon_px),
        loss_ncc_previous: raw.loss_ncc_previous.unwrap_or(base.loss_ncc_previous),
        loss_ncc_anchor: raw.loss_ncc_anchor.unwrap_or(base.loss_ncc_anchor),
        loss_brightness_ratio: raw.loss_brightness_ratio.unwrap_or(base.loss_brightness_ratio),
        recovery_ncc: raw.recovery_ncc.unwrap_or(base.recovery_ncc),
        confirmation_images: raw.confirmation_images.unwrap_or(base.confirmation_images),
        whole_image_after: raw.whole_image_after.unwrap_or(base.whole_image_after),
    })
}

/// Bounds of commands; the needle robot's own bound holds as well.
pub(super) fn limits(
    document: &Document,
    raw: &RawLimits,
    robot: &NeedleRobotSpec,
) -> Result<Limits, LoadError> {
    if m(raw.max_feed_mm_s) > robot.max_feed_m_s {
        let message =
            format!("must be at most {}, the fastest feed of {}", robot.max_feed_m_s * 1000.0, robot.name);
        return Err(document.fail_value("limits.max_feed_mm_s", raw.max_feed_mm_s, message));
    }
    Ok(Limits {
        max_feed_m_s: m(raw.max_feed_mm_s),
        max_probe_speed_m_s: m(raw.max_probe_speed_mm_s),
        max_probe_travel_m: m(raw.max_probe_travel_mm),
        max_probe_turn_rad: rad(raw.max_probe_turn_deg),
        max_contact_force_n: raw.max_contact_force_n,
    })
}

/// The way after which a test tells what stays behind, and the needle's way to a stop.
const LEAST_JOG_MM: f64 = 1.0;

/// Servo settings; none may ask for more than the limits allow.
pub(super) fn servo(
    document: &Document,
    raw: &RawServo,
    limits: &RawLimits,
) -> Result<ServoSettings, LoadError> {
    let max_search_force_n = raw.max_search_force_n.unwrap_or(0.75 * limits.max_contact_force_n);
    let bounds = [
        ("feed_mm_s", raw.feed_mm_s, "max_feed_mm_s", limits.max_feed_mm_s),
        ("slide_speed_mm_s", raw.slide_speed_mm_s, "max_probe_speed_mm_s", limits.max_probe_speed_mm_s),
        ("sweep_speed_mm_s", raw.sweep_speed_mm_s, "max_probe_speed_mm_s", limits.max_probe_speed_mm_s),
        ("sweep_reach_mm", raw.sweep_reach_mm, "max_probe_travel_mm", limits.max_probe_travel_mm),
        ("yaw_reach_deg", raw.yaw_reach_deg, "max_probe_turn_deg", limits.max_probe_turn_deg),
        ("max_search_force_n", max_search_force_n, "max_contact_force_n", limits.max_contact_force_n),
    ];
    for (key, value, limit, bound) in bounds {
        if value > bound {
            let message = format!("must be at most limits.{limit} = {bound}");
            return Err(document.fail_value(&format!("servo.{key}"), value, message));
        }
    }
    if (f64::MIN_POSITIVE..LEAST_JOG_MM).contains(&raw.max_jog_mm) {
        let message = format!("must be 0, or at least {LEAST_JOG_MM}: less tells no candidate from another");
        return Err(document.fail_value("servo.max_jog_mm", raw.max_jog_mm, message));
    }
    Ok(ServoSettings {
        feed_m_s: m(raw.feed_mm_s),
        approach_m: m(raw.approach_mm),
        arrived_m: m(raw.arrived_mm),
        depth_margin_m: m(raw.depth_margin_mm),
        lateral_deadband_m: m(raw.lateral_deadband_mm),
        slide_gain_per_s: raw.slide_gain,
        slide_speed_m_s: m(raw.slide_speed_mm_s),
        elevation_gain_per_s: raw.elevation_gain,
        along_gain_per_s: raw.along_gain,
        along_walk_m: m(raw.along_walk_mm),
        tip_size_m: m(raw.tip_size_mm),
        level_noise: raw.level_noise,
        lead_s: raw.lead_ms / 1000.0,
        dither_m: m(raw.dither_mm),
        dither_period_s: raw.dither_period_s,
        search: match raw.search {
            RawSearchPattern::Elevation => SearchPattern::Elevation,
            RawSearchPattern::Yaw => SearchPattern::Yaw,
            RawSearchPattern::ElevationThenYaw => SearchPattern::ElevationThenYaw,
            RawSearchPattern::Spiral => SearchPattern::Spiral,
        },
        look_s: raw.look_s,
        confirm_s: raw.confirm_s,
        crest_levels: raw.crest_levels,
        candidate_reach_m: m(raw.candidate_reach_mm),
        max_jog_m: m(raw.max_jog_mm),
        sweep_speed_m_s: m(raw.sweep_speed_mm_s),
        sweep_reach_m: m(raw.sweep_reach_mm),
        yaw_reach_rad: rad(raw.yaw_reach_deg),
        yaw_speed_rad_s: rad(raw.yaw_speed_deg_s),
        max_search_travel_m: m(raw.max_search_travel_mm),
        max_search_s: raw.max_search_s,
        max_search_force_n,
    })
}

/// The contact controller must aim below the force that ends a run.
pub(super) fn contact_force(document: &Document, force_n: f64, limits: &RawLimits) -> Result<(), LoadError> {
    if force_n >= limits.max_contact_force_n {
        let message = format!("must be below limits.max_contact_force_n = {}", limits.max_contact_force_n);
        return Err(document.fail_value("placement.contact_force_n", force_n, message));
    }
    Ok(())
}

/// Standard deviations of the hidden errors.
pub(super) fn calibration(raw: &RawCalibration) -> CalibrationSpec {
    CalibrationSpec {
        needle_sigma_m: m(raw.needle_mm),
        needle_sigma_rad: rad(raw.needle_deg),
        probe_sigma_m: m(raw.probe_mm),
        probe_sigma_rad: rad(raw.probe_deg),
        robot_sigma_m: m(raw.robot_mm),
        robot_sigma_rad: rad(raw.robot_deg),
        encoder_sigma_rad: rad(raw.encoder_deg),
        encoder_sigma_m: m(raw.encoder_mm),
        click_sigma_px: raw.click_px,
        force_sigma_n: raw.force_n,
    }
}

/// Delays of image and command.
pub(super) fn delays(raw: &RawDelays) -> DelaySpec {
    DelaySpec { image_ticks: ticks_of_ms(raw.image_ms), command_ticks: ticks_of_ms(raw.command_ms) }
}
