//! The ways a search may take: waypoints in elevation and yaw, as shares of the reach.

use serde::{Deserialize, Serialize};
use sonoloop_types::{SearchPattern, ServoSettings};

use super::Offset;

/// Along which coordinate a candidate is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Axis {
    /// Along the probe's y, metres.
    Elevation,
    /// About the probe's z through the last tip, radians.
    Yaw,
}

/// Turning points to and fro, as shares of the reach: the remembered side first, widening in thirds, back home.
const TO_AND_FRO: [f64; 7] = [0.3, -0.3, -0.6, 0.6, 1.0, -1.0, 0.0];
/// Directions of a turn of the spiral: (elevation, yaw), an eighth of a turn apart.
const TURN: [[f64; 2]; 8] = {
    const H: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [[1.0, 0.0], [H, H], [0.0, 1.0], [-H, H], [-1.0, 0.0], [-H, -H], [0.0, -1.0], [H, -H]]
};
/// Turns of the spiral.
const TURNS: usize = 3;

/// Waypoint `leg` of a pattern, from where the tip was lost; `None` after the last. The first one lies on `first_side`.
pub(super) fn waypoint(settings: &ServoSettings, first_side: f64, leg: usize) -> Option<Offset> {
    let elevation = |share: f64| Offset { elevation_m: share * settings.sweep_reach_m, yaw_rad: 0.0 };
    let yaw = |share: f64| Offset { elevation_m: 0.0, yaw_rad: share * settings.yaw_reach_rad };
    let count = TO_AND_FRO.len();
    let side = |leg: usize| first_side * TO_AND_FRO[leg];
    match settings.search {
        SearchPattern::Elevation => (leg < count).then(|| elevation(side(leg))),
        SearchPattern::Yaw => (leg < count).then(|| yaw(side(leg))),
        SearchPattern::ElevationThenYaw if leg < count => Some(elevation(side(leg))),
        SearchPattern::ElevationThenYaw => {
            (leg < 2 * count && settings.yaw_reach_rad > 0.0).then(|| yaw(side(leg - count)))
        }
        SearchPattern::Spiral => {
            let eighths = TURNS * TURN.len();
            let share = |leg: usize| (leg + 1) as f64 / eighths as f64;
            match leg {
                _ if leg < eighths => Some(spiral(settings, first_side, leg, share(leg))),
                // Once round at the full reach, then home.
                _ if leg < eighths + TURN.len() => Some(spiral(settings, first_side, leg, 1.0)),
                _ if leg == eighths + TURN.len() => Some(Offset::default()),
                _ => None,
            }
        }
    }
}

fn spiral(settings: &ServoSettings, first_side: f64, leg: usize, share: f64) -> Offset {
    let [elevation, yaw] = TURN[leg % TURN.len()];
    Offset {
        elevation_m: first_side * elevation * share * settings.sweep_reach_m,
        yaw_rad: yaw * share * settings.yaw_reach_rad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(search: SearchPattern) -> Vec<Offset> {
        let settings = ServoSettings { search, ..crate::servo::tests::settings() };
        (0..).map_while(|leg| waypoint(&settings, -1.0, leg)).collect()
    }

    #[test]
    fn every_pattern_ends_at_home_and_keeps_its_reach() {
        let settings = crate::servo::tests::settings();
        for search in [
            SearchPattern::Elevation,
            SearchPattern::Yaw,
            SearchPattern::ElevationThenYaw,
            SearchPattern::Spiral,
        ] {
            let way = all(search);
            assert_eq!(way.last().copied(), Some(Offset::default()), "{search:?}");
            let far = |of: fn(&Offset) -> f64| way.iter().map(|o| of(o).abs()).fold(0.0, f64::max);
            let (elevation_m, yaw_rad) = (far(|o| o.elevation_m), far(|o| o.yaw_rad));
            let used = |is: bool, reach: f64| if is { reach } else { 0.0 };
            let (sweeps, turns) = (search != SearchPattern::Yaw, search != SearchPattern::Elevation);
            assert!((elevation_m - used(sweeps, settings.sweep_reach_m)).abs() < 1e-12, "{search:?}");
            assert!((yaw_rad - used(turns, settings.yaw_reach_rad)).abs() < 1e-12, "{search:?}");
        }
    }

    #[test]
    fn the_remembered_side_comes_first() {
        for search in [SearchPattern::Elevation, SearchPattern::ElevationThenYaw, SearchPattern::Spiral] {
            assert!(all(search)[0].elevation_m < 0.0);
        }
        assert!(all(SearchPattern::Yaw)[0].yaw_rad < 0.0);
    }

    #[test]
    fn truth_no_point_of_the_spiral_is_farther_from_its_way_than_half_a_turns_pitch() {
        let settings = crate::servo::tests::settings();
        let way: Vec<[f64; 2]> = [[0.0; 2]]
            .into_iter()
            .chain(
                all(SearchPattern::Spiral)
                    .iter()
                    .map(|o| [o.elevation_m / settings.sweep_reach_m, o.yaw_rad / settings.yaw_reach_rad]),
            )
            .collect();
        // Turns lie a third of the reach apart; chords of an octagon sag by 1 − cos(π/8), 8 % of the radius.
        let bound = 0.5 / TURNS as f64 + 0.08;
        for k in 0..=400 {
            let (x, y) = (f64::from(k % 21) / 10.0 - 1.0, f64::from(k / 21) / 10.0 - 1.0);
            if x.hypot(y) > 0.9 {
                continue;
            }
            let near =
                way.windows(2).map(|leg| distance([x, y], leg[0], leg[1])).fold(f64::INFINITY, f64::min);
            assert!(near <= bound, "({x}, {y}): {near}");
        }
    }

    /// From a point to a stretch.
    fn distance(at: [f64; 2], from: [f64; 2], to: [f64; 2]) -> f64 {
        let (along, off) = ([to[0] - from[0], to[1] - from[1]], [at[0] - from[0], at[1] - from[1]]);
        let length = along[0].powi(2) + along[1].powi(2);
        let t = if length > 0.0 {
            ((off[0] * along[0] + off[1] * along[1]) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (off[0] - t * along[0]).hypot(off[1] - t * along[1])
    }
}
