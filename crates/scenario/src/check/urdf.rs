//! A URDF file → a robot with exactly the limited joints that are asked for between two of its links.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use urdf_rs::{Joint, JointType, Robot};

use crate::LoadError;
use crate::source::Source;

/// A robot description whose chain is sound. Meshes are not opened, so a missing one is no error.
pub(super) struct Chain<const N: usize> {
    pub robot: Robot,
    /// The actuated joints from base to tip.
    pub joint_names: [String; N],
    /// Their (lower, upper) limits, radians or metres.
    pub limits: [(f64, f64); N],
}

/// How an actuated joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moves {
    /// Turns: revolute, or continuous, which counts as limited to one turn either way.
    Turns,
    /// Slides: prismatic.
    Slides,
}

/// Which of the two link names is not in the URDF; the robot's own file names them.
pub(super) enum ChainError {
    /// The URDF is wrong.
    Urdf(LoadError),
    /// The robot's file names a base link that is not there.
    NoBaseLink(String),
    /// The robot's file names a link at the tip that is not there.
    NoTipLink(String),
}

impl From<LoadError> for ChainError {
    fn from(error: LoadError) -> Self {
        Self::Urdf(error)
    }
}

/// Reads and checks; `moves` says what the joints from base to tip do, in that order.
pub(super) fn check<const N: usize>(
    source: &Source,
    base_link: &str,
    tip_link: &str,
    moves: [Moves; N],
) -> Result<Chain<N>, ChainError> {
    let mut robot = urdf_rs::read_from_string(&source.text)
        .map_err(|error| LoadError::new(&source.path, format!("is not a URDF: {}", one_line(&error))))?;
    // The simulator's joints all have limits; a turn either way is more than any cable allows.
    for joint in robot.joints.iter_mut().filter(|joint| joint.joint_type == JointType::Continuous) {
        joint.joint_type = JointType::Revolute;
        (joint.limit.lower, joint.limit.upper) = (-TAU, TAU);
    }
    let links = link_names(source, &robot)?;
    let known = || links.iter().copied().collect::<Vec<_>>().join(", ");
    if !links.contains(base_link) {
        return Err(ChainError::NoBaseLink(known()));
    }
    if !links.contains(tip_link) {
        return Err(ChainError::NoTipLink(known()));
    }
    joints_are_tied(source, &robot, &links)?;
    let mut actuated = Vec::new();
    for joint in walk(source, &robot, base_link, tip_link)? {
        origin_is_finite(source, joint)?;
        if joint.joint_type != JointType::Fixed {
            actuated.push(joint);
        }
    }
    let count = actuated.len();
    let joints: [&Joint; N] = actuated.try_into().map_err(|_| {
        let message = format!(
            "has {count} actuated joints between `{base_link}` and `{tip_link}`, must have exactly {N}"
        );
        LoadError::new(&source.path, message)
    })?;
    for (index, (joint, moves)) in joints.iter().zip(moves).enumerate() {
        let needed = match moves {
            Moves::Turns => JointType::Revolute,
            Moves::Slides => JointType::Prismatic,
        };
        if joint.joint_type != needed {
            let message = format!(
                "is {}; joint {} of the {N} between `{base_link}` and `{tip_link}` must be {}",
                kind(&joint.joint_type),
                index + 1,
                kind(&needed)
            );
            return Err(at(source, "joint", &joint.name, message).into());
        }
        joint_is_sound(source, joint, moves)?;
    }
    let joint_names = joints.map(|joint| joint.name.clone());
    let limits = joints.map(|joint| (joint.limit.lower, joint.limit.upper));
    Ok(Chain { joint_names, limits, robot })
}

fn kind(of: &JointType) -> String {
    format!("{of:?}").to_lowercase()
}

fn link_names<'a>(source: &Source, robot: &'a Robot) -> Result<BTreeSet<&'a str>, LoadError> {
    let mut links = BTreeSet::new();
    for link in &robot.links {
        if !links.insert(link.name.as_str()) {
            return Err(at(source, "link", &link.name, "is there twice".to_owned()));
        }
    }
    Ok(links)
}

