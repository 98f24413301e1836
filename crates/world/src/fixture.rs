//! A small scenario built by hand, for tests.
#![allow(dead_code, missing_docs, reason = "shared by unit and integration tests, each of which uses a part")]

use nalgebra::UnitQuaternion;
use sonoloop_scenario::{
    ArmSpec, CalibrationSpec, DelaySpec, HandSpec, InsertionSpec, Material, NeedleRobotSpec, OpwSpec,
    PassageSpec, PhantomSpec, PlacementSpec, Scenario,
};
use sonoloop_types::{
    Acoustics, Effects, ElevationSample, ImageGeometry, Limits, NeedleSpec, Point, Pose, Precision,
    ProbeSpec, Profile, ServoSettings, TrackerSettings, Vector, View,
};

/// KR 6 R900 sixx, figures of ROS-Industrial's public `kuka_kr6_support`; rough collision bodies.
pub fn kuka() -> ArmSpec {
    let joints = [
        ("joint_a1", "base_link", "link_1", "0 0 0.400", "0 0 -1", -170.0, 170.0, 360.0),
        ("joint_a2", "link_1", "link_2", "0.025 0 0", "0 1 0", -190.0, 45.0, 300.0),
        ("joint_a3", "link_2", "link_3", "0.455 0 0", "0 1 0", -120.0, 156.0, 360.0),
        ("joint_a4", "link_3", "link_4", "0 0 0.035", "-1 0 0", -185.0, 185.0, 381.0),
        ("joint_a5", "link_4", "link_5", "0.420 0 0", "0 1 0", -120.0, 120.0, 388.0),
        ("joint_a6", "link_5", "link_6", "0.080 0 0", "-1 0 0", -350.0, 350.0, 615.0f64),
    ];
    let body = |link: &str| match link {
        "base_link" => "<cylinder radius='0.1' length='0.2'/>",
        "link_2" => "<box size='0.45 0.12 0.12'/>",
        "link_4" => "<cylinder radius='0.05' length='0.2'/>",
        _ => "<sphere radius='0.05'/>",
    };
    let place = |link: &str| if link == "link_2" { "0.22 0 0" } else { "0 0 0" };
    let mut xml = String::from("<robot name='kr6'>");
    for link in ["base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "link_6"] {
        xml += &format!(
            "<link name='{link}'><collision><origin xyz='{}' rpy='0 0 0'/><geometry>{}</geometry></collision></link>",
            place(link),
            body(link)
        );
    }
    xml += "<link name='tool0'/>";
    for (name, parent, child, origin, axis, lower, upper, speed) in joints {
        xml += &format!(
            "<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='{origin}' rpy='0 0 0'/><axis xyz='{axis}'/>\
             <limit lower='{}' upper='{}' effort='0' velocity='{}'/></joint>",
            f64::to_radians(lower),
            f64::to_radians(upper),
            speed.to_radians()
        );
    }
    xml += &format!(
        "<joint name='joint_a6-tool0' type='fixed'><parent link='link_6'/><child link='tool0'/>\
         <origin xyz='0 0 0' rpy='0 {} 0'/></joint></robot>",
        std::f64::consts::FRAC_PI_2
    );
    ArmSpec {
        name: "KUKA KR 6 R900 sixx".into(),
        urdf: urdf_rs::read_from_string(&xml).expect("the fixture's URDF parses"),
        base_link: "base_link".into(),
        flange_link: "tool0".into(),
        joint_names: std::array::from_fn(|i| format!("joint_a{}", i + 1)),
        world_from_base: Pose::translation(-0.55, 0.0, -0.06),
        flange_from_probe: Pose::translation(0.0, 0.0, 0.15),
        home_rad: [0.0, -1.9, 1.9, 0.0, 1.57, 0.0],
        max_acceleration_rad_s2: 20.0,
        max_jerk_rad_s3: 400.0,
        opw: Some(OpwSpec {
            lengths_m: [0.025, -0.035, 0.0, 0.400, 0.455, 0.420, 0.080],
            offsets_rad: [0.0, -std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0, 0.0],
            signs: [-1, 1, 1, -1, 1, -1],
        }),
    }
}

