use super::named_file;
use super::units::{m, rad, raw_pose, ticks_of_ms};
use super::urdf::{self, ChainError};
use crate::document::Document;
use crate::raw::{RawNeedleRobot, RawOpw, RawRobot};
use crate::source::Source;
use crate::{ArmSpec, LoadError, NeedleRobotSpec, OpwSpec};

/// The arm that `robot.yaml` describes, its URDF beside it.
pub(super) fn arm(document: &Document) -> Result<ArmSpec, LoadError> {
    let raw: RawRobot = document.typed()?;
    let source = Source::read(&named_file(document, "urdf", &raw.urdf)?)?;
    let chain = urdf::check(&source, &raw.base_link, &raw.flange_link).map_err(|error| match error {
        ChainError::Urdf(error) => error,
        ChainError::NoBaseLink(known) => {
            document.fail("base_link", format!("must be a link of {}: {known}", source.path.display()))
        }
        ChainError::NoFlangeLink(known) => {
            document.fail("flange_link", format!("must be a link of {}: {known}", source.path.display()))
        }
    })?;
    for (index, (&(lower, upper), home)) in chain.limits_rad.iter().zip(raw.home_deg).enumerate() {
        if !(lower..=upper).contains(&rad(home)) {
            let (lower, upper) = (lower.to_degrees(), upper.to_degrees());
            let name = &chain.joint_names[index];
            let message = format!("must be in [{lower:.1}, {upper:.1}], the limits of `{name}` in its URDF");
            return Err(document.fail(&format!("home_deg.{index}"), message));
        }
    }
    Ok(ArmSpec {
        name: raw.name,
        urdf: chain.robot,
        base_link: raw.base_link,
        flange_link: raw.flange_link,
        joint_names: chain.joint_names,
        world_from_base: raw_pose(&raw.world_from_base),
        flange_from_probe: raw_pose(&raw.flange_from_probe),
        home_rad: raw.home_deg.map(rad),
        max_acceleration_rad_s2: raw.max_acceleration_rad_s2,
        max_jerk_rad_s3: raw.max_jerk_rad_s3,
        opw: raw.opw.map(|opw| analytic(document, &opw)).transpose()?,
    })
}

fn analytic(document: &Document, raw: &RawOpw) -> Result<OpwSpec, LoadError> {
    if let Some(index) = raw.signs.iter().position(|sign| *sign == 0) {
        return Err(document.fail(&format!("opw.signs.{index}"), "must be 1 or -1"));
    }
    Ok(OpwSpec { lengths_m: raw.lengths_mm.map(m), offsets_rad: raw.offsets_deg.map(rad), signs: raw.signs })
}

/// The robot that feeds the needle.
pub(super) fn needle_robot(document: &Document) -> Result<NeedleRobotSpec, LoadError> {
    let raw: RawNeedleRobot = document.typed()?;
    Ok(NeedleRobotSpec {
        name: raw.name,
        max_feed_m_s: m(raw.max_feed_mm_s),
        max_acceleration_m_s2: m(raw.max_acceleration_mm_s2),
        max_depth_m: m(raw.max_depth_mm),
        watchdog_ticks: ticks_of_ms(raw.watchdog_ms),
    })
}
