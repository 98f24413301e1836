//! `sonoloop check`: everything that a run checks before its first tick.

use std::path::Path;

use sonoloop_scenario::{FileKind, load_materials, load_needle, load_phantom, load_probe};

use crate::cli::CheckArgs;
use crate::error::{AppError, Outcome};
use crate::say::say;
use crate::scenarios::{find, prepare};

/// Checks each file and says so; fails with the first one's error after all were tried.
pub fn check(args: &CheckArgs) -> Result<Outcome, AppError> {
    let mut first_error = None;
    for file in find(&args.paths)? {
        match check_file(&file) {
            Ok(note) => say(format_args!("{}: {note}", file.display())),
            Err(error) => {
                if first_error.is_some() {
                    eprintln!("{error}");
                } else {
                    first_error = Some(error);
                }
            }
        }
    }
    first_error.map_or(Ok(Outcome::Pass), Err)
}

/// What is to be said of a sound file. Its kind is the one that its schema line names.
fn check_file(file: &Path) -> Result<String, AppError> {
    let what = match FileKind::of_file(file).unwrap_or(FileKind::Scenario) {
        FileKind::Scenario => prepare(file, None, &[])?.0.description,
        FileKind::Phantom => {
            let phantom = load_phantom(file)?;
            format!("phantom {}, {} bodies inside", phantom.name, phantom.inclusions.len())
        }
        FileKind::Materials => format!("{} materials", load_materials(file)?.len()),
        FileKind::Probe => format!("probe {}", load_probe(file)?.name),
        FileKind::Needle => format!("needle {}", load_needle(file)?.name),
        // Whether an arm reaches can only be told with a phantom and an insertion.
        FileKind::Robot | FileKind::NeedleRobot => {
            return Ok("checked with each scenario that names it".into());
        }
    };
    Ok(format!("ok ({what})"))
}
