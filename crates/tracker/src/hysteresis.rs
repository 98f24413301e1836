//! What loses a tip, what finds it again, and how long it takes until that is believed. No pixels here.

use sonoloop_types::{Confirmation, Reason, TrackState, TrackerSettings, UpdateStrategy};

/// Images after a confirmed recovery for which NCC with T_n does not count: T_n was just refreshed from a view
/// that may still be settling, and the paper's recovery threshold lies below its loss threshold.
const HOLD_PREVIOUS_TEST: u32 = 2;
/// Share of the first template's contrast below which the tip is gone. With a tip some 28 dB over the
/// speckle on a logarithmic display, one half is left at −14 dB: 1.8 σ of the elevational beam off the plane.
const LOSS_PRESENCE: f64 = 0.5;
/// A candidate needs more of the tip's contrast than a tracked tip may fall to: hysteresis, and speckle in a bright
/// inclusion reaches one half.
const RECOVERY_PRESENCE: f64 = 0.7;
/// Share of the contrast at which the tip is there whatever its surroundings look like. Where the edge of a shadow cuts the
/// shaft, the false end has 0.75 to 0.9 of it: with 0.75 here all trackers stayed at a shadow that comes from ahead (`docs/where_it_breaks.md`),
/// with 0.9 a quarter to a third do.
const PLAIN_PRESENCE: f64 = 0.9;

/// A registered place, compared with both templates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub ncc_previous: Option<f64>,
    pub ncc_anchor: Option<f64>,
    pub brightness_ratio: Option<f64>,
    pub presence: Option<f64>,
    pub level: f64,
}

impl View {
    /// Whether the brightness test fails: too little of T_1's contrast is left, or the patch differs
    /// too much from T_1 and does not plainly stand out either. (A tip that passes through a brighter or darker
    /// inclusion differs from T_1 all around and is there none the less.)
    fn is_faded(&self, settings: &TrackerSettings, least_presence: f64) -> bool {
        let Some(ratio_limit) = settings.loss_brightness_ratio else { return false };
        let presence = self.presence.unwrap_or(0.0);
        let differs = self.brightness_ratio.is_none_or(|ratio| ratio > ratio_limit);
        presence < least_presence || (differs && presence < PLAIN_PRESENCE)
    }
}

/// The state, and the counts that it hangs on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hysteresis {
    state: TrackState,
    /// Images that ended LOST since the last one TRACKING.
    lost_images: u32,
    /// Images that have confirmed the candidate.
    confirmed: u32,
    /// Images for which the test of T_n is still held off.
    hold_previous: u32,
}

impl Hysteresis {
    pub fn new(state: TrackState) -> Self {
        Self { state, lost_images: 0, confirmed: 0, hold_previous: 0 }
    }

    /// LOST for so many images already.
    pub fn lost_for(lost_images: u32) -> Self {
        Self { lost_images, ..Self::new(TrackState::Lost) }
    }

    /// TRACKING a tip that was just confirmed.
    pub fn recovered() -> Self {
        Self { hold_previous: HOLD_PREVIOUS_TEST, ..Self::new(TrackState::Tracking) }
    }

    pub fn state(&self) -> TrackState {
        self.state
    }

    pub fn lost_images(&self) -> u32 {
        self.lost_images
    }

    /// TRACKING: the first test that fails. A correlation that cannot be computed (a flat patch) counts as failed.
    pub fn loss(&self, settings: &TrackerSettings, view: &View) -> Option<Reason> {
        let below = |ncc: Option<f64>, threshold: f64| ncc.is_none_or(|ncc| ncc < threshold);
        if self.hold_previous == 0 && below(view.ncc_previous, settings.loss_ncc_previous) {
            Some(Reason::NccPrevious)
        } else if below(view.ncc_anchor, settings.loss_ncc_anchor) {
            Some(Reason::NccAnchor)
        } else if view.is_faded(settings, LOSS_PRESENCE) {
            Some(Reason::Brightness)
        } else {
            None
        }
    }

