//! What `run` prints at its end, and the words for values and bounds that the report shares.

use sonoloop_scenario::{Bound, METRICS};

use crate::judge::{Judged, Metrics, Value, passes};

/// The metrics of a run, one line each, with ✓ or ✗ and the bound where one was set, and the verdict.
///
/// Expectations come first, in the scenario's order; a metric bounded twice has two lines.
pub fn metrics_table(metrics: &Metrics, judged: &[Judged]) -> String {
    let mut lines: Vec<[String; 3]> = Vec::new();
    for expectation in judged {
        let mark = if expectation.pass { '✓' } else { '✗' };
        let bound = bound_text(expectation.bound);
        lines.push([format!("{mark} {}", expectation.metric), value_text(expectation.value), bound]);
    }
    for name in METRICS.iter().filter(|name| judged.iter().all(|j| j.metric != **name)) {
        lines.push([format!("  {name}"), value_text(metrics.value(name)), String::new()]);
    }
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let (names, values) = (width(0), width(1));
    let mut table = String::new();
    for [name, value, bound] in &lines {
        let line = format!("{name:<names$}  {value:>values$}  {bound}");
        table.push_str(line.trim_end());
        table.push('\n');
    }
    table.push_str(&verdict_text(judged));
    table.push('\n');
    table
}

/// `PASS`, or `FAIL` with the number of expectations that did not hold.
pub fn verdict_text(judged: &[Judged]) -> String {
    let failed = judged.iter().filter(|judged| !judged.pass).count();
    if passes(judged) {
        "PASS".to_owned()
    } else {
        format!("FAIL ({failed} of {} expectations)", judged.len())
    }
}

/// A value for people: counts whole, numbers to three digits behind the point, `-` for none.
pub fn value_text(value: Option<Value>) -> String {
    match value {
        None => "-".to_owned(),
        Some(Value::Truth(truth)) => if truth { "yes" } else { "no" }.to_owned(),
        Some(Value::Count(count)) => count.to_string(),
        Some(Value::Number(number)) => format!("{number:.3}"),
    }
}

/// A bound for people: `≤ 0.5`, `≥ 1`, `1 … 3`, `= yes`.
pub fn bound_text(bound: Bound) -> String {
    match bound {
        Bound::Is(truth) => if truth { "= yes" } else { "= no" }.to_owned(),
        Bound::Range { min: None, max: None } => "any value".to_owned(),
        Bound::Range { min: Some(min), max: None } => format!("≥ {min}"),
        Bound::Range { min: None, max: Some(max) } => format!("≤ {max}"),
        Bound::Range { min: Some(min), max: Some(max) } if min == max => format!("= {min}"),
        Bound::Range { min: Some(min), max: Some(max) } => format!("{min} … {max}"),
    }
}

/// One sentence on an expectation that failed: `coverage = 0.812, expected ≥ 0.9`.
pub fn failure_text(judged: &Judged) -> String {
    let value =
        judged.value.map_or("has no value".to_owned(), |value| format!("= {}", value_text(Some(value))));
    format!("{} {value}, expected {}", judged.metric, bound_text(judged.bound))
}

#[cfg(test)]
mod tests {
    use sonoloop_scenario::Expectation;

    use super::*;
    use crate::judge::test_recording::{facts, scripted};
    use crate::judge::{metrics, verdict};

    fn expect(metric: &str, min: Option<f64>, max: Option<f64>) -> Expectation {
        Expectation { metric: metric.into(), bound: Bound::Range { min, max } }
    }

    #[test]
    fn table_is_aligned_and_names_the_verdict() {
        let metrics = metrics(&scripted("vv----vvvv", "TTTTLLRRTT"), &facts());
        let expectations =
            [expect("losses", Some(1.0), None), expect("travel_after_loss_mm", None, Some(0.5))];
        let judged = verdict(&metrics, &expectations);
        let table = metrics_table(&metrics, &judged);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "✓ losses                         1  ≥ 1");
        assert_eq!(lines[1], "✗ travel_after_loss_mm       0.800  ≤ 0.5");
        assert_eq!(lines.last(), Some(&"FAIL (1 of 2 expectations)"));
        // Two expectations, the seventeen other metrics, the verdict.
        assert_eq!(lines.len(), METRICS.len() + 1);
        assert_eq!(failure_text(&judged[1]), "travel_after_loss_mm = 0.800, expected ≤ 0.5");
        assert!(metrics_table(&metrics, &judged[..1]).ends_with("PASS\n"));
    }

    #[test]
    fn a_missing_value_is_said_to_be_missing() {
        let metrics = metrics(&scripted("---", "SSS"), &facts());
        let judged = verdict(&metrics, &[expect("coverage", Some(0.9), None)]);
        assert_eq!(failure_text(&judged[0]), "coverage has no value, expected ≥ 0.9");
        assert!(metrics_table(&metrics, &judged).starts_with("✗ coverage"));
    }
}
