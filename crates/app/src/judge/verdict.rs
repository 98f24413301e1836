use serde::{Deserialize, Serialize};
use sonoloop_scenario::{Bound, Expectation};

use super::{Metrics, Value};

/// One expectation, held against the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Name of the metric.
    pub metric: String,
    /// What it came to; `None` when it has no value or no such metric exists.
    pub value: Option<Value>,
    /// What it had to keep.
    pub bound: Bound,
    /// Whether it did.
    pub pass: bool,
}

/// Holds every expectation against the metrics, in the scenario's order. A bound on a metric without a
/// value fails, and so does a bound of the wrong kind. A scenario that expects nothing expects success.
pub fn verdict(metrics: &Metrics, expect: &[Expectation]) -> Vec<Judged> {
    if expect.is_empty() {
        return vec![judge(metrics, "success", Bound::Is(true))];
    }
    expect.iter().map(|expectation| judge(metrics, &expectation.metric, expectation.bound)).collect()
}

/// True when every expectation holds; false for none at all.
pub fn passes(judged: &[Judged]) -> bool {
    !judged.is_empty() && judged.iter().all(|judged| judged.pass)
}

fn judge(metrics: &Metrics, metric: &str, bound: Bound) -> Judged {
    let value = metrics.value(metric);
    let pass = match (value, bound) {
        (Some(Value::Truth(truth)), Bound::Is(expected)) => truth == expected,
        (Some(Value::Number(number)), Bound::Range { min, max }) => within(number, min, max),
        (Some(Value::Count(count)), Bound::Range { min, max }) => within(count as f64, min, max),
        _ => false,
    };
    Judged { metric: metric.to_owned(), value, bound, pass }
}

fn within(number: f64, min: Option<f64>, max: Option<f64>) -> bool {
    number.is_finite() && min.is_none_or(|min| number >= min) && max.is_none_or(|max| number <= max)
}