    /// Whether a place may be the lost tip.
    ///
    /// It must look like the first template, and like the last one too (the paper's own criterion), which after a loss is T_n as it was
    /// when it might itself have been found. And it must not be a place that the next images would lose again as it is: T_1
    /// stays, so its NCC must pass the test of losses whatever `recovery_ncc` is; T_n is refreshed from the place, so its NCC
    /// may be below that test, except where templates are never updated.
    pub fn accepts(settings: &TrackerSettings, view: &View) -> bool {
        let TrackerSettings { recovery_ncc, loss_ncc_previous, loss_ncc_anchor, .. } = *settings;
        let least_previous = match settings.update {
            UpdateStrategy::None => loss_ncc_previous,
            UpdateStrategy::Naive | UpdateStrategy::DriftCorrected => recovery_ncc.min(loss_ncc_previous),
        };
        view.ncc_anchor.is_some_and(|ncc| ncc >= recovery_ncc.max(loss_ncc_anchor))
            && view.ncc_previous.is_some_and(|ncc| ncc >= least_previous)
            && !view.is_faded(settings, RECOVERY_PRESENCE)
    }

    /// An image was TRACKING and has passed the tests.
    pub fn tracked(&mut self) {
        self.hold_previous = self.hold_previous.saturating_sub(1);
    }

    /// An image shows no tip.
    pub fn lost(&mut self) {
        *self = Self::lost_for(self.lost_images.saturating_add(1));
    }

