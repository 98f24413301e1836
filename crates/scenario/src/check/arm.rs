use super::named_file;
use super::units::{m, rad, raw_pose, ticks_of_ms};
use super::urdf::{self, Chain, ChainError, Moves};
use crate::document::Document;
use crate::raw::{RawNeedleRobot, RawOpw, RawRobot};
use crate::source::Source;
use crate::{ArmSpec, LoadError, NeedleRobotSpec, OpwSpec};

/// The arm that `robot.yaml` describes, its URDF beside it.
pub(super) fn arm(document: &Document) -> Result<ArmSpec, LoadError> {
    let raw: RawRobot = document.typed()?;
    let chain =
        chain(document, &raw.urdf, &raw.base_link, ("flange_link", &raw.flange_link), [Moves::Turns; 6])?;
    for (index, (&(lower, upper), home)) in chain.limits.iter().zip(raw.home_deg).enumerate() {
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

/// The URDF beside the robot's file; `tip` is the key that names the last link, and that link.
fn chain<const N: usize>(
    document: &Document,
    urdf: &str,
    base_link: &str,
    (tip_key, tip_link): (&str, &str),
    moves: [Moves; N],
) -> Result<Chain<N>, LoadError> {
    let source = Source::read(&named_file(document, "urdf", urdf)?)?;
    let no_link = |key: &str, known: String| {
        document.fail(key, format!("must be a link of {}: {known}", source.path.display()))
    };
    urdf::check(&source, base_link, tip_link, moves).map_err(|error| match error {
        ChainError::Urdf(error) => error,
        ChainError::NoBaseLink(known) => no_link("base_link", known),
        ChainError::NoTipLink(known) => no_link(tip_key, known),
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
    let moves = [Moves::Slides, Moves::Slides, Moves::Slides, Moves::Turns, Moves::Turns];
    let chain = chain(document, &raw.urdf, &raw.base_link, ("hub_link", &raw.hub_link), moves)?;
    Ok(NeedleRobotSpec {
        name: raw.name,
        urdf: chain.robot,
        base_link: raw.base_link,
        hub_link: raw.hub_link,
        joint_names: chain.joint_names,
        world_from_base: raw_pose(&raw.world_from_base),
        max_feed_m_s: m(raw.max_feed_mm_s),
        max_acceleration_m_s2: m(raw.max_acceleration_mm_s2),
        max_depth_m: m(raw.max_depth_mm),
        max_force_n: raw.max_force_n,
        watchdog_ticks: ticks_of_ms(raw.watchdog_ms),
    })
}
