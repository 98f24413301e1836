//! A URDF file → a robot with exactly six limited revolute joints between two of its links.

use std::collections::BTreeSet;

use urdf_rs::{Joint, JointType, Robot};

use crate::LoadError;
use crate::source::Source;

/// A robot description whose chain is sound.
pub(super) struct Chain {
    pub robot: Robot,
    /// The six actuated joints from base to flange.
    pub joint_names: [String; 6],
    /// Their (lower, upper) limits in radians.
    pub limits_rad: [(f64, f64); 6],
}

/// Which of the two link names is not in the URDF; the robot's own file names them.
pub(super) enum ChainError {
    /// The URDF is wrong.
    Urdf(LoadError),
    /// The robot's file names a base link that is not there.
    NoBaseLink(String),
    /// The robot's file names a flange link that is not there.
    NoFlangeLink(String),
}

impl From<LoadError> for ChainError {
    fn from(error: LoadError) -> Self {
        Self::Urdf(error)
    }
}

pub(super) fn check(source: &Source, base_link: &str, flange_link: &str) -> Result<Chain, ChainError> {
    let robot = urdf_rs::read_from_string(&source.text)
        .map_err(|error| LoadError::new(&source.path, format!("is not a URDF: {}", one_line(&error))))?;
    let links = link_names(source, &robot)?;
    let known = || links.iter().copied().collect::<Vec<_>>().join(", ");
    if !links.contains(base_link) {
        return Err(ChainError::NoBaseLink(known()));
    }
    if !links.contains(flange_link) {
        return Err(ChainError::NoFlangeLink(known()));
    }
    joints_are_tied(source, &robot, &links)?;
    let chain = walk(source, &robot, base_link, flange_link)?;
    let mut actuated = Vec::new();
    for joint in chain {
        joint_is_sound(source, joint)?;
        if joint.joint_type != JointType::Fixed {
            actuated.push(joint);
        }
    }
    let count = actuated.len();
    let six: [&Joint; 6] = actuated.try_into().map_err(|_| {
        let message = format!(
            "has {count} actuated joints between `{base_link}` and `{flange_link}`, must have exactly 6"
        );
        LoadError::new(&source.path, message)
    })?;
    let joint_names = six.map(|joint| joint.name.clone());
    let limits_rad = six.map(|joint| (joint.limit.lower, joint.limit.upper));
    Ok(Chain { joint_names, limits_rad, robot })
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

/// The joints from base to flange, found from the flange upwards.
fn walk<'a>(
    source: &Source,
    robot: &'a Robot,
    base_link: &str,
    flange_link: &str,
) -> Result<Vec<&'a Joint>, LoadError> {
    let mut chain = Vec::new();
    let mut link = flange_link;
    while link != base_link {
        let joint = robot.joints.iter().find(|joint| joint.child.link == link);
        // More steps than joints means that the links form a ring.
        let Some(joint) = joint.filter(|_| chain.len() < robot.joints.len()) else {
            let message = format!("no chain of joints leads from `{base_link}` to `{flange_link}`");
            return Err(LoadError::new(&source.path, message));
        };
        chain.push(joint);
        link = &joint.parent.link;
    }
    chain.reverse();
    Ok(chain)
}

fn joint_is_sound(source: &Source, joint: &Joint) -> Result<(), LoadError> {
    let fail = |message: String| Err(at(source, "joint", &joint.name, message));
    let numbers = joint.origin.xyz.0.iter().chain(&joint.origin.rpy.0).chain(&joint.axis.xyz.0);
    if !numbers.into_iter().all(|value| value.is_finite()) {
        return fail("has an origin or axis that is not finite".to_owned());
    }
    match joint.joint_type {
        JointType::Fixed => return Ok(()),
        JointType::Revolute => {}
        ref other => {
            let kind = format!("{other:?}").to_lowercase();
            return fail(format!("is {kind}; only revolute and fixed joints may lead to the flange"));
        }
    }
    if joint.mimic.is_some() {
        return fail("mimics another joint; every joint to the flange must be driven".to_owned());
    }
    if joint.axis.xyz.0.iter().map(|value| value * value).sum::<f64>() < 1e-12 {
        return fail("has the axis 0 0 0".to_owned());
    }
    let limit = &joint.limit;
    if !(limit.lower.is_finite() && limit.upper.is_finite() && limit.lower < limit.upper) {
        let message = format!(
            "has limits lower = {}, upper = {}; must be finite and lower < upper (rad)",
            limit.lower, limit.upper
        );
        return fail(message);
    }
    if !(limit.velocity.is_finite() && limit.velocity > 0.0) {
        return fail(format!("has limit velocity = {}; must be finite and > 0 (rad/s)", limit.velocity));
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
