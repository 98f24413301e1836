use std::fmt::Write;

/// What became of one test case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CaseResult {
    /// Every expectation held.
    Passed,
    /// These expectations failed, one sentence each.
    Failed(Vec<String>),
    /// The run could not be judged.
    Error(String),
}

/// One run of a suite.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Path of the scenario file; shown as the class.
    pub file: String,
    /// Name of scenario and seed.
    pub name: String,
    /// How long it took by the clock.
    pub wall_s: f64,
    /// What became of it.
    pub result: CaseResult,
}

/// The JUnit XML that CI servers read: one `testsuite` with one `testcase` per run.
pub fn junit_xml(suite: &str, cases: &[Case]) -> String {
    let failures = cases.iter().filter(|case| matches!(case.result, CaseResult::Failed(_))).count();
    let errors = cases.iter().filter(|case| matches!(case.result, CaseResult::Error(_))).count();
    let total_s: f64 = cases.iter().map(|case| case.wall_s).sum();
    let counts = format!(
        "name=\"{}\" tests=\"{}\" failures=\"{failures}\" errors=\"{errors}\" time=\"{total_s:.3}\"",
        escape_xml(suite),
        cases.len()
    );
    let mut xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_owned();
    let _ = writeln!(xml, "<testsuites {counts}>\n  <testsuite {counts}>");
    for case in cases {
        let (class, name) = (escape_xml(&case.file), escape_xml(&case.name));
        let _ =
            write!(xml, "    <testcase classname=\"{class}\" name=\"{name}\" time=\"{:.3}\"", case.wall_s);
        let _ = match &case.result {
            CaseResult::Passed => writeln!(xml, "/>"),
            CaseResult::Failed(reasons) => {
                let first = reasons.first().map_or(String::new(), |reason| escape_xml(reason));
                let all = escape_xml(&reasons.join("\n"));
                writeln!(xml, "><failure message=\"{first}\">{all}</failure></testcase>")
            }
            CaseResult::Error(reason) => {
                let first = escape_xml(reason.lines().next().unwrap_or_default());
                writeln!(xml, "><error message=\"{first}\">{}</error></testcase>", escape_xml(reason))
            }
        };
    }
    xml.push_str("  </testsuite>\n</testsuites>\n");
    xml
}

/// Text safe inside XML and HTML elements and quoted attributes; control characters, which XML 1.0 has no
/// way to write, become �.
pub(crate) fn escape_xml(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(character),
            control if control.is_control() => escaped.push('\u{fffd}'),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_reasons_and_escapes() {
        let case = |name: &str, result| Case {
            file: "scenarios/a<b>.yaml".into(),
            name: name.into(),
            wall_s: 0.25,
            result,
        };
        let reasons = vec!["coverage = 0.8, expected ≥ 0.9".into(), "losses & more".into()];
        let xml = junit_xml(
            "suite",
            &[
                case("plain seed 0", CaseResult::Passed),
                case("plain seed 1", CaseResult::Failed(reasons)),
                case("plain \"2\"", CaseResult::Error("tracker died\u{1b}[0m\nat once".into())),
            ],
        );
        assert_eq!(xml.matches("tests=\"3\" failures=\"1\" errors=\"1\" time=\"0.750\"").count(), 2);
        assert_eq!(xml.matches("classname=\"scenarios/a&lt;b&gt;.yaml\"").count(), 3);
        assert!(xml.contains(
            "<failure message=\"coverage = 0.8, expected ≥ 0.9\">coverage = 0.8, expected ≥ 0.9\nlosses &amp; more</failure>"
        ));
        assert!(xml.contains("name=\"plain &quot;2&quot;\""));
        assert!(xml.contains("<error message=\"tracker died\u{fffd}[0m\">"));
        assert_eq!(xml.matches("<testcase").count(), xml.matches("</testcase>").count() + 1);
    }
}
