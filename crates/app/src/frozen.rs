//! Is the scanner still alive? A picture that stands while the rig moves shows nothing of now.

use sonoloop_types::{Acquisition, Command, Estimate, Image, Reason, TrackState};

/// The rig has moved when needle or probe measure this much farther than with the first of equal pictures: a quarter of
/// what a needle at 10 mm/s travels between images, and a hundred times what a resting rig measures.
const MOVED_M: f64 = 0.1e-3;
/// Half the length of a linear array, about.
const HALF_ARRAY_M: f64 = 20e-3;
/// So often a picture may come again: a scanner slower than the images, down to a third of their rate, is alive.
const REPEATS: u32 = 2;

/// What was answered to the last picture that was new.
#[derive(Debug)]
pub struct Frozen {
    last: Option<Last>,
    repeats: u32,
    /// New pictures until a tip that is tracked again after a loss counts as found.
    unconfirmed: u32,
    /// How many that takes.
    confirmation_images: u32,
}

#[derive(Debug)]
struct Last {
    image: Image,
    acquisition: Acquisition,
    command: Command,
}

impl Frozen {
    /// Nothing seen yet.
    pub fn new(confirmation_images: u32) -> Self {
        Self { last: None, repeats: 0, unconfirmed: 0, confirmation_images }
    }

    /// The answer to a picture that is the last one again although the rig has moved since; `None` for any other. The
    /// first ones are answered as it was; from the third on the tip is LOST, the needle stops, and the arm stays, as
    /// nobody sees where either goes.
    pub fn answer(&mut self, acquisition: &Acquisition, image: &Image) -> Option<Command> {
        let last = self.last.as_ref().filter(|last| last.moved(acquisition) && last.image == *image)?;
        self.repeats += 1;
        let again = Command { answers: acquisition.sequence, compute_us: 0.0, ..last.command };
        if self.repeats <= REPEATS {
            return Some(again);
        }
        let was = again.estimate;
        self.unconfirmed = self.confirmation_images;
        let state = if was.state == TrackState::Searching { was.state } else { TrackState::Lost };
        let estimate = Estimate::bare(state, Reason::Frozen, was.tip_px);
        Some(Command { estimate, target_base_from_probe: None, feed_m_s: 0.0, ..again })
    }

    /// What `command`, the answer to a new picture, comes to: after a loss the first pictures that show the tip confirm it
    /// while the needle waits, as after any other.
    pub fn confirm(&mut self, command: Command) -> Command {
        if command.estimate.state != TrackState::Tracking || self.unconfirmed <= 1 {
            self.unconfirmed = 0;
            return command;
        }
        self.unconfirmed -= 1;
        let (state, reason) = (TrackState::Recovering, Reason::Candidate);
        Command { estimate: Estimate { state, reason, ..command.estimate }, feed_m_s: 0.0, ..command }
    }

    /// Remembers what was answered to a new picture.
    pub fn remember(&mut self, acquisition: &Acquisition, image: &Image, command: &Command) {
        self.repeats = 0;
        let (acquisition, command) = (*acquisition, *command);
        match &mut self.last {
            // A picture that stands with the rig is as old as the first of its kind.
            Some(last) if last.image == *image => last.command = command,
            Some(last) => {
                last.image.clone_from(image);
                (last.acquisition, last.command) = (acquisition, command);
            }
            None => self.last = Some(Last { image: image.clone(), acquisition, command }),
        }
    }
}

impl Last {
    /// True when the rig measures something else than with this picture.
    fn moved(&self, now: &Acquisition) -> bool {
        let then = &self.acquisition;
        let probe_m =
            (now.base_from_probe.translation.vector - then.base_from_probe.translation.vector).norm();
        // A turn counts by what it moves at the end of an array.
        let turn_rad = now.base_from_probe.rotation.angle_to(&then.base_from_probe.rotation);
        let needle_m = now.depth_m.zip(then.depth_m).map_or(0.0, |(now, then)| (now - then).abs());
        probe_m.max(needle_m).max(turn_rad * HALF_ARRAY_M) > MOVED_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::test_recording::image_row;

    fn picture(level: u8) -> Image {
        Image { width_px: 4, height_px: 2, pixels: vec![level; 8] }
    }

    /// One image: a needle at this depth, a picture of this level. The answer, when it is not simply the tracker's.
    fn see(frozen: &mut Frozen, sequence: u64, depth_mm: f64, level: u8) -> Option<Command> {
        let row = image_row(sequence, true, Some(TrackState::Tracking), 0.0);
        let acquisition = Acquisition { depth_m: Some(depth_mm * 1e-3), ..row.acquisition };
        let answer = frozen.answer(&acquisition, &picture(level));
        if answer.is_none() {
            let command = frozen.confirm(Command { feed_m_s: 0.01, ..row.command.unwrap() });
            frozen.remember(&acquisition, &picture(level), &command);
            return (command.feed_m_s == 0.0).then_some(command);
        }
        answer
    }

    #[test]
    fn a_needle_that_moves_on_in_a_picture_that_stands_is_stopped_with_the_third() {
        let mut frozen = Frozen::new(3);
        assert_eq!(see(&mut frozen, 0, 20.0, 7), None);
        for sequence in 1..=2 {
            let again = see(&mut frozen, sequence, 20.0 + 0.4 * sequence as f64, 7).unwrap();
            assert_eq!((again.answers, again.feed_m_s), (sequence, 0.01));
            assert_eq!(again.estimate.state, TrackState::Tracking);
        }
        let stopped = see(&mut frozen, 3, 21.2, 7).unwrap();
        assert_eq!((stopped.estimate.state, stopped.estimate.reason), (TrackState::Lost, Reason::Frozen));
        assert_eq!((stopped.answers, stopped.feed_m_s, stopped.target_base_from_probe), (3, 0.0, None));
        // The needle stands by now, but not where the picture shows it.
        assert!(see(&mut frozen, 4, 21.2, 7).is_some());
        // Three new pictures confirm the tip.
        for sequence in [5, 6] {
            let waits = see(&mut frozen, sequence, 21.2, sequence as u8 + 10).unwrap();
            assert_eq!((waits.estimate.state, waits.feed_m_s), (TrackState::Recovering, 0.0));
        }
        assert_eq!(see(&mut frozen, 7, 21.2, 8), None);
        assert!(see(&mut frozen, 8, 21.6, 8).is_some_and(|again| again.feed_m_s == 0.01));
    }

    #[test]
    fn a_picture_may_stand_with_the_rig_and_a_slow_scanner_repeat_itself() {
        let mut frozen = Frozen::new(3);
        for sequence in 0..10 {
            assert_eq!(see(&mut frozen, sequence, 20.0, 7), None);
        }
        // Eight pictures a second, five and twenty images.
        for sequence in 10..100 {
            let answer = see(&mut frozen, sequence, 20.0 + 0.4 * sequence as f64, (sequence / 3) as u8);
            assert!(answer.is_none_or(|again| again.estimate.state == TrackState::Tracking), "{sequence}");
        }
    }
}
