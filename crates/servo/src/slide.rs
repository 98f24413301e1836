//! Lateral: keep the tip in the picture by sliding along the array.

use sonoloop_types::{Point, ServoSettings};

/// Lateral slide of the probe over `dt_s` for a tip seen at `tip_in_probe`, along the probe's x, metres.
///
/// No motion inside the dead band; outside it the speed grows with the excess up to the set limit.
pub fn slide_m(settings: &ServoSettings, tip_in_probe: &Point, dt_s: f64) -> f64 {
    let excess_m =
        tip_in_probe.x - tip_in_probe.x.clamp(-settings.lateral_deadband_m, settings.lateral_deadband_m);
    (excess_m * settings.slide_gain_per_s).clamp(-settings.slide_speed_m_s, settings.slide_speed_m_s) * dt_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inside_the_dead_band_the_probe_rests_and_outside_it_follows() {
        let settings = crate::servo::tests::settings();
        let at = |x_mm: f64| Point::new(x_mm * 1e-3, 0.0, 0.02);
        assert_eq!(slide_m(&settings, &at(9.9), 0.04), 0.0);
        assert!(slide_m(&settings, &at(11.0), 0.04) > 0.0);
        assert!(slide_m(&settings, &at(-11.0), 0.04) < 0.0);
        let most_m = settings.slide_speed_m_s * 0.04;
        assert!((slide_m(&settings, &at(40.0), 0.04) - most_m).abs() < 1e-12);
    }
}
