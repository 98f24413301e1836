use embedded_graphics::pixelcolor::Rgb888;
use sonoloop_types::TrackState;

/// Colours of the overlay beside greys. The animated picture keeps palette entries for exactly these, so
/// the overlay must draw with nothing else.
pub(super) const COLOURS: [Rgb888; 8] =
    [TRACKING, LOST, RECOVERING, SEARCHING, TRUTH, DARK_GREEN, DARK_RED, DARK_AMBER];

pub(super) const TRACKING: Rgb888 = Rgb888::new(64, 214, 96);
pub(super) const LOST: Rgb888 = Rgb888::new(255, 82, 74);
pub(super) const RECOVERING: Rgb888 = Rgb888::new(255, 184, 28);
pub(super) const SEARCHING: Rgb888 = Rgb888::new(104, 168, 255);
/// Everything that only the judge knows.
pub(super) const TRUTH: Rgb888 = Rgb888::new(64, 224, 232);
pub(super) const DARK_GREEN: Rgb888 = Rgb888::new(24, 84, 40);
pub(super) const DARK_RED: Rgb888 = Rgb888::new(110, 34, 30);
pub(super) const DARK_AMBER: Rgb888 = Rgb888::new(108, 78, 14);

/// A grey of the panels and texts.
pub(super) const fn grey(level: u8) -> Rgb888 {
    Rgb888::new(level, level, level)
}

/// Colour of a state; grey while the tracker is down.
pub(super) fn of_state(state: Option<TrackState>) -> Rgb888 {
    match state {
        Some(TrackState::Tracking) => TRACKING,
        Some(TrackState::Lost) => LOST,
        Some(TrackState::Recovering) => RECOVERING,
        Some(TrackState::Searching) => SEARCHING,
        None => grey(120),
    }
}
