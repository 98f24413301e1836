//! Errors that are drawn from the seed and told to nobody.
//!
//! Every error is a Gaussian cut off at two standard deviations, so that no seed is absurd (the standard
//! deviation that remains is 0.88 of the one named). The error of the needle's entry is drawn again while
//! it is shorter than one sigma: dead reckoning from the nominal needle must never be right by luck.

use nalgebra::UnitQuaternion;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use sonoloop_scenario::{CalibrationSpec, PlacementSpec};
use sonoloop_types::{Pose, Vector};

/// One stream of the generator per purpose: a draw added to one purpose moves no other.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    NeedleEntry = 0x5757_0001,
    NeedleAxis,
    Mount,
    Alignment,
    Click,
    Force,
    RobotToRobot,
    Encoders,
    Drops,
    Garbage,
    Hand,
    Reaction,
}

/// Random words set aside for an image: a truncated draw takes two, seldom four.
const WORDS_PER_IMAGE: u128 = 256;

/// What each run draws.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hidden {
    /// True entry minus nominal, world frame.
    pub entry_error_in_world: Vector,
    /// Turns the nominal axis into the true one, world frame.
    pub axis_error: UnitQuaternion<f64>,
    /// Probe where it is thought to be from probe where it is: true mount = nominal · this.
    pub nominal_from_true_probe: Pose,
    /// Needle robot's base where it is thought to be from where it is, in its own frame.
    pub nominal_from_true_needle_base: Pose,
    /// Operator's misalignment of plane and tip.
    pub alignment_m: f64,
    /// Operator's misalignment in yaw.
    pub alignment_rad: f64,
    /// Operator's click minus the true tip in the picture.
    pub click_error_px: [f64; 2],
}

impl Hidden {
    pub(crate) fn draw(seed: u64, calibration: &CalibrationSpec, placement: &PlacementSpec) -> Self {
        let mut entry = generator(seed, Stream::NeedleEntry);
        let sigma = calibration.needle_sigma_m;
        let entry_error_in_world = loop {
            let error = vector(&mut entry, sigma);
            if error.norm() >= sigma {
                break error;
            }
        };
        let mut axis = generator(seed, Stream::NeedleAxis);
        let mut mount = generator(seed, Stream::Mount);
        let mut alignment = generator(seed, Stream::Alignment);
        let mut click = generator(seed, Stream::Click);
        let mut robot = generator(seed, Stream::RobotToRobot);
        Self {
            entry_error_in_world,
            axis_error: UnitQuaternion::from_scaled_axis(vector(&mut axis, calibration.needle_sigma_rad)),
            nominal_from_true_probe: pose(&mut mount, calibration.probe_sigma_m, calibration.probe_sigma_rad),
            nominal_from_true_needle_base: pose(
                &mut robot,
                calibration.robot_sigma_m,
                calibration.robot_sigma_rad,
            ),
            alignment_m: scalar(&mut alignment, placement.alignment_sigma_m),
            alignment_rad: scalar(&mut alignment, placement.alignment_sigma_rad),
            click_error_px: std::array::from_fn(|_| scalar(&mut click, calibration.click_sigma_px)),
        }
    }
}

/// Noise of the encoders with image `sequence`: six joints of the arm, then the needle's depth.
pub(crate) fn encoder_noise(seed: u64, sequence: u64, calibration: &CalibrationSpec) -> ([f64; 6], f64) {
    let mut rng = generator(seed, Stream::Encoders);
    rng.set_word_pos(u128::from(sequence) * WORDS_PER_IMAGE);
    let joints_rad = std::array::from_fn(|_| scalar(&mut rng, calibration.encoder_sigma_rad));
    (joints_rad, scalar(&mut rng, calibration.encoder_sigma_m))
}

/// Noise of the measured force in image `sequence`; the same however often it is asked for.
pub(crate) fn force_noise_n(seed: u64, sequence: u64, sigma_n: f64) -> f64 {
    let mut rng = generator(seed, Stream::Force);
    rng.set_word_pos(u128::from(sequence) * WORDS_PER_IMAGE);
    scalar(&mut rng, sigma_n)
}

/// Evenly in 0…1 for image `sequence`: whether it is dropped.
pub(crate) fn uniform_for_drop(seed: u64, sequence: u64) -> f64 {
    let mut rng = generator(seed, Stream::Drops);
    rng.set_word_pos(u128::from(sequence) * WORDS_PER_IMAGE);
    StandardUniform.sample(&mut rng)
}

/// Random words to make garbage of one answer.
pub type GarbageWords = [u64; 24];