/// Every joint ties two links of the file, none of them to itself, and no link hangs on two joints.
fn joints_are_tied(source: &Source, robot: &Robot, links: &BTreeSet<&str>) -> Result<(), LoadError> {
    let mut names = BTreeSet::new();
    let mut children = BTreeSet::new();
    for joint in &robot.joints {
        let fail = |message: String| Err(at(source, "joint", &joint.name, message));
        if !names.insert(&joint.name) {
            return fail("is there twice".to_owned());
        }
        for (role, link) in [("parent", &joint.parent.link), ("child", &joint.child.link)] {
            if !links.contains(link.as_str()) {
                return fail(format!("dangles: its {role} link `{link}` is not in the file"));
            }
        }
        if joint.parent.link == joint.child.link {
            return fail(format!("ties the link `{}` to itself", joint.child.link));
        }
        if !children.insert(&joint.child.link) {
            return fail(format!("is the second joint that moves the link `{}`", joint.child.link));
        }
    }
    Ok(())
}

/// The joints from base to tip, found from the tip upwards.
fn walk<'a>(
    source: &Source,
    robot: &'a Robot,
    base_link: &str,
    tip_link: &str,
) -> Result<Vec<&'a Joint>, LoadError> {
    let mut chain = Vec::new();
    let mut link = tip_link;
    while link != base_link {
        let Some(joint) = robot.joints.iter().find(|joint| joint.child.link == link) else {
            let message = format!(
                "no chain of joints leads from `{base_link}` to `{tip_link}`: no joint moves `{link}`"
            );
            return Err(LoadError::new(&source.path, message));
        };
        if chain.len() == robot.joints.len() {
            let message =
                format!("no chain of joints leads from `{base_link}` to `{tip_link}`: they form a loop");
            return Err(at(source, "joint", &joint.name, message));
        }
        chain.push(joint);
        link = &joint.parent.link;
    }
    chain.reverse();
    Ok(chain)
}

fn origin_is_finite(source: &Source, joint: &Joint) -> Result<(), LoadError> {
    let numbers = joint.origin.xyz.0.iter().chain(&joint.origin.rpy.0).chain(&joint.axis.xyz.0);
    if numbers.into_iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    Err(at(source, "joint", &joint.name, "has an origin or axis that is not finite".to_owned()))
}

fn joint_is_sound(source: &Source, joint: &Joint, moves: Moves) -> Result<(), LoadError> {
    let fail = |message: String| Err(at(source, "joint", &joint.name, message));
    let unit = match moves {
        Moves::Turns => "rad",
        Moves::Slides => "m",
    };
    if joint.mimic.is_some() {
        return fail("mimics another joint; every joint to the tip must be driven".to_owned());
    }
    if joint.axis.xyz.0.iter().map(|value| value * value).sum::<f64>() < 1e-12 {
        return fail("has the axis 0 0 0".to_owned());
    }
    let limit = &joint.limit;
    if !(limit.lower.is_finite() && limit.upper.is_finite() && limit.lower < limit.upper) {
        let message = format!(
            "has limits lower = {}, upper = {}; must be finite and lower < upper ({unit})",
            limit.lower, limit.upper
        );
        return fail(message);
    }
    if !(limit.velocity.is_finite() && limit.velocity > 0.0) {
        return fail(format!("has limit velocity = {}; must be finite and > 0 ({unit}/s)", limit.velocity));
    }
    Ok(())
}

/// A problem with a named element of the URDF, pointing at its name.
fn at(source: &Source, element: &str, name: &str, message: String) -> LoadError {
    let error = LoadError::new(&source.path, message).with_key(&format!("{element} `{name}`"), None);
    match find(&source.text, element, name) {
        Some((offset, len)) => error.with_place(&source.text, offset, len),
        None => error,
    }
}

/// Where `<element … name="name"` stands. A plain search: the text parsed before.
fn find(text: &str, element: &str, name: &str) -> Option<(usize, usize)> {
    let open = format!("<{element}");
    text.match_indices(&open).find_map(|(start, _)| {
        let tag = &text[start..start + text[start..].find('>')?];
        let quoted = [format!("name=\"{name}\""), format!("name='{name}'")];
        let at =
            quoted.iter().find_map(|quoted| tag.find(quoted).map(|offset| (start + offset, quoted.len())))?;
        tag[open.len()..].starts_with(char::is_whitespace).then_some(at)
    })
}

fn one_line(error: &urdf_rs::UrdfError) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
