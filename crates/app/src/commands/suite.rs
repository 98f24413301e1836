//! `sonoloop suite`: many scenarios, many seeds; a line for each run, then what they come to.
//!
//! Runs are in-process (the bytes are the same as in two processes) and share the cores through `--jobs`.

use std::path::PathBuf;

use serde_json::json;

use super::run::{Finished, execute_in_process};
use crate::cli::SuiteArgs;
use crate::controller::ControllerKind;
use crate::error::{AppError, Outcome};
use crate::output::{Case as JunitCase, CaseResult, Rates, Run, junit_xml};
use crate::parallel::each;
use crate::paths::no_file_in_the_way;
use crate::say::say;
use crate::scenarios::{find, prepare};

struct Case {
    file: PathBuf,
    name: String,
    seed: u64,
}

/// Runs them all; fails when one fails.
pub fn suite(args: &SuiteArgs) -> Result<Outcome, AppError> {
    if let Some(file) = &args.junit {
        no_file_in_the_way("--junit", file.parent())?;
        if file.is_dir() {
            return Err(AppError::BadInput(format!("error: --junit: {} is a folder", file.display())));
        }
    }
    let mut cases = Vec::new();
    for file in find(&args.paths)? {
        // Everything is checked before anything runs.
        let (scenario, _) = prepare(&file, None, &args.set)?;
        for k in 0..u64::from(args.seeds) {
            let seed = scenario.seed.checked_add(k).ok_or_else(|| {
                AppError::BadInput(format!("error: seed {} + {k} is too large", scenario.seed))
            })?;
            if k > 0 {
                prepare(&file, Some(seed), &args.set)?;
            }
            cases.push(Case { file: file.clone(), name: scenario.name.clone(), seed });
        }
    }

    let results = each(args.jobs.into(), &cases, |case| {
        let result = prepare(&case.file, Some(case.seed), &args.set)
            .and_then(|(scenario, session)| execute_in_process(&scenario, session, ControllerKind::Tracker));
        eprintln!("{}", line(case, &result));
        result
    });
    report(args, &cases, &results)
}

fn line(case: &Case, result: &Result<Finished, AppError>) -> String {
    let name = format!("{} seed {}", case.file.display(), case.seed);
    match result {
        Ok(finished) => {
            let failed = finished.failed();
            let verdict = if failed.is_empty() { "PASS" } else { "FAIL" };
            format!(
                "{verdict}  {name:<52} {:5.1}×  {}",
                finished.summary.timing.realtime_factor.unwrap_or(0.0),
                failed.join(", ")
            )
        }
        Err(error) => format!("ERROR {name:<52} {error}"),
    }
}

fn report(
    args: &SuiteArgs,
    cases: &[Case],
    results: &[Result<Finished, AppError>],
) -> Result<Outcome, AppError> {
    let judged: Vec<Run> = cases
        .iter()
        .zip(results)
        .map(|(case, result)| (case.file.as_path(), case.seed, result.as_ref().ok().map(|f| &f.summary)))
        .collect();
    let rates = Rates::of(&judged);
    if args.json {
        let runs: Vec<_> = cases
            .iter()
            .zip(results)
            .map(|(case, result)| match result {
                Ok(finished) => json!(finished.summary),
                Err(error) => json!({"scenario": case.file, "seed": case.seed, "error": error.to_string()}),
            })
            .collect();
        say(json!({"runs": runs, "rates": rates.rates, "groups": rates.groups, "all": rates.all}));
    } else {
        say(rates.text().trim_end());
    }
    if let Some(file) = &args.junit {
        let cases: Vec<JunitCase> = cases
            .iter()
            .zip(results)
            .map(|(case, result)| JunitCase {
                file: case.file.display().to_string(),
                name: format!("{} seed {}", case.name, case.seed),
                wall_s: result.as_ref().map_or(0.0, |f| f.summary.timing.wall_s),
                result: match result {
                    Ok(f) if f.passed() => CaseResult::Passed,
                    Ok(f) => CaseResult::Failed(f.failed()),
                    Err(error) => CaseResult::Error(error.to_string()),
                },
            })
            .collect();
        let fault = |e: std::io::Error| AppError::Fault(format!("{}: {e}", file.display()));
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(fault)?;
        }
        let half_written = file.with_extension("xml.part");
        std::fs::write(&half_written, junit_xml("sonoloop", &cases)).map_err(fault)?;
        std::fs::rename(&half_written, file).map_err(fault)?;
    }
    if let Some(Err(error)) = results.iter().find(|r| r.is_err()) {
        return Err(AppError::Fault(error.to_string()));
    }
    let all = results.iter().all(|r| matches!(r, Ok(f) if f.passed()));
    Ok(if all { Outcome::Pass } else { Outcome::Fail })
}
