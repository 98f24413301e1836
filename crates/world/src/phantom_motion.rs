//! The phantom moves as a whole: breathing, drift, a step.
//!
//! It shifts and does not turn. The needle is held by its robot and sits in the tissue: across its axis the tissue
//! carries it along, along its axis it stands, and the tissue slides on it. That neglects the shaft's stiffness, which
//! spreads a bend over some 30 mm of a 22G needle, ⁴√(4EI/k) with k = 15 kN/m². [derived]

use std::f64::consts::TAU;

use sonoloop_scenario::PhantomMotion;
use sonoloop_types::{TICKS_PER_SECOND, Vector};

/// All motions so far, each with the tick it began at.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motions(Vec<(u64, PhantomMotion)>);

impl Motions {
    pub(crate) fn add(&mut self, tick: u64, motion: PhantomMotion) {
        self.0.push((tick, motion));
    }

    /// Where the phantom is, minus where it began, world frame.
    pub(crate) fn shift_m(&self, tick: u64) -> Vector {
        self.0.iter().map(|(start, motion)| at(motion, tick.saturating_sub(*start))).sum()
    }
}

/// Shift of one motion so many ticks after it began; 0 at its first tick.
fn at(motion: &PhantomMotion, ticks: u64) -> Vector {
    match *motion {
        PhantomMotion::Breathing { reach_m, period_ticks, phase_rad } => {
            let level = |ticks: u64| {
                0.5 - 0.5 * libm::cos(TAU * (ticks % period_ticks) as f64 / period_ticks as f64 + phase_rad)
            };
            reach_m * (level(ticks) - level(0))
        }
        PhantomMotion::Drift { velocity_m_s, duration_ticks } => {
            velocity_m_s * (ticks.min(duration_ticks) as f64 / TICKS_PER_SECOND as f64)
        }
        PhantomMotion::Step { shift_m, duration_ticks } => shift_m * smooth(ticks, duration_ticks),
    }
}

/// Share of a smooth move that is done: 0 at its first tick, 1 after its duration.
pub(crate) fn smooth(elapsed_ticks: u64, duration_ticks: u64) -> f64 {
    if elapsed_ticks >= duration_ticks {
        return 1.0;
    }
    let t = elapsed_ticks as f64 / duration_ticks as f64;
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH_M: Vector = Vector::new(0.0, 1e-3, 4e-3);

    #[test]
    fn truth_breathing_returns_every_period_and_reaches_as_far_as_told() {
        for phase_rad in [0.0, 0.7, 3.0, 5.5] {
            let breathing = PhantomMotion::Breathing { reach_m: REACH_M, period_ticks: 4000, phase_rad };
            let z_m: Vec<f64> = (0..8000).map(|tick| at(&breathing, tick).z).collect();
            assert!(at(&breathing, 0) == Vector::zeros() && at(&breathing, 4000) == Vector::zeros());
            let most = z_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let least = z_m.iter().copied().fold(f64::INFINITY, f64::min);
            assert!((most - least - 4e-3).abs() < 1e-9, "{phase_rad}: {least} to {most}");
            // Fastest at mid-breath: π·reach/period.
            let fastest = z_m.windows(2).map(|z| (z[1] - z[0]).abs()).fold(0.0, f64::max);
            assert!((fastest * 1e3 / (std::f64::consts::PI * 1e-3) - 1.0).abs() < 1e-5, "{fastest}");
        }
    }

    #[test]
    fn truth_motions_add_up_and_end_where_they_were_sent() {
        let mut motions = Motions::default();
        motions.add(100, PhantomMotion::Drift { velocity_m_s: Vector::x() * 2e-3, duration_ticks: 500 });
        motions.add(200, PhantomMotion::Step { shift_m: Vector::y() * 3e-3, duration_ticks: 100 });
        assert_eq!(motions.shift_m(100), Vector::zeros());
        assert!((motions.shift_m(250) - Vector::new(0.3e-3, 1.5e-3, 0.0)).norm() < 1e-15);
        assert!((motions.shift_m(9000) - Vector::new(1e-3, 3e-3, 0.0)).norm() < 1e-15);
    }
}
