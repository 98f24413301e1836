//! Bytes that nobody meant: they may be refused or make sense, never panic and never pass nonsense.

mod common;

use common::{acquisition, command, image};
use sonoloop_types::Pose;
use sonoloop_wire::layout::{
    BlobHeader, CommandMessage, Defect, EndMessage, ImageHeader, LAYOUT_VERSION, ReadyMessage, TruthMessage,
};

const RUN: u64 = 7;
const ROUNDS: usize = 200_000;

/// xorshift64*, for values and for the choice of the fields that are spoilt.
struct Bits(u64);

impl Bits {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn spoil(&mut self) -> bool {
        self.next().is_multiple_of(8)
    }

    fn byte(&mut self, value: &mut u8) {
        if self.spoil() {
            *value = self.next() as u8 % 12;
        }
    }

    fn word(&mut self, value: &mut u32) {
        if self.spoil() {
            *value = self.next() as u32;
        }
    }

    /// Any bits at all, and often the ones that hurt.
    fn number(&mut self, value: &mut f64) {
        if self.spoil() {
            *value = match self.next() % 6 {
                0 => f64::NAN,
                1 => f64::INFINITY,
                2 => f64::NEG_INFINITY,
                3 => f64::MAX,
                _ => f64::from_bits(self.next()),
            };
        }
    }
}

fn assert_sound(pose: &Pose) {
    assert!(pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|value| value.is_finite()));
    assert!((pose.rotation.norm() - 1.0).abs() < 1e-5);
}

fn assert_optional(value: Option<f64>) {
    assert!(value.is_none_or(f64::is_finite));
}

#[test]
fn no_spoilt_command_passes_nonsense() {
    let mut bits = Bits(1);
    let (mut passed, mut refused) = (0, 0);
    for _ in 0..ROUNDS {
        let mut message = CommandMessage::encode(RUN, &command(3));
        bits.byte(&mut message.state);
        bits.byte(&mut message.reason);
        bits.byte(&mut message.has_target);
        bits.number(&mut message.tip_px[0]);
        bits.number(&mut message.tip_px[1]);
        bits.number(&mut message.ncc_previous);
        bits.number(&mut message.conditioning);
        let element = bits.next() as usize % 7;
        bits.number(&mut message.target_base_from_probe[element]);
        bits.number(&mut message.feed_m_s);
        if bits.spoil() {
            message.compute_us = f32::from_bits(bits.next() as u32);
        }
        match message.decode(RUN) {
            Ok(command) => {
                passed += 1;
                assert!(command.feed_m_s.is_finite() && command.compute_us.is_finite());
                assert!(command.estimate.tip_px.is_none_or(|tip| tip.iter().all(|value| value.is_finite())));
                assert_optional(command.estimate.ncc_previous);
                assert_optional(command.estimate.conditioning);
                if let Some(target) = command.target_base_from_probe {
                    assert_sound(&target);
                }
            }
            Err(_) => refused += 1,
        }
    }
    assert!(passed > ROUNDS / 20 && refused > ROUNDS / 20, "{passed} passed, {refused} refused");
}

#[test]
fn no_spoilt_image_header_passes_nonsense() {
    let mut bits = Bits(2);
    let picture = image(0);
    let (mut passed, mut refused) = (0, 0);
    for _ in 0..ROUNDS {
        let mut header = ImageHeader::encode(RUN, &acquisition(4), &picture, 1e-4, true);
        bits.word(&mut header.width_px);
        bits.word(&mut header.height_px);
        bits.byte(&mut header.arm_status);
        bits.byte(&mut header.receipt);
        bits.byte(&mut header.answer_due);
        bits.number(&mut header.spacing_m);
        let element = bits.next() as usize % 7;
        bits.number(&mut header.base_from_probe[element]);
        bits.number(&mut header.depth_m);
        bits.number(&mut header.contact_force_n);
        match header.decode(RUN, picture.pixels.len()) {
            Ok(received) => {
                passed += 1;
                assert_eq!(received.width_px as usize * received.height_px as usize, picture.pixels.len());
                assert!(received.spacing_m > 0.0 && received.spacing_m.is_finite());
                assert_sound(&received.acquisition.base_from_probe);
                assert_optional(received.acquisition.depth_m);
                assert!(received.acquisition.contact_force_n.is_finite());
            }
            Err(_) => refused += 1,
        }
    }
    assert!(passed > ROUNDS / 20 && refused > ROUNDS / 20, "{passed} passed, {refused} refused");
}

#[test]
fn every_message_of_another_version_or_run_is_refused() {
    let picture = image(0);
    for (version, run_id) in [(LAYOUT_VERSION + 1, RUN), (0, RUN), (LAYOUT_VERSION, RUN + 1)] {
        let expected = if version == LAYOUT_VERSION {
            Defect::OtherRun { found: run_id, expected: RUN }
        } else {
            Defect::Version { found: version }
        };
        let command = CommandMessage { version, run_id, ..CommandMessage::encode(RUN, &command(0)) };
        assert_eq!(command.decode(RUN), Err(expected));
        let header = ImageHeader::encode(RUN, &acquisition(0), &picture, 1e-4, true);
        let header = ImageHeader { version, run_id, ..header };
        assert_eq!(header.decode(RUN, picture.pixels.len()), Err(expected));
        let blob = BlobHeader { version, run_id, ..BlobHeader::default() };
        assert_eq!(blob.check(RUN), Err(expected));
        let ready = ReadyMessage { version, run_id, ..ReadyMessage::encode(RUN, "a", "b") };
        assert_eq!(ready.decode(RUN), Err(expected));
        let end = EndMessage { version, run_id, ..EndMessage::default() };
        assert_eq!(end.decode(RUN), Err(expected));
        let truth = TruthMessage { version, run_id, ..TruthMessage::default() };
        assert_eq!(truth.decode(RUN).map(|(truth, _)| truth.tick), Err(expected));
    }
}

#[test]
fn texts_are_cut_at_a_character_and_refused_when_they_would_reach_the_terminal() {
    let long = "é".repeat(40);
    let (name, version) = ReadyMessage::encode(RUN, &long, "").decode(RUN).unwrap();
    assert_eq!((name, version), ("é".repeat(32), String::new()));
    let mut message = ReadyMessage::encode(RUN, "\u{1b}[2J", "1");
    assert_eq!(message.decode(RUN), Err(Defect::Text { field: "name" }));
    message.name = [0xff; 64];
    assert_eq!(message.decode(RUN), Err(Defect::Text { field: "name" }));
}

#[test]
fn a_picture_must_have_the_bytes_that_its_header_says() {
    let picture = image(0);
    let header = ImageHeader::encode(RUN, &acquisition(0), &picture, 1e-4, true);
    for pixels in [0, picture.pixels.len() - 1, picture.pixels.len() + 1] {
        assert_eq!(header.decode(RUN, pixels), Err(Defect::Size { field: "height_px" }));
    }
    // The product would wrap in 32 bits.
    let wrapping = ImageHeader { width_px: 1 << 16, height_px: 1 << 16, ..header };
    assert_eq!(wrapping.decode(RUN, 0), Err(Defect::Size { field: "width_px" }));
}