/// `scenarios/lateral_plain.yaml` with an arm of `robots/`.
pub fn boxed(arm: &str) -> Scenario {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/lateral_plain.yaml");
    let set = vec![format!("robot=../robots/{arm}/robot.yaml")];
    let options = sonoloop_scenario::LoadOptions { set, ..Default::default() };
    sonoloop_scenario::load(&file, &options).expect("the files in the box load")
}

/// An arm of `robots/`.
pub fn in_the_box(name: &str) -> ArmSpec {
    boxed(name).arm
}

pub fn probe() -> ProbeSpec {
    let table = [(0.008, 2.02), (0.012, 0.9), (0.018, 0.75), (0.025, 1.09), (0.030, 1.46), (0.040, 2.77)];
    ProbeSpec {
        name: "linear 192".into(),
        elements: 192,
        pitch_m: 2e-4,
        centre_frequency_hz: 7.5e6,
        fractional_bandwidth: 0.6,
        f_number: 2.0,
        transmit_focus_m: None,
        element_height_m: 5e-3,
        elevation_focus_m: 20e-3,
        elevation: table
            .iter()
            .map(|&(depth_m, width_mm)| ElevationSample { depth_m, width_m: width_mm * 1e-3 })
            .collect(),
        assumed_sound_speed_m_s: 1540.0,
        tgc_db_cm_mhz: 0.5,
        tgc_sliders_db: Vec::new(),
        dynamic_range_db: 60.0,
        speckle_level_db: 30.0,
        noise_level_db: -40.0,
        geometry: ImageGeometry::default(),
        effects: Effects::default(),
        precision: Precision::default(),
    }
}

pub fn needle() -> NeedleSpec {
    NeedleSpec {
        name: "22G".into(),
        outer_diameter_m: 0.718e-3,
        length_m: 0.150,
        bevel_rad: 20f64.to_radians(),
        curvature_per_m: 0.5,
        specular_level_db: 40.0,
        rough_level_db: 15.0,
        tip_level_db: 25.0,
    }
}

/// Joints of the robot in the box, with all the room that a test may ask for and without bodies.
pub fn needle_robot() -> NeedleRobotSpec {
    let xml = "<robot name='needle robot'>\
        <link name='base'/><link name='x'/><link name='y'/><link name='z'/><link name='yaw'/><link name='hub'/>\
        <joint name='x' type='prismatic'><parent link='base'/><child link='x'/><axis xyz='1 0 0'/>\
        <limit lower='-9' upper='9' effort='0' velocity='1'/></joint>\
        <joint name='y' type='prismatic'><parent link='x'/><child link='y'/><axis xyz='0 1 0'/>\
        <limit lower='-9' upper='9' effort='0' velocity='1'/></joint>\
        <joint name='z' type='prismatic'><parent link='y'/><child link='z'/><axis xyz='0 0 1'/>\
        <limit lower='-9' upper='9' effort='0' velocity='1'/></joint>\
        <joint name='yaw' type='revolute'><parent link='z'/><child link='yaw'/><axis xyz='0 0 1'/>\
        <limit lower='-4' upper='4' effort='0' velocity='1'/></joint>\
        <joint name='pitch' type='revolute'><parent link='yaw'/><child link='hub'/><axis xyz='0 1 0'/>\
        <limit lower='-4' upper='4' effort='0' velocity='1'/></joint></robot>";
    NeedleRobotSpec {
        name: "needle robot".into(),
        urdf: urdf_rs::read_from_string(xml).expect("the fixture's URDF parses"),
        base_link: "base".into(),
        hub_link: "hub".into(),
        joint_names: ["x", "y", "z", "yaw", "pitch"].map(Into::into),
        world_from_base: Pose::translation(-0.3, 0.0, 0.0),
        max_feed_m_s: 0.02,
        max_acceleration_m_s2: 0.1,
        max_depth_m: 0.12,
        max_force_n: 8.0,
        watchdog_ticks: 200,
    }
}

pub fn hand() -> HandSpec {
    HandSpec {
        speed_m_s: [6e-3, 14e-3],
        pause_every_s: [1.5, 4.0],
        pause_s: [0.2, 0.8],
        tremor_m: 2e-4,
        swing_m: 1e-3,
        reaction_ticks: [300, 600],
    }
}

