//! The tracker's settings as options of the command line, on top of a profile.

use clap::{Args, ValueEnum};
use sonoloop_tracker::{TrackerError, check_settings};
use sonoloop_types::{Guess, Optimisation, Profile, Similarity, TrackerSettings, UpdateStrategy, Warp};

use crate::error::AppError;

/// Every setting of the tracker; what is left out is the profile's.
#[derive(Debug, Clone, Args)]
#[group(requires = "sequence")]
pub struct TrackerArgs {
    /// The settings to start from; any option below changes one of them
    #[arg(long, value_enum, default_value = "robust", help_heading = "Profile")]
    pub profile: ProfileArg,

    /// Side of the square template in pixels, 8 to 128
    #[arg(long, value_name = "N", default_value_t = 20, help_heading = TEMPLATE)]
    pub template: u32,
    /// How the template moves; with --refine a turn is measured only where the surroundings move along
    #[arg(long, value_enum, help_heading = TEMPLATE)]
    pub warp: Option<WarpArg>,
    /// How the template follows the tip's appearance
    #[arg(long, value_enum, help_heading = TEMPLATE)]
    pub update: Option<UpdateArg>,
    /// Updates are taken when the first template agrees to this many pixels, 0 to 50
    #[arg(long, value_name = "PX", help_heading = TEMPLATE, allow_negative_numbers = true)]
    pub drift_tolerance_px: Option<f64>,
    /// Gaussian blur before anything else, sigma, 0 (none) to 8
    #[arg(long, value_name = "PX", help_heading = TEMPLATE, allow_negative_numbers = true)]
    pub blur_sigma_px: Option<f64>,
    /// Gaussian weight about the tip, sigma, 1 to 64, or 0 (uniform)
    #[arg(long, value_name = "PX", help_heading = TEMPLATE, allow_negative_numbers = true)]
    pub weight_sigma_px: Option<f64>,

    /// What is minimised
    #[arg(long, value_enum, help_heading = REGISTRATION)]
    pub similarity: Option<SimilarityArg>,
    /// Grey-level bins of the conditional variances, 2 to 256
    #[arg(long, value_name = "N", help_heading = REGISTRATION)]
    pub scv_bins: Option<u32>,
    /// Gauss-Newton of first or second order
    #[arg(long, value_name = "1|2", value_parser = clap::value_parser!(u8).range(1..=2), help_heading = REGISTRATION)]
    pub order: Option<u8>,
    /// Register once more, unblurred and unweighted, where the surroundings move with the tip; not with --update naive
    #[arg(long, value_name = "BOOL", help_heading = REGISTRATION)]
    pub refine: Option<bool>,
    /// Where the optimiser starts in the next image
    #[arg(long, value_enum, help_heading = REGISTRATION)]
    pub guess: Option<GuessArg>,
    /// Share of the last velocity that the smoothed one keeps, 0 to 1
    #[arg(long, value_name = "SHARE", help_heading = REGISTRATION, allow_negative_numbers = true)]
    pub velocity_memory: Option<f64>,
    /// Resolutions for large motions, 1 to 3: full, from a half, from a quarter
    #[arg(long, value_name = "N", help_heading = REGISTRATION)]
    pub pyramid_levels: Option<u32>,
    /// Most iterations per registration, 1 to 500
    #[arg(long, value_name = "N", help_heading = REGISTRATION)]
    pub max_iterations: Option<u32>,
    /// Motion of the corners that ends the iteration, 0.000001 to 1
    #[arg(long, value_name = "PX", help_heading = REGISTRATION, allow_negative_numbers = true)]
    pub epsilon_px: Option<f64>,

