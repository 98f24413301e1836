//! Where the optimiser starts in the next image.

use sonoloop_types::{Guess, TrackerSettings};

use crate::kalman::{Kalman, Noise};
use crate::tracker::add;

/// Of the Kalman filter. A registered tip is a fraction of a pixel off; at 10 mm/s and 25 images per second a needle makes
/// 4 px per image, and takes a few images to come to that speed. The filter settles to gains of 0.83 for the position and
/// 0.69 for the velocity: in the third image after a needle starts the guess is less than a tenth of its step off.
const NOISE: Noise = Noise { acceleration_px: 0.5, measurement_px: 0.3, first_velocity_px: 4.0 };

/// Guesses the tip's next place from where it was tracked before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Guesser {
    guess: Guess,
    /// m of v ← m·v + (1 − m)·d.
    memory: f64,
    velocity_px: [f64; 2],
    kalman: Kalman,
}

impl Guesser {
    /// For a tip at rest.
    pub fn new(settings: &TrackerSettings, tip_px: [f64; 2]) -> Self {
        Self {
            guess: settings.guess,
            memory: settings.velocity_memory,
            velocity_px: [0.0; 2],
            kalman: Kalman::new(tip_px, NOISE),
        }
    }

    /// Where a tip last tracked at `tip_px` is expected, if it has `measured_px` to go by what robot and arm have measured.
    pub fn place_px(&self, tip_px: [f64; 2], measured_px: Option<[f64; 2]>) -> [f64; 2] {
        match self.guess {
            Guess::None => tip_px,
            Guess::ConstantVelocity => add(tip_px, self.velocity_px),
            Guess::Kalman => {
                let mut ahead = self.kalman;
                ahead.predict();
                ahead.tip_px
            }
            Guess::Insertion => add(tip_px, measured_px.unwrap_or(self.velocity_px)),
        }
    }

    /// The next image was tracked, and the tip has gone from one place to another.
    pub fn moved(&mut self, from_px: [f64; 2], to_px: [f64; 2]) {
        let moved_px = add(to_px, from_px.map(|c| -c));
        let kept = self.memory;
        self.velocity_px = add(self.velocity_px.map(|v| kept * v), moved_px.map(|d| (1.0 - kept) * d));
        self.kalman.predict();
        self.kalman.correct(to_px);
    }

    /// The tip was found anew; what it did before says nothing of what it will do.
    pub fn rest(&mut self, tip_px: [f64; 2]) {
        self.velocity_px = [0.0; 2];
        self.kalman = Kalman::new(tip_px, NOISE);
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_types::Profile;

    use super::*;

    const ALL: [Guess; 4] = [Guess::None, Guess::ConstantVelocity, Guess::Kalman, Guess::Insertion];

    fn guesser(guess: Guess) -> Guesser {
        Guesser::new(
            &TrackerSettings { guess, ..TrackerSettings::profile(Profile::Robust, 20) },
            [10.0, 20.0],
        )
    }

    #[test]
    fn a_tip_at_rest_is_expected_where_it_was() {
        for guess in ALL {
            assert_eq!(guesser(guess).place_px([10.0, 20.0], None), [10.0, 20.0], "{guess:?}");
        }
    }

    #[test]
    fn only_the_insertion_guess_takes_what_was_measured() {
        for guess in ALL {
            let place = guesser(guess).place_px([10.0, 20.0], Some([3.0, -1.0]));
            let expected = if guess == Guess::Insertion { [13.0, 19.0] } else { [10.0, 20.0] };
            assert_eq!(place, expected, "{guess:?}");
        }
    }

    #[test]
    fn truth_a_steady_motion_is_expected_to_go_on() {
        let [velocity, start] = [[2.2, -0.7], [10.0, 20.0]];
        let at = |k: f64| [start[0] + k * velocity[0], start[1] + k * velocity[1]];
        for guess in ALL {
            let mut guesser = guesser(guess);
            for k in 0..40 {
                guesser.moved(at(f64::from(k)), at(f64::from(k + 1)));
            }
            let place = guesser.place_px(at(40.0), None);
            let expected = if guess == Guess::None { at(40.0) } else { at(41.0) };
            // What the first guess at rest leaves in the smoothed velocity is 0.7⁴⁰ of it.
            assert!(place.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{guess:?}: {place:?}");
            guesser.rest([5.0, 6.0]);
            assert_eq!(guesser.place_px([5.0, 6.0], None), [5.0, 6.0], "{guess:?}");
        }
    }

    #[test]
    fn truth_the_filter_has_the_speed_two_images_after_a_start() {
        let mut guesser = guesser(Guess::Kalman);
        let at = |k: i32| [10.0 + 4.0 * f64::from(k.max(0)), 20.0];
        for k in -40..2 {
            guesser.moved(at(k), at(k + 1));
        }
        let place = guesser.place_px(at(2), None);
        assert!((place[0] - at(3)[0]).abs() < 0.4 && place[1] == 20.0, "{place:?}");
    }

    #[test]
    fn truth_the_smoothed_velocity_of_one_motion_is_three_tenths_of_it() {
        let mut guesser = guesser(Guess::ConstantVelocity);
        guesser.moved([10.0, 20.0], [14.0, 22.0]);
        let place = guesser.place_px([14.0, 22.0], None);
        assert!((place[0] - 15.2).abs() < 1e-12 && (place[1] - 22.6).abs() < 1e-12, "{place:?}");
    }
}
