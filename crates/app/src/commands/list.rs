//! `sonoloop list`: what is in the box.

use std::path::Path;

use sonoloop_scenario::LoadOptions;

use crate::cli::ListArgs;
use crate::error::{AppError, Outcome};
use crate::say::say;
use crate::scenarios::find;

/// Prints scenarios with their descriptions, then the files of the other kinds.
pub fn list(args: &ListArgs) -> Result<Outcome, AppError> {
    let mut anything = false;
    for (title, folder) in [("Scenarios", "scenarios"), ("Robots", "robots"), ("Phantoms", "phantoms")] {
        let folder = args.folder.join(folder);
        if !folder.is_dir() {
            continue;
        }
        anything = true;
        say(title);
        for file in find(&[folder])? {
            say(format_args!("  {:<44} {}", file.display(), note(&file, title == "Scenarios")));
        }
    }
    if anything {
        Ok(Outcome::Pass)
    } else {
        Err(AppError::BadInput(format!(
            "{}: holds none of the folders scenarios, robots, phantoms",
            args.folder.display()
        )))
    }
}

/// A scenario's description, or the first comment of any other file that is not for the editor.
fn note(file: &Path, is_scenario: bool) -> String {
    if is_scenario {
        return match sonoloop_scenario::load(file, &LoadOptions::default()) {
            Ok(scenario) => scenario.description,
            Err(_) => "(does not load: see `sonoloop check`)".into(),
        };
    }
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.lines()
        .filter_map(|line| line.strip_prefix('#'))
        .map(str::trim)
        .find(|line| !line.starts_with("yaml-language-server") && !line.is_empty())
        .unwrap_or_default()
        .to_owned()
}
