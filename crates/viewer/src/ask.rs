use serde::Deserialize;
use sonoloop_wire::Control;

/// Longest message that is taken from a browser, bytes.
pub(crate) const MAX_ASK_BYTES: usize = 16_384;

/// What somebody in front of the page asks for.
#[derive(Debug, Clone, PartialEq)]
pub enum Ask {
    /// Something for the run's `control` service.
    Control(Control),
    /// Leave this run and start another.
    Restart(Restart),
}

/// Which run to start.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Restart {
    /// Its seed; that of the run before when absent.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Values of the scenario to override, `key=value`, in place of those asked for before.
    #[serde(default)]
    pub set: Option<Vec<String>>,
    /// Name of the lesson whose scenario it is; empty for the scenario that the program was started with, the scenario of the
    /// run before when absent.
    #[serde(default)]
    pub lesson: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Message {
    Control(serde_json::Value),
    Restart(Restart),
}

impl Ask {
    /// Reads and checks a message; says what is wrong with it otherwise.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        match serde_json::from_str(text).map_err(|error| error.to_string())? {
            Message::Control(control) => Control::decode(control.to_string().as_bytes()).map(Self::Control),
            Message::Restart(restart) => Ok(Self::Restart(restart)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_read_as_the_page_writes_them() {
        assert_eq!(Ask::read(r#"{"control": "pause"}"#), Ok(Ask::Control(Control::Pause)));
        assert_eq!(Ask::read(r#"{"control": {"step": 1}}"#), Ok(Ask::Control(Control::Step(1))));
        let restart = Restart { seed: Some(7), ..Restart::default() };
        assert_eq!(Ask::read(r#"{"restart": {"seed": 7}}"#), Ok(Ask::Restart(restart)));
    }

    #[test]
    fn nonsense_is_refused_with_a_reason() {
        let refused = |text: &str| Ask::read(text).expect_err(text);
        assert!(refused("").contains("EOF"));
        assert!(refused(r#"{"halt": 1}"#).contains("unknown variant"));
        assert!(refused(r#"{"control": {"speed": 0}}"#).contains("0.01 to 1000"));
        assert!(refused(r#"{"restart": {"seed": -1}}"#).contains("invalid value"));
        assert!(refused(r#"{"restart": {"file": "/etc/passwd"}}"#).contains("unknown field"));
    }
}