    /// An image shows a place that may be the tip; whether it is confirmed now. `same`: the place that was RECOVERING already.
    pub fn candidate(&mut self, settings: &TrackerSettings, same: bool, confirmation: Confirmation) -> bool {
        self.state = TrackState::Recovering;
        self.confirmed = if same { self.confirmed } else { 0 };
        self.confirmed = self.confirmed.saturating_add(u32::from(confirmation != Confirmation::Held));
        confirmation == Confirmation::Confirms && self.confirmed >= settings.confirmation_images
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use sonoloop_types::Profile;

    use super::*;

    /// One image as the tracker goes through it.
    fn step(state: &mut Hysteresis, settings: &TrackerSettings, view: &View, confirmation: Confirmation) {
        if state.state() == TrackState::Tracking {
            match state.loss(settings, view) {
                Some(_) => state.lost(),
                None => state.tracked(),
            }
        } else if Hysteresis::accepts(settings, view) {
            let same = state.state() == TrackState::Recovering;
            if state.candidate(settings, same, confirmation) {
                *state = Hysteresis::recovered();
            }
        } else {
            state.lost();
        }
    }

    /// A view of a tip of full contrast, with these correlations.
    fn view(ncc_previous: f64, ncc_anchor: f64) -> View {
        View {
            ncc_previous: Some(ncc_previous),
            ncc_anchor: Some(ncc_anchor),
            brightness_ratio: Some(0.0),
            presence: Some(1.0),
            level: 100.0,
        }
    }

    fn any_confirmation() -> impl Strategy<Value = Confirmation> {
        prop_oneof![Just(Confirmation::Confirms), Just(Confirmation::Counts), Just(Confirmation::Held)]
    }

    fn any_view() -> impl Strategy<Value = View> {
        let ncc = || proptest::option::weighted(0.95, prop_oneof![-1.0..=1.0, 0.6..=0.95]);
        let ratio = || proptest::option::weighted(0.95, 0.0..=1.5);
        (ncc(), ncc(), ratio(), ratio()).prop_map(|(ncc_previous, ncc_anchor, brightness_ratio, presence)| {
            View { ncc_previous, ncc_anchor, brightness_ratio, presence, level: 100.0 }
        })
    }

    fn profiles() -> impl Strategy<Value = TrackerSettings> {
        prop_oneof![Just(Profile::Paper), Just(Profile::Robust)].prop_map(|p| TrackerSettings::profile(p, 20))
    }

    fn any_settings() -> impl Strategy<Value = TrackerSettings> {
        let ncc = || prop_oneof![-1.0..=1.0, Just(0.70), Just(0.75), Just(0.80), Just(0.85)];
        let update = prop_oneof![
            Just(UpdateStrategy::None),
            Just(UpdateStrategy::Naive),
            Just(UpdateStrategy::DriftCorrected)
        ];
        (profiles(), ncc(), ncc(), ncc(), 1_u32..5, update).prop_map(
            |(profile, loss_ncc_previous, loss_ncc_anchor, recovery_ncc, confirmation_images, update)| {
                TrackerSettings {
                    loss_ncc_previous,
                    loss_ncc_anchor,
                    recovery_ncc,
                    confirmation_images,
                    update,
                    ..profile
                }
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

        /// Under any settings a tip that was lost is believed after just the images that were asked for, each accepted and
        /// one after the other.
        #[test]
        fn nothing_is_tracked_again_before_it_is_confirmed(
            settings in any_settings(),
            views in prop::collection::vec((any_view(), any_confirmation()), 1..60),
        ) {
            let mut state = Hysteresis::new(TrackState::Tracking);
            let mut counted_in_a_row = 0;
            for (view, confirmation) in &views {
                let before = state.state();
                step(&mut state, &settings, view, *confirmation);
                let accepted = before != TrackState::Tracking && Hysteresis::accepts(&settings, view);
                counted_in_a_row = match confirmation {
                    _ if !accepted => 0,
                    Confirmation::Held => counted_in_a_row,
                    Confirmation::Counts | Confirmation::Confirms => counted_in_a_row + 1,
                };
                if before != TrackState::Tracking {
                    let enough = accepted
                        && *confirmation == Confirmation::Confirms
                        && counted_in_a_row >= settings.confirmation_images;
                    prop_assert_eq!(state.state() == TrackState::Tracking, enough);
                }
            }
        }

        /// Under either profile no correlations whatever make TRACKING, LOST, TRACKING, LOST of four images in a row. (A picture
        /// in which nothing can be correlated is a loss at once.)
        #[test]
        fn no_correlations_make_the_state_flap(
            settings in profiles(),
            nccs in prop::collection::vec((0.6..=1.0, -1.0..=1.0), 4..60),
        ) {
            use TrackState::{Lost, Tracking};
            let mut state = Hysteresis::new(Tracking);
            let mut states = vec![state.state()];
            for &(previous, anchor) in &nccs {
                step(&mut state, &settings, &view(previous, anchor), Confirmation::Confirms);
                states.push(state.state());
            }
            prop_assert!(!states.windows(4).any(|four| four == [Tracking, Lost, Tracking, Lost]), "{states:?}");
        }

        /// Under any settings a picture that stays as it is, is lost once at most and found again once at most. T_n becomes
        /// the picture itself when it is found, except where templates are never updated.
        #[test]
        fn a_picture_that_stays_settles(
            settings in any_settings(),
            ncc_previous in prop_oneof![-1.0..=1.0, 0.6..=0.95],
            ncc_anchor in prop_oneof![-1.0..=1.0, 0.6..=0.95],
            ratio in 0.0..=1.5,
            presence in 0.0..=1.5,
        ) {
            let mut state = Hysteresis::new(TrackState::Tracking);
            let mut seen = View { brightness_ratio: Some(ratio), presence: Some(presence), ..view(ncc_previous, ncc_anchor) };
            let mut losses = 0;
            for _ in 0..40 {
                let before = state.state();
                step(&mut state, &settings, &seen, Confirmation::Confirms);
                losses += u32::from(before == TrackState::Tracking && state.state() == TrackState::Lost);
                let found = before != TrackState::Tracking && state.state() == TrackState::Tracking;
                if found && settings.update != UpdateStrategy::None {
                    seen.ncc_previous = Some(1.0);
                }
            }
            prop_assert!(losses <= 1, "{losses} losses");
        }
    }
}
