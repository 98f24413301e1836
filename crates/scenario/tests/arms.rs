//! The arms in the box: their URDF against published kinematics, and what they reach.

mod common;

use nalgebra::{
    Isometry3, Matrix6, Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3, Vector6,
};
use rs_opw_kinematics::kinematic_traits::Kinematics;
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use sonoloop_scenario::{ArmSpec, LoadOptions, load};

type Pose = Isometry3<f64>;

fn arm(name: &str) -> ArmSpec {
    let set = vec![format!("robot=../robots/{name}/robot.yaml")];
    let options = LoadOptions { set, ..LoadOptions::default() };
    load(&common::root().join("scenarios/lateral_plain.yaml"), &options).unwrap().arm
}

fn arms() -> [ArmSpec; 2] {
    ["kuka_kr6_r900", "ur5e"].map(arm)
}

/// A lattice of joint angles over the whole range (multiples of irrational shares).
fn lattice(arm: &ArmSpec, step: u32) -> [f64; 6] {
    const SHARES: [f64; 6] = [0.618_034, 0.754_878, 0.569_840, 0.819_173, 0.671_044, 0.856_675];
    let limits = limits(arm);
    std::array::from_fn(|i| {
        let share = (f64::from(step) * SHARES[i]).fract();
        limits[i].0 + share * (limits[i].1 - limits[i].0)
    })
}

/// Every fixed and moving step from base to flange.
fn base_from_flange(arm: &ArmSpec, q: &[f64; 6]) -> Pose {
    let mut steps = Vec::new();
    let mut link = arm.flange_link.clone();
    while link != arm.base_link {
        let joint = arm.urdf.joints.iter().find(|joint| joint.child.link == link).unwrap();
        let [x, y, z] = *joint.origin.xyz;
        let [roll, pitch, yaw] = *joint.origin.rpy;
        let origin =
            Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw));
        let turn = match arm.joint_names.iter().position(|name| *name == joint.name) {
            Some(index) => {
                let axis = Unit::new_normalize(Vector3::from(*joint.axis.xyz));
                UnitQuaternion::from_axis_angle(&axis, q[index])
            }
            None => UnitQuaternion::identity(),
        };
        steps.push(origin * turn);
        link.clone_from(&joint.parent.link);
    }
    steps.iter().rev().fold(Pose::identity(), |pose, step| pose * step)
}

fn limits(arm: &ArmSpec) -> [(f64, f64); 6] {
    std::array::from_fn(|index| {
        let joint = arm.urdf.joints.iter().find(|joint| joint.name == arm.joint_names[index]).unwrap();
        (joint.limit.lower, joint.limit.upper)
    })
}

fn opw(arm: &ArmSpec) -> OPWKinematics {
    let spec = arm.opw.unwrap();
    let [a1, a2, b, c1, c2, c3, c4] = spec.lengths_m;
    let (offsets, sign_corrections) = (spec.offsets_rad, spec.signs);
    OPWKinematics::new(Parameters { a1, a2, b, c1, c2, c3, c4, offsets, sign_corrections, dof: 6 })
}

#[test]
fn truth_urdf_and_analytic_kinematics_agree() {
    let arm = arm("kuka_kr6_r900");
    let opw = opw(&arm);
    for step in 0..200 {
        let q = lattice(&arm, step);
        let ours = base_from_flange(&arm, &q);
        let theirs = opw.forward(&q);
        let r = theirs.rotation;
        let theirs = Pose::from_parts(
            Translation3::new(theirs.translation.x, theirs.translation.y, theirs.translation.z),
            UnitQuaternion::from_quaternion(Quaternion::new(r.w, r.x, r.y, r.z)),
        );
        let apart = ours.inv_mul(&theirs);
        assert!(apart.translation.vector.norm() < 1e-9, "step {step}: {ours} {theirs}");
        assert!(apart.rotation.angle() < 1e-7, "step {step}: {ours} {theirs}");
    }
}

/// Universal Robots, "Parameters for calculations of kinematics and dynamics", article 45257: a, d in metres and α in
/// quarter turns, row by row; the step of a row is Rz(θ)·Tz(d)·Tx(a)·Rx(α).
const UR5E: [(f64, f64, f64); 6] = [
    (0.0, 0.1625, 1.0),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, 1.0),
    (0.0, 0.0997, -1.0),
    (0.0, 0.0996, 0.0),
];

#[test]
fn truth_ur5e_is_its_makers_denavit_hartenberg_table() {
    let arm = arm("ur5e");
    for step in 0..200 {
        let q = lattice(&arm, step);
        let theirs =
            UR5E.iter().zip(q).fold(nalgebra::Matrix4::identity(), |pose, (&(a, d, turns), theta)| {
                let (s, c) = theta.sin_cos();
                let (sa, ca) = (turns * std::f64::consts::FRAC_PI_2).sin_cos();
                #[rustfmt::skip]
            let row = nalgebra::Matrix4::new(
                c, -s * ca, s * sa, a * c,
                s, c * ca, -c * sa, a * s,
                0.0, sa, ca, d,
                0.0, 0.0, 0.0, 1.0,
            );
                pose * row
            });
        let ours = base_from_flange(&arm, &q).to_homogeneous();
        assert!((ours - theirs).amax() < 1e-12, "step {step}: {ours} {theirs}");
    }
    // At zero angles by hand: stretched along −x, the wrist's offsets along −y and down.
    let stretched = base_from_flange(&arm, &[0.0; 6]).translation.vector;
    let by_hand = Vector3::new(-0.425 - 0.3922, -0.1333 - 0.0996, 0.1625 - 0.0997);
    assert!((stretched - by_hand).norm() < 1e-12, "{stretched}");
}

