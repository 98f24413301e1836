//! A point that echoes.

use crate::beam::Beam;

/// One echo, elevational weight included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    pub x_m: f64,
    pub z_m: f64,
    /// How much farther down the echo is drawn, having gone to and fro.
    pub late_m: f64,
    /// Amplitude over unit speckle, without the phase of its depth.
    pub re: f64,
    pub im: f64,
    /// The needle's own shadow is not on it: it comes from inside the steel, or its level is stated as it is seen.
    pub unshaded: bool,
}

impl Echo {
    /// Complex amplitude of the baseband field, drawn `delay_m` below its own place.
    pub fn baseband(&self, beam: &Beam, delay_m: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(-beam.two_k_rad_m * (self.z_m + self.late_m + delay_m));
        [self.re * cos - self.im * sin, self.re * sin + self.im * cos]
    }
}
