/// A round part of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Its middle (u, v), pixels.
    pub centre_px: [f64; 2],
    /// How far it reaches, pixels.
    pub radius_px: f64,
}

impl Disc {
    /// Whether a place lies in it; one that is no number does not.
    pub fn contains(&self, [u, v]: [f64; 2]) -> bool {
        let (du, dv) = (u - self.centre_px[0], v - self.centre_px[1]);
        (du * du + dv * dv).sqrt() <= self.radius_px
    }
}
