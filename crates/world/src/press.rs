//! Motion along the probe's axis: an admittance that turns a missing force into a speed.
//!
//! ẋ = (F_set − F)/(kτ): with the stiffness k of the phantom under the probe this closes like a first-order
//! lag of time constant τ, whatever the gel; the arm's own lag of some 10 ms leaves it well damped.

use crate::contact::Contact;

/// Time constant of force and height control. Assumed.
const TAU_S: f64 = 0.15;
/// Fastest approach under force control. Assumed.
const MAX_PRESS_SPEED_M_S: f64 = 0.01;
/// A force this near to the set force is left alone, so that a resting probe rests.
const DEAD_BAND_N: f64 = 0.01;

/// What the controller sees at one control step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PressInput {
    /// Contact force now.
    pub force_n: f64,
    /// Indentation of the face's centre, negative above the surface.
    pub centre_indentation_m: f64,
    /// Press now.
    pub press_m: f64,
    /// Height to which the probe is lifted, while it is.
    pub lift_m: Option<f64>,
}

/// Force control, or height control where nothing bears a force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Press {
    set_force_n: f64,
    max_force_n: f64,
    max_speed_m_s: f64,
    /// Press held over a liquid.
    held_press_m: f64,
    retreating: bool,
}

impl Press {
    pub(crate) fn new(set_force_n: f64, max_force_n: f64, max_speed_m_s: f64, held_press_m: f64) -> Self {
        Self { set_force_n, max_force_n, max_speed_m_s, held_press_m, retreating: false }
    }

    /// True when this force is the first above the limit; the controller then backs off until the set
    /// force is reached from above.
    pub(crate) fn watch(&mut self, force_n: f64) -> bool {
        let exceeded = force_n > self.max_force_n && !self.retreating;
        self.retreating |= exceeded;
        exceeded
    }

    /// Speed along the probe's z, positive into the tissue.
    pub(crate) fn rate_m_s(&mut self, contact: &Contact, now: &PressInput) -> f64 {
        let within = |speed: f64, limit: f64| speed.clamp(-limit, limit);
        if now.force_n <= self.set_force_n {
            self.retreating = false;
        }
        if let Some(height_m) = now.lift_m {
            return within((-height_m - now.centre_indentation_m) / TAU_S, self.max_speed_m_s);
        }
        if self.retreating {
            return -self.max_speed_m_s;
        }
        let gentle = MAX_PRESS_SPEED_M_S.min(self.max_speed_m_s);
        match contact.stiffness_n_m {
            Some(stiffness) => {
                let missing_n = self.set_force_n - now.force_n;
                if missing_n.abs() < DEAD_BAND_N {
                    return 0.0;
                }
                within(missing_n / (stiffness * TAU_S), gentle)
            }
            None => {
                let missing_m = self.held_press_m - now.press_m;
                if missing_m.abs() < 1e-7 { 0.0 } else { within(missing_m / TAU_S, gentle) }
            }
        }
    }
}
