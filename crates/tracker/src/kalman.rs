//! Constant-velocity Kalman filter of the tip, one filter per axis.
//!
//! State x = (position in px, velocity in px per image), F = (1 1; 0 1), measured is the position, with variance R = σ_z².
//! Between images the velocity changes by a random acceleration of standard deviation σ_a, which adds Q = σ_a² (¼ ½; ½ 1)
//! (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 6.3.2). The axes are
//! independent with the same noise, so both share one covariance.

/// Standard deviations that the filter weighs its measurements by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    /// σ_a, px per image².
    pub acceleration_px: f64,
    /// σ_z of a measured position per axis.
    pub measurement_px: f64,
    /// Of the velocity at the first fix.
    pub first_velocity_px: f64,
}

/// Estimate of a tip that moves steadily.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kalman {
    noise: Noise,
    /// Tip (u, v) in pixels.
    pub tip_px: [f64; 2],
    /// Its motion per image.
    pub velocity_px: [f64; 2],
    /// Variances of position, of both, and of velocity.
    covariance: [f64; 3],
}

impl Kalman {
    /// Begins at a first fix, at rest.
    pub fn new(tip_px: [f64; 2], noise: Noise) -> Self {
        let square = |sigma: f64| sigma * sigma;
        let covariance = [square(noise.measurement_px), 0.0, square(noise.first_velocity_px)];
        Self { noise, tip_px, velocity_px: [0.0; 2], covariance }
    }

    /// One image further on: x ← F x, P ← F P Fᵀ + Q.
    pub fn predict(&mut self) {
        let q = self.noise.acceleration_px * self.noise.acceleration_px;
        let [p, c, v] = self.covariance;
        self.tip_px = [0, 1].map(|axis| self.tip_px[axis] + self.velocity_px[axis]);
        self.covariance = [p + 2.0 * c + v + 0.25 * q, c + v + 0.5 * q, v + q];
    }

    /// Takes in a measured tip: K = P Hᵀ / (H P Hᵀ + R), x ← x + K (z − H x), P ← (I − K H) P.
    pub fn correct(&mut self, measured_px: [f64; 2]) {
        let [position_gain, velocity_gain] = self.gain();
        for (axis, measured) in measured_px.into_iter().enumerate() {
            let surprise = measured - self.tip_px[axis];
            self.tip_px[axis] += position_gain * surprise;
            self.velocity_px[axis] += velocity_gain * surprise;
        }
        let [p, c, v] = self.covariance;
        self.covariance = [(1.0 - position_gain) * p, (1.0 - position_gain) * c, v - velocity_gain * c];
    }

    /// K for the position and for the velocity.
    fn gain(&self) -> [f64; 2] {
        let [p, c, _] = self.covariance;
        let innovation = p + self.noise.measurement_px * self.noise.measurement_px;
        [p / innovation, c / innovation]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Noise = Noise { acceleration_px: 0.5, measurement_px: 2.0, first_velocity_px: 3.0 };

    #[test]
    fn truth_the_first_step_computed_by_hand() {
        let mut filter = Kalman::new([10.0, 20.0], NOISE);
        filter.predict();
        // P = (4 + 9 + ¼·¼, 9 + ½·¼, 9 + ¼) and R = 4.
        assert_eq!(filter.covariance, [13.0625, 9.125, 9.25]);
        let [position, velocity] = filter.gain();
        assert!((position - 13.0625 / 17.0625).abs() < 1e-15);
        assert!((velocity - 9.125 / 17.0625).abs() < 1e-15);
        filter.correct([12.0, 20.0]);
        assert!((filter.tip_px[0] - (10.0 + 2.0 * position)).abs() < 1e-12);
        assert!((filter.velocity_px[0] - 2.0 * velocity).abs() < 1e-12);
        assert_eq!(filter.tip_px[1], 20.0);
    }

    #[test]
    fn truth_a_steady_tip_is_followed_without_lag_and_the_gain_settles() {
        let mut filter = Kalman::new([0.0, 100.0], NOISE);
        for k in 1..=200 {
            filter.predict();
            filter.correct([2.2 * f64::from(k), 100.0 - 0.7 * f64::from(k)]);
        }
        assert!((filter.tip_px[0] - 440.0).abs() < 1e-6 && (filter.velocity_px[0] - 2.2).abs() < 1e-6);
        assert!((filter.tip_px[1] + 40.0).abs() < 1e-6 && (filter.velocity_px[1] + 0.7).abs() < 1e-6);
        // Steady state (the α–β filter, Bar-Shalom 6.5.3): with Λ = σ_a/σ_z = ¼,
        // α = −⅛ (Λ² + 8Λ − (Λ + 4)√(Λ² + 8Λ)) and β = ¼ (Λ² + 4Λ − Λ√(Λ² + 8Λ)).
        filter.predict();
        let index: f64 = NOISE.acceleration_px / NOISE.measurement_px;
        let root = (index * index + 8.0 * index).sqrt();
        let alpha = -0.125 * (index * index + 8.0 * index - (index + 4.0) * root);
        let beta = 0.25 * (index * index + 4.0 * index - index * root);
        let [position, velocity] = filter.gain();
        assert!((position - alpha).abs() < 1e-9 && (velocity - beta).abs() < 1e-9, "{position} {velocity}");
    }
}