    /// Lost below this correlation with the last template, -1 to 1
    #[arg(long, value_name = "NCC", help_heading = LOSS, allow_negative_numbers = true)]
    pub loss_ncc_previous: Option<f64>,
    /// Lost below this correlation with the first template, -1 to 1
    #[arg(long, value_name = "NCC", help_heading = LOSS, allow_negative_numbers = true)]
    pub loss_ncc_anchor: Option<f64>,
    /// Lost above this difference to the first template over its contrast, 0.01 to 10, when less than nine tenths of that
    /// contrast is left (and lost when less than half is), or none (neither test)
    #[arg(long, value_name = "RATIO|none", value_parser = parse_ratio, help_heading = LOSS, allow_negative_numbers = true)]
    pub loss_brightness_ratio: Option<Ratio>,
    /// Found again from this correlation with the first template on, -1 to 1
    #[arg(long, value_name = "NCC", help_heading = LOSS, allow_negative_numbers = true)]
    pub recovery_ncc: Option<f64>,
    /// Images in a row that confirm a recovery, 1 to 100
    #[arg(long, value_name = "N", help_heading = LOSS)]
    pub confirmation_images: Option<u32>,
    /// Images lost after which the whole picture is searched, 0 to 10000
    #[arg(long, value_name = "N", help_heading = LOSS)]
    pub whole_image_after: Option<u32>,
}

const TEMPLATE: &str = "Template";
const REGISTRATION: &str = "Registration";
const LOSS: &str = "Loss and recovery";

/// `--profile`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProfileArg {
    /// Narrow weights, brightness test, strict recovery
    Robust,
    /// What the paper says
    Paper,
}

/// `--similarity`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SimilarityArg {
    /// Sum of squared differences
    Ssd,
    /// Sum of conditional variances
    Scv,
}

/// `--warp`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WarpArg {
    /// Two degrees of freedom
    Translation,
    /// Three: it turns too
    Rigid,
    /// Six
    Affine,
}

/// `--update`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpdateArg {
    /// The first template for ever
    None,
    /// The last image's patch
    Naive,
    /// The last image's patch, held to the first template
    DriftCorrected,
}

/// `--guess`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GuessArg {
    /// Where the tip was
    None,
    /// On by its smoothed velocity
    ConstantVelocity,
    /// Where a Kalman filter predicts it
    Kalman,
    /// On by the measured motion; a recording has none, so by the smoothed velocity
    Insertion,
}

/// `--loss-brightness-ratio`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ratio {
    /// No such test.
    None,
    /// The limit.
    Above(f64),
}

fn parse_ratio(text: &str) -> Result<Ratio, String> {
    if text == "none" {
        return Ok(Ratio::None);
    }
    text.parse().map(Ratio::Above).map_err(|_| "must be a number in [0.01, 10], or none".to_owned())
}

