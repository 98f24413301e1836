//! Does the shaft go on beyond a candidate? A tip has none ahead of it; a bright bead of the shaft has.
//!
//! Blurred and narrowly weighted, a bead of the shaft looks much like the tip to any correlation. What tells them
//! apart lies outside the template: along the needle's direction a ridge stands ahead of a bead, and not ahead of a
//! tip. The direction comes from nominal calibrations, so it may be some degrees off.
//!
//! Of rendered 22G needles (the paper's lateral 02 to 05, 10, 13 and 16, two seeds each), places moved onto the brightest spot near by: a
//! tip is taken for a bead in under 1 of 1000, a bead is told 8 px behind the tip in 46 %, at 16 to 20 px in 77 to 85 %, from 30 px on in
//! 93 to 99. Of 12G ones and a few more 22G (224 tips, none taken for a bead) 72 to 84 % up to 20 px, but 52 to 70 % farther behind.

use sonoloop_types::Image;

/// Stretch along the needle in which the ridge is looked for, pixels from the candidate.
const STRETCH_PX: [u32; 2] = [8, 24];
/// Half-width of the ridge's average, and distance of the two strips beside it that it is compared with.
const HALF_WIDTH_PX: i32 = 1;
const BESIDE_PX: f64 = 7.0;
/// A ridge below this many grey levels over its surroundings is speckle (its mean over the stretch scatters by
/// about four).
const LEAST_RIDGE_LEVELS: f64 = 12.0;
/// Share of the stronger of two ridges, ahead and behind, from which the other counts as the same shaft.
const SAME_SHAFT: f64 = 0.5;

/// A shaft bends, and a candidate may lie beside its middle: lines are tried that are turned by up to so many steps off the
/// direction that is told, to either side, and moved aside by so many pixels.
const TURNS: i32 = 3;
const TURN_RAD: f64 = 3.0 / 180.0 * core::f64::consts::PI;
const ASIDE_PX: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
const LINES: usize = (2 * TURNS + 1) as usize * ASIDE_PX.len();
/// Share of the strongest ridge behind from which a line fits the shaft too.
const FITS: f64 = 0.8;

/// A place on a line, and its direction.
type Line = [[f64; 2]; 2];

/// True when the shaft runs on beyond `at_px` along `axis_px` (unit vector from the entry to the tip, pixels, some degrees off at
/// most): ahead on one of the lines that fit what lies behind.
pub(crate) fn goes_on(image: &Image, at_px: [f64; 2], axis_px: [f64; 2]) -> bool {
    let lines = lines(at_px, axis_px);
    let behind = lines.map(|[from_px, [u, v]]| ridge(image, from_px, [-u, -v]));
    let strongest = behind.iter().copied().flatten().reduce(f64::max);
    let ahead = match strongest {
        Some(strongest) => {
            let fitting =
                lines.iter().zip(behind).filter(|(_, behind)| behind.is_some_and(|b| b >= FITS * strongest));
            fitting.filter_map(|(&[from_px, along], _)| ridge(image, from_px, along)).reduce(f64::max)
        }
        None => ridge(image, at_px, axis_px),
    };
    let Some(ahead) = ahead.filter(|&ahead| ahead > LEAST_RIDGE_LEVELS) else { return false };
    // A shaft lies behind the place too, where that can be seen: a ridge ahead alone is speckle.
    strongest.is_none_or(|behind| ahead > SAME_SHAFT * behind && behind > SAME_SHAFT * ahead)
}

/// What may be the shaft's line, near a place and a direction.
fn lines(at_px: [f64; 2], [u, v]: [f64; 2]) -> [Line; LINES] {
    core::array::from_fn(|line| {
        let (sin, cos) = libm::sincos((line as i32 / ASIDE_PX.len() as i32 - TURNS) as f64 * TURN_RAD);
        let along = [cos * u - sin * v, sin * u + cos * v];
        let aside_px = ASIDE_PX[line % ASIDE_PX.len()];
        [[at_px[0] - aside_px * along[1], at_px[1] + aside_px * along[0]], along]
    })
}

/// Mean grey level along the axis less that of the brighter one of the strips beside it; `None` where most lies outside the picture.
/// Not less their mean: the strip that lies under the shaft is in its shadow, and would make a ridge of plain tissue.
fn ridge(image: &Image, from_px: [f64; 2], axis_px: [f64; 2]) -> Option<f64> {
    let across = [-axis_px[1], axis_px[0]];
    let (mut on, mut beside, mut count) = (0.0, [0.0; 2], 0.0);
    for step in STRETCH_PX[0]..STRETCH_PX[1] {
        for offset in -HALF_WIDTH_PX..=HALF_WIDTH_PX {
            let at = |aside: f64| {
                let (along, aside) = (f64::from(step), f64::from(offset) + aside);
                level(
                    image,
                    [
                        from_px[0] + along * axis_px[0] + aside * across[0],
                        from_px[1] + along * axis_px[1] + aside * across[1],
                    ],
                )
            };
            if let (Some(middle), Some(left), Some(right)) = (at(0.0), at(-BESIDE_PX), at(BESIDE_PX)) {
                on += middle;
                beside = [beside[0] + left, beside[1] + right];
                count += 1.0;
            }
        }
    }
    let whole = f64::from(STRETCH_PX[1] - STRETCH_PX[0]) * f64::from(2 * HALF_WIDTH_PX + 1);
    (count > whole / 2.0).then(|| (on - beside[0].max(beside[1])) / count)
}

