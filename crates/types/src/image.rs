/// An 8-bit grey picture, rows from the transducer downwards.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// `height_px × width_px` grey levels, row by row.
    pub pixels: Vec<u8>,
}

impl Image {
    /// A black picture.
    pub fn black(width_px: u32, height_px: u32) -> Self {
        Self { width_px, height_px, pixels: vec![0; width_px as usize * height_px as usize] }
    }

    /// Takes over `pixels`; `None` when their number is not `width_px × height_px` or zero.
    pub fn from_pixels(width_px: u32, height_px: u32, pixels: Vec<u8>) -> Option<Self> {
        let expected = (width_px as usize).checked_mul(height_px as usize)?;
        (expected > 0 && pixels.len() == expected).then_some(Self { width_px, height_px, pixels })
    }

    /// One row of grey levels.
    pub fn row(&self, v: u32) -> &[u8] {
        let width = self.width_px as usize;
        &self.pixels[v as usize * width..][..width]
    }
}