impl TrackerArgs {
    /// The settings that these options ask for; refuses, by option, value and bound, what the tracker cannot work with.
    pub fn settings(&self) -> Result<TrackerSettings, AppError> {
        let profile = match self.profile {
            ProfileArg::Robust => Profile::Robust,
            ProfileArg::Paper => Profile::Paper,
        };
        let base = TrackerSettings::profile(profile, self.template);
        let settings = TrackerSettings {
            similarity: self.similarity.map_or(base.similarity, |similarity| match similarity {
                SimilarityArg::Ssd => Similarity::Ssd,
                SimilarityArg::Scv => Similarity::Scv,
            }),
            optimisation: match self.order {
                None => base.optimisation,
                Some(1) => Optimisation::FirstOrder,
                Some(_) => Optimisation::SecondOrder, // 1 and 2 are all that clap lets through
            },
            warp: self.warp.map_or(base.warp, |warp| match warp {
                WarpArg::Translation => Warp::Translation,
                WarpArg::Rigid => Warp::Rigid,
                WarpArg::Affine => Warp::Affine,
            }),
            update: self.update.map_or(base.update, |update| match update {
                UpdateArg::None => UpdateStrategy::None,
                UpdateArg::Naive => UpdateStrategy::Naive,
                UpdateArg::DriftCorrected => UpdateStrategy::DriftCorrected,
            }),
            guess: self.guess.map_or(base.guess, |guess| match guess {
                GuessArg::None => Guess::None,
                GuessArg::ConstantVelocity => Guess::ConstantVelocity,
                GuessArg::Kalman => Guess::Kalman,
                GuessArg::Insertion => Guess::Insertion,
            }),
            loss_brightness_ratio: match self.loss_brightness_ratio {
                None => base.loss_brightness_ratio,
                Some(Ratio::None) => None,
                Some(Ratio::Above(limit)) => Some(limit),
            },
            scv_bins: self.scv_bins.unwrap_or(base.scv_bins),
            blur_sigma_px: self.blur_sigma_px.unwrap_or(base.blur_sigma_px),
            weight_sigma_px: self.weight_sigma_px.unwrap_or(base.weight_sigma_px),
            refine: self.refine.unwrap_or(base.refine),
            velocity_memory: self.velocity_memory.unwrap_or(base.velocity_memory),
            pyramid_levels: self.pyramid_levels.unwrap_or(base.pyramid_levels),
            drift_tolerance_px: self.drift_tolerance_px.unwrap_or(base.drift_tolerance_px),
            max_iterations: self.max_iterations.unwrap_or(base.max_iterations),
            epsilon_px: self.epsilon_px.unwrap_or(base.epsilon_px),
            loss_ncc_previous: self.loss_ncc_previous.unwrap_or(base.loss_ncc_previous),
            loss_ncc_anchor: self.loss_ncc_anchor.unwrap_or(base.loss_ncc_anchor),
            recovery_ncc: self.recovery_ncc.unwrap_or(base.recovery_ncc),
            confirmation_images: self.confirmation_images.unwrap_or(base.confirmation_images),
            whole_image_after: self.whole_image_after.unwrap_or(base.whole_image_after),
            ..base
        };
        match check_settings(&settings) {
            Ok(()) => Ok(settings),
            Err(TrackerError::Setting { name, value, bound }) => {
                let option =
                    if name == "template_px" { "template".to_owned() } else { name.replace('_', "-") };
                Err(AppError::BadInput(format!("error: --{option} {value} must be {bound}")))
            }
            Err(other) => Err(AppError::BadInput(format!("error: {other}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Cli {
        #[arg(long)]
        sequence: Option<String>,
        #[command(flatten)]
        tracker: TrackerArgs,
    }

    fn settings(options: &[&str]) -> Result<TrackerSettings, AppError> {
        let start = ["track", "--sequence", "s"];
        Cli::try_parse_from(start.iter().chain(options)).unwrap_or_else(|e| panic!("{e}")).tracker.settings()
    }

    #[test]
    fn nothing_said_is_the_profile() {
        let profile = |profile, template| TrackerSettings::profile(profile, template);
        assert_eq!(settings(&[]).unwrap(), profile(Profile::Robust, 20));
        assert_eq!(
            settings(&["--profile", "paper", "--template", "61"]).unwrap(),
            profile(Profile::Paper, 61)
        );
    }

    /// On top of both profiles each option changes the field of its name, and no other. The fields are told apart by their
    /// names in the settings as JSON, so one that has no option fails.
    #[test]
    fn every_setting_has_its_option() {
        let cases = [
            ("similarity", "ssd", "\"ssd\""),
            ("order", "1", "\"first_order\""),
            ("warp", "affine", "\"affine\""),
            ("update", "naive", "\"naive\""),
            ("scv-bins", "24", "24"),
            ("blur-sigma-px", "0.75", "0.75"),
            ("weight-sigma-px", "4.5", "4.5"),
            ("guess", "kalman", "\"kalman\""),
            ("refine", "true", "true"),
            ("velocity-memory", "0.25", "0.25"),
            ("pyramid-levels", "3", "3"),
            ("drift-tolerance-px", "1.5", "1.5"),
            ("max-iterations", "7", "7"),
            ("epsilon-px", "0.5", "0.5"),
            ("loss-ncc-previous", "-0.5", "-0.5"),
            ("loss-ncc-anchor", "0.125", "0.125"),
            ("loss-brightness-ratio", "0.5", "0.5"),
            ("recovery-ncc", "0.95", "0.95"),
            ("confirmation-images", "9", "9"),
            ("whole-image-after", "77", "77"),
        ];
        let json = |settings: &TrackerSettings| serde_json::to_value(settings).expect("plain data");
        for profile in ["robust", "paper"] {
            let base = json(&settings(&["--profile", profile]).unwrap());
            let fields = base.as_object().unwrap();
            for (option, value, expected) in cases {
                let changed =
                    json(&settings(&["--profile", profile, &format!("--{option}"), value]).unwrap());
                let field =
                    if option == "order" { "optimisation".to_owned() } else { option.replace('-', "_") };
                for (name, before) in fields {
                    let expected =
                        if *name == field { serde_json::from_str(expected).unwrap() } else { before.clone() };
                    assert_eq!(changed[name], expected, "--{option} {value}: {name}");
                }
            }
            // The rest: profile, template size, and what `--init` and `--tracker` say.
            let others = ["profile", "template_px", "init", "method"];
            assert_eq!(fields.len(), cases.len() + others.len());
            assert!(others.iter().all(|name| fields.contains_key(*name)));
        }
        let off = settings(&["--loss-brightness-ratio", "none"]).unwrap();
        assert_eq!(off.loss_brightness_ratio, None);
    }

    /// Scenarios are checked without the tracker at hand: whatever their ranges let through the tracker must work with.
    #[test]
    fn the_tracker_takes_every_bound_of_a_scenario() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let schema = std::fs::read_to_string(root.join("docs/schema/scenario.schema.json")).unwrap();
        let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
        let with = |key: &str, value: &serde_json::Value| {
            let set = vec![format!("tracker.{key}={value}")];
            let options = sonoloop_scenario::LoadOptions { set, ..Default::default() };
            let file = root.join("scenarios/lateral_plain.yaml");
            sonoloop_scenario::load(&file, &options).unwrap_or_else(|e| panic!("{}", e.render())).tracker
        };
        let mut bounds = 0;
        for (key, property) in schema["$defs"]["RawTracker"]["properties"].as_object().unwrap() {
            for end in ["minimum", "maximum"].iter().filter_map(|end| property.get(*end)) {
                // The largest template does not fit about the tip of this scenario.
                let settings = if key == "template_px" {
                    TrackerSettings::profile(Profile::Robust, end.as_u64().unwrap() as u32)
                } else {
                    with(key, end)
                };
                assert_eq!(check_settings(&settings), Ok(()), "{key} = {end}");
                bounds += 1;
            }
        }
        assert_eq!(bounds, 2 * 16, "every numeric key has two bounds");
    }

    #[test]
    fn a_bad_value_is_named_with_its_option_and_bound() {
        for (option, value, bound) in [
            ("template", "7", "in [8, 128]"),
            ("scv-bins", "1", "in [2, 256]"),
            ("blur-sigma-px", "9", "in [0, 8]"),
            ("weight-sigma-px", "0.5", "0, or at least 1"),
            ("weight-sigma-px", "-1", "in [0, 64]"),
            ("velocity-memory", "1.5", "in [0, 1]"),
            ("pyramid-levels", "4", "in [1, 3]"),
            ("drift-tolerance-px", "NaN", "in [0, 50]"),
            ("max-iterations", "0", "in [1, 500]"),
            ("epsilon-px", "2", "in [1e-6, 1]"),
            ("loss-ncc-previous", "1.1", "in [-1, 1]"),
            ("loss-ncc-anchor", "-3", "in [-1, 1]"),
            ("loss-brightness-ratio", "0", "in [0.01, 10]"),
            ("recovery-ncc", "2", "in [-1, 1]"),
            ("confirmation-images", "0", "in [1, 100]"),
            ("whole-image-after", "10001", "in [0, 10000]"),
        ] {
            let error = settings(&[&format!("--{option}"), value]).unwrap_err();
            assert_eq!(error.to_string(), format!("error: --{option} {value} must be {bound}"));
        }
    }
}
