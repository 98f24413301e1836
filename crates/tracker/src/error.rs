/// Why a tracker could not be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackerError {
    /// A setting is outside its bounds.
    #[error("tracker setting {name} = {value} must be {bound}")]
    Setting {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
    /// The number of pixels is not width × height, or zero.
    #[error("an image of {width_px} × {height_px} px came with {pixels} pixels")]
    Image {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
        /// Pixels that came.
        pixels: usize,
    },
    /// The template is larger than the image.
    #[error("a template of {template_px} px does not fit into an image of {width_px} × {height_px} px")]
    TemplateTooLarge {
        /// Side of the template.
        template_px: u32,
        /// Columns of the image.
        width_px: u32,
        /// Rows of the image.
        height_px: u32,
    },
    /// The tip is not finite, or under half of the template about it lies inside the image.
    #[error("tip ({}, {}) px: under half of the template lies inside the image", .tip_px[0], .tip_px[1])]
    TipOutside {
        /// The tip that was given.
        tip_px: [f64; 2],
    },
    /// The image has no texture about the tip, so nothing can be followed.
    #[error("no texture about the tip at ({}, {}) px", .tip_px[0], .tip_px[1])]
    NoTexture {
        /// The tip that was given.
        tip_px: [f64; 2],
    },
    /// A checkpoint does not fit the settings, or holds impossible values.
    #[error("checkpoint: {0}")]
    Checkpoint(&'static str),
}
