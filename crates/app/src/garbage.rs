//! Answers that make no sense, for a scenario whose tracker sends garbage.
//!
//! They are made of the answer that the tracker really gave, at the level of the bytes on the wire, so that the same
//! checks see them whether there is a wire or not.

use sonoloop_types::Limits;
use sonoloop_wire::layout::CommandMessage;
use sonoloop_world::GarbageWords;

/// One of the ways in which a message can be wrong, drawn by the first word; the others say how. None is valid, whatever
/// the words.
pub fn garbage(honest: &CommandMessage, words: &GarbageWords, limits: &Limits) -> CommandMessage {
    let mut message = *honest;
    let [kind, a, b, rest @ ..] = words;
    match kind % 8 {
        0 => message.feed_m_s = if a % 2 == 0 { f64::NAN } else { f64::INFINITY },
        1 => message.tip_px = [f64::NAN, (b % 640) as f64],
        2 => message.feed_m_s = limits.max_feed_m_s * (2.0 + (a % 1000) as f64),
        3 => message.feed_m_s = -1e-3 * (1.0 + (a % 1000) as f64),
        4 => message.run_id ^= a | 1,
        5 => message.answers = message.answers.saturating_add(1 + a % (1 << 40)),
        6 => message.state = 100 + (a % 100) as u8,
        _ => {
            // Nothing of it is left.
            let [version, codes, run_id, answers, numbers @ ..] = rest;
            message.version = (*version as u32) | 1 << 31;
            [message.state, message.reason, message.has_target, message.reserved, ..] = codes.to_le_bytes();
            (message.run_id, message.answers) = (*run_id, *answers);
            message.target_base_from_probe = std::array::from_fn(|i| f64::from_bits(numbers[i]));
            message.feed_m_s = f64::from_bits(numbers[7]);
        }
    }
    message
}

#[cfg(test)]
mod tests {
    use sonoloop_wire::Answer;

    use super::*;

    #[test]
    fn garbage_of_every_kind_is_refused() {
        let limits = Limits {
            max_feed_m_s: 0.012,
            max_probe_speed_m_s: 0.03,
            max_probe_travel_m: 0.1,
            max_probe_turn_rad: 0.5,
            max_contact_force_n: 10.0,
        };
        let (run_id, image) = (0x1234_5678, 7);
        let command = crate::judge::test_recording::image_row(
            image,
            true,
            Some(sonoloop_types::TrackState::Tracking),
            0.0,
        )
        .command
        .unwrap();
        let honest = CommandMessage::encode(run_id, &command);
        assert!(matches!(Answer::read(&honest, run_id, Some(image)), Answer::Command(_)));
        let mut refusals = std::collections::BTreeMap::new();
        let mut word = 1u64;
        for _ in 0..4000 {
            let words = std::array::from_fn(|_| {
                // Knuth's generator: its high bits are good, so they are brought down.
                word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                word.rotate_left(32)
            });
            for honest in [honest, CommandMessage::default()] {
                let name = match Answer::read(&garbage(&honest, &words, &limits), run_id, Some(image)) {
                    Answer::Refused(receipt) => format!("{:?}", receipt.refused.unwrap()),
                    Answer::Command(command) => {
                        assert!(!(0.0..=limits.max_feed_m_s).contains(&command.feed_m_s), "{command:?}");
                        "OutOfLimits".to_owned()
                    }
                };
                *refusals.entry(name).or_insert(0) += 1;
            }
        }
        let kinds: Vec<&str> = refusals.keys().map(String::as_str).collect();
        assert_eq!(
            kinds,
            ["Malformed", "NotFinite", "OtherRun", "OutOfLimits", "UnknownImage"],
            "{refusals:?}"
        );
    }
}