#[test]
fn truth_ur5e_has_no_spherical_wrist() {
    // The axes of the last three joints of a spherical wrist meet in one point; here 4 and 6 miss one another by d5.
    let arm = arm("ur5e");
    assert!(arm.opw.is_none());
    let axis_of = |name: &str| {
        let to_joint = ArmSpec { flange_link: name.to_owned(), ..arm.clone() };
        let pose = base_from_flange(&to_joint, &[0.3, -1.0, 1.2, 0.4, -1.1, 0.7]);
        (pose.translation.vector, pose.rotation * Vector3::z())
    };
    let ((p4, z4), (p6, z6)) = (axis_of("wrist_1_link"), axis_of("wrist_3_link"));
    let normal = z4.cross(&z6).normalize();
    assert!((normal.dot(&(p6 - p4)).abs() - 0.0997).abs() < 1e-12);
}

fn world_from_probe(arm: &ArmSpec, q: &[f64; 6]) -> Pose {
    arm.world_from_base * base_from_flange(arm, q) * arm.flange_from_probe
}

/// The probe on the phantom's top face, looking down, turned about the vertical.
fn looking_down(x: f64, y: f64, yaw: f64) -> Pose {
    let down =
        Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)));
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        * UnitQuaternion::from_rotation_matrix(&down);
    Pose::from_parts(Translation3::new(x, y, 0.0), rotation)
}

/// Newton steps with a finite-difference Jacobian, damped: the plainest inverse kinematics.
fn solve(arm: &ArmSpec, target: &Pose, start: [f64; 6]) -> Option<[f64; 6]> {
    let error = |q: &[f64; 6]| -> Vector6<f64> {
        let pose = world_from_probe(arm, q);
        let moved = target.translation.vector - pose.translation.vector;
        let turned = (target.rotation * pose.rotation.inverse()).scaled_axis();
        Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z)
    };
    let mut q = start;
    for _ in 0..300 {
        let e = error(&q);
        if e.norm() < 1e-9 {
            return Some(q);
        }
        let mut jacobian = Matrix6::zeros();
        for i in 0..6 {
            let mut moved = q;
            moved[i] += 1e-6;
            jacobian.set_column(i, &((e - error(&moved)) / 1e-6));
        }
        let normal = jacobian.transpose() * jacobian + Matrix6::identity() * 1e-8;
        let mut step = normal.lu().solve(&(jacobian.transpose() * e))?;
        step *= (0.2 / step.amax()).min(1.0);
        q = std::array::from_fn(|i| q[i] + step[i]);
    }
    None
}

/// Degrees between a solution and its nearest joint limit.
fn margin_deg(arm: &ArmSpec, q: &[f64; 6]) -> f64 {
    let limits = limits(arm);
    (0..6).map(|i| (q[i] - limits[i].0).min(limits[i].1 - q[i]).to_degrees()).fold(f64::INFINITY, f64::min)
}

#[test]
fn home_is_the_probe_on_the_middle_of_the_phantom() {
    for arm in arms() {
        let apart = looking_down(0.0, 0.0, 0.0).inv_mul(&world_from_probe(&arm, &arm.home_rad));
        let solution =
            solve(&arm, &looking_down(0.0, 0.0, 0.0), arm.home_rad).map(|q| q.map(f64::to_degrees));
        assert!(apart.translation.vector.norm() < 2e-3, "{apart} {solution:?}");
        assert!(apart.rotation.angle() < 0.5_f64.to_radians(), "{apart} {solution:?}");
    }
}

#[test]
fn the_probe_reaches_all_of_the_phantoms_middle_either_way() {
    for arm in arms() {
        let mut least = f64::INFINITY;
        for yaw in [0.0_f64, 90.0] {
            for x in [-80.0, -40.0, 0.0, 40.0, 80.0] {
                for y in [-40.0, 0.0, 40.0] {
                    let target = looking_down(x / 1000.0, y / 1000.0, yaw.to_radians());
                    let q = solve(&arm, &target, arm.home_rad)
                        .unwrap_or_else(|| panic!("{}: no way to {target}", arm.name));
                    let margin = margin_deg(&arm, &q);
                    assert!(margin > 20.0, "{margin}° at {x} {y} {yaw}: {:?}", q.map(f64::to_degrees));
                    // Either wrist is singular where joint 5 is straight.
                    assert!(q[4].to_degrees().abs() > 20.0, "{:?}", q.map(f64::to_degrees));
                    least = least.min(margin);
                }
            }
        }
        println!("{}: least joint margin {least:.1}°", arm.name);
    }
}