/// The words for the answer to image `sequence`.
pub(crate) fn garbage_words(seed: u64, sequence: u64) -> GarbageWords {
    let mut rng = generator(seed, Stream::Garbage);
    rng.set_word_pos(u128::from(sequence) * WORDS_PER_IMAGE);
    std::array::from_fn(|_| StandardUniform.sample(&mut rng))
}

pub(crate) fn generator(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream as u64);
    rng
}

/// The ziggurat's far tail, the only part whose value goes through a logarithm, is cut off.
fn scalar(rng: &mut ChaCha8Rng, sigma: f64) -> f64 {
    loop {
        let z: f64 = StandardNormal.sample(rng);
        if z.abs() <= 2.0 {
            return z * sigma;
        }
    }
}

fn pose(rng: &mut ChaCha8Rng, sigma_m: f64, sigma_rad: f64) -> Pose {
    let shift = vector(rng, sigma_m);
    Pose::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(vector(rng, sigma_rad)))
}

fn vector(rng: &mut ChaCha8Rng, sigma: f64) -> Vector {
    let [x, y, z] = std::array::from_fn(|_| scalar(rng, sigma));
    Vector::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
        (sum / count).sqrt()
    }

    #[test]
    fn truth_spread_over_seeds_is_that_of_a_cut_off_gaussian() {
        let calibration = fixture::calibration();
        let placement = fixture::placement();
        let draws: Vec<Hidden> = (0..4000).map(|seed| Hidden::draw(seed, &calibration, &placement)).collect();
        // σ² of a standard normal cut at ±2: 1 − 4φ(2)/(2Φ(2) − 1) = 0.7737. With 4000 draws or more the
        // rms is known to about 1 %; 4 % is four of its own standard deviations.
        let cut = 0.7737f64.sqrt();
        let near = |value: f64, sigma: f64| (value / (sigma * cut) - 1.0).abs() < 0.04;
        assert!(near(rms(draws.iter().map(|d| d.click_error_px[1])), calibration.click_sigma_px));
        assert!(near(rms(draws.iter().map(|d| d.alignment_m)), placement.alignment_sigma_m));
        assert!(near(
            rms(draws.iter().map(|d| d.nominal_from_true_probe.translation.vector.y)),
            calibration.probe_sigma_m
        ));
        assert!(near(rms(draws.iter().map(|d| d.axis_error.scaled_axis().x)), calibration.needle_sigma_rad));
        assert!(draws.iter().all(|d| d.entry_error_in_world.norm() >= calibration.needle_sigma_m));
        assert!(draws.iter().all(|d| d.entry_error_in_world.amax() <= 2.0 * calibration.needle_sigma_m));
        let mean = draws.iter().map(|d| d.entry_error_in_world.x).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.1 * calibration.needle_sigma_m, "{mean}");
    }

    #[test]
    fn no_sigma_no_error() {
        let mut calibration = fixture::calibration();
        calibration.needle_sigma_m = 0.0;
        calibration.probe_sigma_m = 0.0;
        let hidden = Hidden::draw(3, &calibration, &fixture::placement());
        assert_eq!(hidden.entry_error_in_world, Vector::zeros());
        assert_eq!(hidden.nominal_from_true_probe.translation.vector, Vector::zeros());
    }

    #[test]
    fn truth_encoder_noise_has_its_spread_and_depends_on_seed_and_image_alone() {
        let mut calibration = fixture::calibration();
        (calibration.encoder_sigma_rad, calibration.encoder_sigma_m) = (1e-4, 5e-5);
        assert_eq!(encoder_noise(1, 7, &calibration), encoder_noise(1, 7, &calibration));
        assert_ne!(encoder_noise(1, 7, &calibration), encoder_noise(1, 8, &calibration));
        assert_ne!(encoder_noise(1, 7, &calibration), encoder_noise(2, 7, &calibration));
        let draws: Vec<_> = (0..4000).map(|image| encoder_noise(3, image, &calibration)).collect();
        // As above: cut at 2σ, known to about 1 %.
        let cut = 0.7737f64.sqrt();
        assert!((rms(draws.iter().map(|d| d.0[5])) / (1e-4 * cut) - 1.0).abs() < 0.04);
        assert!((rms(draws.iter().map(|d| d.1)) / (5e-5 * cut) - 1.0).abs() < 0.04);
    }

    #[test]
    fn force_noise_depends_on_seed_and_image_alone() {
        assert_eq!(force_noise_n(1, 7, 0.1), force_noise_n(1, 7, 0.1));
        assert_ne!(force_noise_n(1, 7, 0.1), force_noise_n(1, 8, 0.1));
        assert_ne!(force_noise_n(1, 7, 0.1), force_noise_n(2, 7, 0.1));
    }
}