pub fn passage() -> PassageSpec {
    PassageSpec {
        friction_n_m: 6.0,
        cutting_n: 0.15,
        puncture_n: 0.4,
        stiffness_n_m: 100.0,
        stiffening_n_m2: 6e4,
        drag_decay_m: 5e-3,
        bending: 1.0,
    }
}

pub fn phantom() -> PhantomSpec {
    PhantomSpec {
        name: "gelatin".into(),
        size_m: [0.2, 0.1, 0.06],
        background: 0,
        materials: vec![Material {
            name: "gelatin".into(),
            acoustics: Acoustics {
                sound_speed_m_s: 1540.0,
                attenuation_db_cm_mhz: 0.5,
                attenuation_exponent: 1.0,
                density_kg_m3: 1050.0,
                backscatter_db: Some(0.0),
            },
            youngs_modulus_pa: Some(30e3),
            needle: Some(passage()),
        }],
        inclusions: Vec::new(),
    }
}

pub fn calibration() -> CalibrationSpec {
    CalibrationSpec {
        needle_sigma_m: 2e-3,
        needle_sigma_rad: 1f64.to_radians(),
        probe_sigma_m: 1e-3,
        probe_sigma_rad: 0.5f64.to_radians(),
        robot_sigma_m: 0.0,
        robot_sigma_rad: 0.0,
        encoder_sigma_rad: 0.0,
        encoder_sigma_m: 0.0,
        click_sigma_px: 1.0,
        force_sigma_n: 0.05,
    }
}

pub fn placement() -> PlacementSpec {
    PlacementSpec {
        tip_lateral_m: -5e-3,
        contact_force_n: 3.0,
        yaw_rad: 0.0,
        tilt_rad: 0.0,
        alignment_sigma_m: 1e-4,
        alignment_sigma_rad: 2e-3,
    }
}

/// Lateral view, 35° under the surface along +x, from 20 to 55 mm of depth.
pub fn scenario() -> Scenario {
    let angle = 35f64.to_radians();
    Scenario {
        name: "fixture".into(),
        description: "built by hand".into(),
        source: "fixture.yaml".into(),
        seed: 1,
        duration_ticks: 10_000,
        images: None,
        image_period_ticks: 40,
        view: View::Lateral,
        arm: kuka(),
        needle_robot: needle_robot(),
        probe: probe(),
        needle: needle(),
        phantom: phantom(),
        insertion: InsertionSpec {
            entry_in_world: Point::new(-0.04, 0.0, 0.0),
            axis_in_world: Vector::new(angle.cos(), 0.0, -angle.sin()),
            bevel_roll_rad: 0.0,
            start_depth_m: 0.02,
            target_depth_m: 0.055,
            target_tolerance_m: 2e-3,
            hand: None,
        },
        placement: placement(),
        calibration: calibration(),
        limits: Limits {
            max_feed_m_s: 0.02,
            max_probe_speed_m_s: 0.05,
            max_probe_travel_m: 0.08,
            max_probe_turn_rad: 0.6,
            max_contact_force_n: 10.0,
        },
        tracker: TrackerSettings::profile(Profile::Robust, 20),
        servo: ServoSettings {
            feed_m_s: 0.01,
            approach_m: 2e-3,
            lateral_deadband_m: 5e-3,
            slide_speed_m_s: 0.02,
            elevation_gain_per_s: 0.0,
            dither_m: 0.0,
            dither_period_s: 1.0,
            sweep_speed_m_s: 5e-3,
            sweep_reach_m: 7e-3,
            yaw_reach_rad: 0.15,
            yaw_speed_rad_s: 0.1,
            max_search_travel_m: 0.1,
            max_search_s: 20.0,
            ..ServoSettings::default()
        },
        delays: DelaySpec { image_ticks: 40, command_ticks: 10 },
        disturbances: Vec::new(),
        expect: Vec::new(),
        resolved_yaml: String::new(),
    }
}

/// The needle crosses the picture.
pub fn transverse() -> Scenario {
    let mut scenario = scenario();
    scenario.view = View::Transverse;
    scenario.placement.tip_lateral_m = 0.0;
    scenario
}

/// Probe slip of `y_m` out of plane.
pub fn slip(y_m: f64) -> Pose {
    Pose::from_parts(nalgebra::Translation3::new(0.0, y_m, 0.0), UnitQuaternion::identity())
}
