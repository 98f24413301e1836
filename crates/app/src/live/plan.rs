use std::path::PathBuf;

use sonoloop_scenario::Scenario;
use sonoloop_viewer::Restart;

use super::lessons::Lessons;
use crate::cli::ScenarioArgs;
use crate::error::AppError;
use crate::scenarios::prepare;
use crate::session::Session;

/// What is to be run.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    /// The scenario that the program was started with.
    file: PathBuf,
    /// The lesson whose scenario is run instead.
    pub lesson: Option<String>,
    seed: Option<u64>,
    /// Values given on the command line, for that scenario only.
    given: Vec<String>,
    /// Values changed on the page.
    pub set: Vec<String>,
}

impl Plan {
    pub fn new(args: &ScenarioArgs) -> Self {
        let ScenarioArgs { file, seed, set } = args.clone();
        Self { file, lesson: None, seed, given: set, set: Vec::new() }
    }

    /// The plan with what was asked for. Another scenario begins with its own seed and values.
    pub fn changed(&self, restart: Restart) -> Self {
        let mut plan = self.clone();
        if let Some(lesson) = restart.lesson {
            plan.lesson = Some(lesson).filter(|name| !name.is_empty());
            if plan.lesson != self.lesson {
                (plan.seed, plan.set) = (None, Vec::new());
            }
        }
        plan.seed = restart.seed.or(plan.seed);
        plan.set = restart.set.unwrap_or(plan.set);
        plan
    }

    /// Loads and checks it whole.
    pub fn prepare(&self, lessons: &Lessons) -> Result<(Scenario, Session), AppError> {
        let (file, mut set) = match &self.lesson {
            None => (self.file.clone(), self.given.clone()),
            Some(name) => {
                let unknown = || AppError::BadInput(format!("there is no lesson named {name:?}"));
                (lessons.scenario(name).ok_or_else(unknown)?, Vec::new())
            }
        };
        set.extend(self.set.iter().cloned());
        prepare(&file, self.seed, &set)
    }

    /// As [`Plan::prepare`], for the sake of its complaints.
    pub fn check(&self, lessons: &Lessons) -> Result<(), AppError> {
        self.prepare(lessons).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_keeps_what_it_does_not_name_and_another_scenario_begins_afresh() {
        let file = "a.yaml".into();
        let plan = Plan::new(&ScenarioArgs { file, seed: Some(3), set: vec!["a=1".into()] });
        let tuned = plan.changed(Restart { set: Some(vec!["b=2".into()]), ..Restart::default() });
        assert_eq!((tuned.seed, tuned.set.as_slice()), (Some(3), &["b=2".to_owned()][..]));
        let seeded = tuned.changed(Restart { seed: Some(9), ..Restart::default() });
        assert_eq!((seeded.seed, &seeded.set), (Some(9), &tuned.set));
        let lesson = seeded.changed(Restart { lesson: Some("speckle".into()), ..Restart::default() });
        assert_eq!((lesson.seed, lesson.set.len(), lesson.lesson.as_deref()), (None, 0, Some("speckle")));
        let back = lesson.changed(Restart { lesson: Some(String::new()), ..Restart::default() });
        assert_eq!((back.lesson, back.given.as_slice()), (None, &["a=1".to_owned()][..]));
    }
}
