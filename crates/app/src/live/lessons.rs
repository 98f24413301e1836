use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::AppError;

/// A lesson: its text, and the scenario of the same name beside it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Lesson {
    /// File name without its ending.
    pub name: String,
    /// First heading of the text.
    pub title: String,
    /// Markdown. What follows the heading "Answer" is shown when asked for.
    pub text: String,
    #[serde(skip)]
    scenario: PathBuf,
}

/// The lessons of a folder, by name.
#[derive(Debug, Clone, Default)]
pub(super) struct Lessons(pub Vec<Lesson>);

impl Lessons {
    /// Reads every `*.md` that has a scenario of the same name. A folder that is not there holds none.
    pub fn read(folder: &Path) -> Result<Self, AppError> {
        if !folder.exists() {
            return Ok(Self::default());
        }
        let unreadable = |path: &Path, error: std::io::Error| {
            AppError::BadInput(format!("error: {}: {error}", path.display()))
        };
        let mut lessons = Vec::new();
        for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, error))? {
            let path = entry.map_err(|error| unreadable(folder, error))?.path();
            let scenario = path.with_extension("yaml");
            let Some(name) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
            if path.extension().is_none_or(|ending| ending != "md") || !scenario.is_file() {
                continue;
            }
            let text = std::fs::read_to_string(&path).map_err(|error| unreadable(&path, error))?;
            let title = text.lines().find_map(|line| line.strip_prefix("# ")).unwrap_or(name).to_owned();
            lessons.push(Lesson { name: name.to_owned(), title, text, scenario });
        }
        lessons.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Self(lessons))
    }

    /// The scenario of a lesson.
    pub fn scenario(&self, name: &str) -> Option<PathBuf> {
        self.0.iter().find(|lesson| lesson.name == name).map(|lesson| lesson.scenario.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenarios::prepare;

    #[test]
    fn every_lesson_of_the_box_can_be_run_and_asks_a_question_that_it_answers() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../lessons");
        let lessons = Lessons::read(&folder).expect("readable");
        assert_eq!(lessons.0.len(), 6);
        for lesson in &lessons.0 {
            prepare(&lesson.scenario, None, &[]).unwrap_or_else(|error| panic!("{error}"));
            for heading in ["# ", "## Try", "## Question", "## Answer"] {
                assert!(
                    lesson.text.lines().any(|line| line.starts_with(heading)),
                    "{}: {heading}",
                    lesson.name
                );
            }
        }
    }
}