fn level(image: &Image, at_px: [f64; 2]) -> Option<f64> {
    let (u, v) = (at_px[0].round(), at_px[1].round());
    let inside = u >= 0.0 && v >= 0.0 && u < f64::from(image.width_px) && v < f64::from(image.height_px);
    inside.then(|| f64::from(image.row(v as u32)[u as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ridge three pixels wide from the top left to (100, 100) on a plain ground.
    fn needle() -> Image {
        let mut image = Image::black(200, 200);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let (u, v) = ((index % 200) as i32, (index / 200) as i32);
            *pixel = if (u - v).abs() <= 2 && u <= 100 { 160 } else { 90 };
        }
        image
    }

    #[test]
    fn a_bead_of_the_shaft_is_told_from_the_tip() {
        let axis = [std::f64::consts::FRAC_1_SQRT_2; 2];
        assert!(!goes_on(&needle(), [100.0, 100.0], axis));
        assert!(goes_on(&needle(), [60.0, 60.0], axis));
        assert!(!goes_on(&needle(), [150.0, 60.0], axis), "off the needle nothing is decided");
    }

    #[test]
    fn a_streak_of_speckle_ahead_of_a_tip_is_no_shaft() {
        let axis = [-std::f64::consts::FRAC_1_SQRT_2; 2];
        // Seen from its other end the needle lies ahead, and nothing behind.
        assert!(!goes_on(&needle(), [102.0, 102.0], axis));
    }

    #[test]
    fn where_the_needle_comes_in_the_ridge_ahead_decides() {
        assert!(goes_on(&needle(), [6.0, 6.0], [std::f64::consts::FRAC_1_SQRT_2; 2]));
    }

    #[test]
    fn the_shadow_under_the_shaft_makes_no_ridge_ahead_of_its_tip() {
        let mut image = needle();
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let (u, v) = ((index % 200) as i32, (index / 200) as i32);
            // Below a dim shaft, and beyond its tip, as the beam is wide.
            if u <= 118 && v > u + 2 {
                *pixel = 50;
            } else if *pixel == 160 {
                *pixel = 105;
            }
        }
        let axis = [std::f64::consts::FRAC_1_SQRT_2; 2];
        assert!(!goes_on(&image, [100.0, 100.0], axis));
        assert!(goes_on(&image, [60.0, 60.0], axis));
    }

    #[test]
    fn a_bead_beside_the_middle_of_the_shaft_is_told_too() {
        let axis = [std::f64::consts::FRAC_1_SQRT_2; 2];
        for aside_px in [-2.0, -1.0, 1.0, 2.0] {
            let beside = |along: f64| [along - aside_px * axis[1], along + aside_px * axis[0]];
            assert!(goes_on(&needle(), beside(60.0), axis), "{aside_px}");
            assert!(!goes_on(&needle(), beside(100.0), axis), "{aside_px}");
        }
    }

    #[test]
    fn a_direction_five_degrees_off_does_not_matter() {
        let (sin, cos) = (libm::sin(50.0_f64.to_radians()), libm::cos(50.0_f64.to_radians()));
        assert!(!goes_on(&needle(), [100.0, 100.0], [cos, sin]));
        assert!(goes_on(&needle(), [60.0, 60.0], [cos, sin]));
    }

    #[test]
    fn a_shaft_that_bends_away_from_the_direction_is_seen_behind_the_tip() {
        // It comes in at 52°; ahead of the tip speckle stands half as high, in the direction that is told.
        let (tip, told) = ([100.0, 100.0], [core::f64::consts::FRAC_1_SQRT_2; 2]);
        let along = [52.0_f64.to_radians().cos(), 52.0_f64.to_radians().sin()];
        let mut image = Image::black(200, 200);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let off = [(index % 200) as f64 - tip[0], (index / 200) as f64 - tip[1]];
            let beside = |[u, v]: [f64; 2]| (off[0] * v - off[1] * u).abs();
            let ahead = off[0] + off[1] > 0.0;
            *pixel = if !ahead && beside(along) <= 1.5 { 130 } else { 90 };
            if ahead && beside(told) <= 2.5 {
                *pixel = 105;
            }
        }
        assert!(!goes_on(&image, tip, told));
        let behind = [tip[0] - 30.0 * along[0], tip[1] - 30.0 * along[1]];
        assert!(goes_on(&image, behind, told));
    }

    #[test]
    fn a_streak_ahead_in_another_direction_than_the_shaft_is_none() {
        // It comes in at 52°; the streak goes on at 33°.
        let tip = [100.0, 100.0];
        let [along, streak] =
            [52.0_f64, 33.0].map(|degrees| [degrees.to_radians().cos(), degrees.to_radians().sin()]);
        let mut image = Image::black(200, 200);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let off = [(index % 200) as f64 - tip[0], (index / 200) as f64 - tip[1]];
            let beside = |[u, v]: [f64; 2]| (off[0] * v - off[1] * u).abs() <= 1.5;
            let ahead = off[0] * streak[0] + off[1] * streak[1];
            *pixel = if ahead < 0.0 && beside(along) { 130 } else { 90 };
            if ahead >= 8.0 && beside(streak) {
                *pixel = 120;
            }
        }
        assert!(!goes_on(&image, tip, [core::f64::consts::FRAC_1_SQRT_2; 2]));
    }

    #[test]
    fn nothing_outside_the_picture_is_touched() {
        for at in [[-50.0, -50.0], [0.0, 0.0], [199.0, 199.0], [1e9, 1e9]] {
            goes_on(&needle(), at, [1.0, 0.0]);
        }
        goes_on(&Image::black(1, 1), [0.0, 0.0], [f64::NAN, 0.0]);
    }
}
