use serde::{Deserialize, Serialize};

/// Longest control message, bytes.
pub const MAX_CONTROL_BYTES: usize = 4096;
/// Speeds that can be asked for, in simulated seconds per second.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Most images of one step.
const MAX_STEP: u32 = 1_000_000;

/// What somebody who watches a run may ask of it; travels as JSON, see `docs/wire.md`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Stop before the next image.
    Pause,
    /// Go on.
    Resume,
    /// Take so many images, then pause.
    Step(u32),
    /// Simulated seconds per second; `null` for as fast as it goes.
    Speed(Option<f64>),
    /// Let something go wrong now: an entry of a scenario's `disturbances` without its `at_s`.
    Disturb(serde_json::Map<String, serde_json::Value>),
}

impl Control {
    pub(crate) fn encode(&self) -> Result<Vec<u8>, String> {
        let bytes = serde_json::to_vec(self).map_err(|error| error.to_string())?;
        // Refused here what the simulator would refuse.
        Self::decode(&bytes)?;
        Ok(bytes)
    }

    /// Reads and checks a message; says what is wrong with it otherwise. Whether a disturbance makes sense is for
    /// the simulator to say.
    ///
    /// # Errors
    /// One sentence for a person.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() > MAX_CONTROL_BYTES {
            return Err(format!("{} bytes are more than {MAX_CONTROL_BYTES}", bytes.len()));
        }
        let control = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        match &control {
            Self::Step(images) if !(1..=MAX_STEP).contains(images) => {
                Err(format!("step = {images} must be 1 to {MAX_STEP}"))
            }
            Self::Speed(Some(speed)) if !SPEEDS.contains(speed) => {
                Err(format!("speed = {speed} must be {} to {}", SPEEDS.start(), SPEEDS.end()))
            }
            Self::Disturb(entry) if entry.contains_key("at_s") => {
                Err("disturb.at_s is the simulator's to set".to_owned())
            }
            _ => Ok(control),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_read_as_the_page_says() {
        let read = |text: &str| Control::decode(text.as_bytes());
        assert_eq!(read(r#""pause""#), Ok(Control::Pause));
        assert_eq!(read(r#""resume""#), Ok(Control::Resume));
        assert_eq!(read(r#"{"step": 3}"#), Ok(Control::Step(3)));
        assert_eq!(read(r#"{"speed": 0.5}"#), Ok(Control::Speed(Some(0.5))));
        assert_eq!(read(r#"{"speed": null}"#), Ok(Control::Speed(None)));
        let Ok(Control::Disturb(entry)) = read(r#"{"disturb": {"probe_knock": {"elevation_mm": 3}}}"#) else {
            panic!("a disturbance is refused");
        };
        assert_eq!(entry["probe_knock"]["elevation_mm"], 3);
    }

    #[test]
    fn nonsense_is_refused_with_the_value_and_the_bound() {
        let refused = |text: &str| Control::decode(text.as_bytes()).expect_err(text);
        assert!(refused(r#"{"step": 0}"#).contains("1 to 1000000"));
        assert!(refused(r#"{"speed": 0}"#).contains("0.01 to 1000"));
        assert!(refused(r#"{"speed": 1e999}"#).contains("number out of range"));
        assert!(refused(r#"{"disturb": {"at_s": 1}}"#).contains("at_s"));
        assert!(refused(r#"{"halt": 1}"#).contains("unknown variant"));
        assert!(refused("").contains("EOF"));
        let long = format!(r#"{{"disturb": {{"x": "{}"}}}}"#, "x".repeat(MAX_CONTROL_BYTES));
        assert!(refused(&long).contains("4096"));
    }
}
