use sonoloop_types::{Estimate, Pose, Reason, TICKS_PER_SECOND, TrackState};

use crate::record::ImageRow;

/// Below this the probe has not been moved by the search.
const STILL_M: f64 = 5e-5;
const STILL_RAD: f64 = 0.005;

/// Tells what the tracker does, in words. Knows what a rig measures, not the truth.
#[derive(Debug, Default)]
pub(super) struct Teller {
    state: Option<TrackState>,
    since_s: f64,
    /// Why the tip was lost and where the probe was then.
    lost: Option<(String, Pose)>,
}

impl Teller {
    /// One line for an image.
    pub fn tell(&mut self, row: &ImageRow) -> String {
        let now_s = row.acquisition.acquisition_tick as f64 / TICKS_PER_SECOND as f64;
        let state = row.state();
        if state != self.state {
            (self.state, self.since_s) = (state, now_s);
        }
        let needle = match row.acquisition.feed_m_s {
            Some(feed_m_s) if feed_m_s > 5e-5 => format!("needle at {:.1} mm/s", feed_m_s * 1e3),
            Some(_) => "needle stopped".to_owned(),
            None => match row
                .command
                .filter(|command| command.feed_m_s > 0.0)
                .map(|command| command.estimate.state)
            {
                Some(TrackState::Tracking) => "hand may go on".to_owned(),
                Some(_) => "hand asked to go on slowly".to_owned(),
                None => "hand asked to stop".to_owned(),
            },
        };
        let Some(estimate) = row.command.map(|command| command.estimate) else {
            return format!("no answer from the tracker; {needle}");
        };
        match estimate.state {
            TrackState::Searching => format!("looking for the tip; {needle}"),
            TrackState::Tracking => {
                self.lost = None;
                format!(
                    "tracking since {:.1} s: NCC {}; {needle}",
                    self.since_s,
                    number(estimate.ncc_previous)
                )
            }
            TrackState::Lost => {
                let pose = row.acquisition.base_from_probe;
                let since_s = self.since_s;
                let (why, from) = self.lost.get_or_insert_with(|| (why(&estimate), pose));
                format!("lost at {since_s:.1} s: {why}; {needle}; {}", searching(from, &pose))
            }
            TrackState::Recovering => {
                format!(
                    "candidate since {:.1} s, being confirmed: NCC {}; {needle}",
                    self.since_s,
                    number(estimate.ncc_anchor)
                )
            }
        }
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.2}"))
}

fn why(estimate: &Estimate) -> String {
    match estimate.reason {
        Reason::NccPrevious => format!("NCC {} with the last image", number(estimate.ncc_previous)),
        Reason::NccAnchor => format!("NCC {} with the first image", number(estimate.ncc_anchor)),
        Reason::Brightness => format!("brightness off by {}", number(estimate.brightness_ratio)),
        Reason::OutOfImage => "the tip left the picture".to_owned(),
        Reason::Diverged => "the match ran away".to_owned(),
        Reason::Singular => "nothing to hold on to".to_owned(),
        Reason::Restarted => "tracker restarted".to_owned(),
        Reason::Frozen => "the picture stands still".to_owned(),
        Reason::Ok | Reason::NoCandidate | Reason::Candidate => {
            format!("NCC {}", number(estimate.ncc_previous.or(estimate.ncc_anchor)))
        }
    }
}

/// How far the search has moved the probe, by what the arm measures.
fn searching(from: &Pose, to: &Pose) -> String {
    let moved = from.inverse() * to;
    let (elevation_m, yaw_rad) = (moved.translation.y, moved.rotation.scaled_axis().z);
    let mut words = "searching".to_owned();
    if elevation_m.abs() > STILL_M {
        words += &format!(" {:+.1} mm", elevation_m * 1e3);
    }
    if yaw_rad.abs() > STILL_RAD {
        words += &format!(" {:+.1}°", yaw_rad.to_degrees());
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::test_recording::image_row;

    fn row(k: u64, state: Option<TrackState>, elevation_m: f64) -> ImageRow {
        let mut row = image_row(k, true, state, 0.0);
        row.acquisition.base_from_probe = Pose::translation(0.0, elevation_m, 0.0);
        row.acquisition.feed_m_s = Some(if state == Some(TrackState::Tracking) { 0.01 } else { 0.0 });
        if let Some(command) = &mut row.command {
            command.estimate.ncc_previous = Some(0.61);
            command.estimate.reason = Reason::NccPrevious;
        }
        row
    }

    #[test]
    fn a_loss_is_told_with_its_time_its_reason_and_the_way_of_the_search() {
        let mut teller = Teller::default();
        assert_eq!(
            teller.tell(&row(0, Some(TrackState::Tracking), 0.0)),
            "tracking since 0.0 s: NCC 0.61; needle at 10.0 mm/s"
        );
        teller.tell(&row(25, Some(TrackState::Lost), 0.0));
        let told = teller.tell(&row(50, Some(TrackState::Lost), 1e-3));
        assert_eq!(told, "lost at 1.0 s: NCC 0.61 with the last image; needle stopped; searching +1.0 mm");
        assert_eq!(teller.tell(&row(51, None, 0.0)), "no answer from the tracker; needle stopped");
    }
}
