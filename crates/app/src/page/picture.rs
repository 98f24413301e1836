use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use minijinja::value::Value;
use serde::Serialize;

use super::Colour;

/// A JPEG file's bytes as they stand on the page.
#[derive(Debug, Clone, Serialize)]
pub struct Picture(String);

impl Picture {
    /// Takes the bytes of a JPEG file.
    pub fn from_jpeg(jpeg: &[u8]) -> Self {
        Self(STANDARD.encode(jpeg))
    }
}

/// What an `src` attribute takes; base64 has nothing to escape.
pub(super) fn data_uri(base64: &str) -> Value {
    Value::from_safe_string(format!("data:image/jpeg;base64,{base64}"))
}

/// One of several pictures side by side.
#[derive(Debug, Clone, Serialize)]
pub struct StripPicture {
    /// The picture.
    pub picture: Picture,
    /// Width and height that the marks count in; the file may have fewer pixels.
    pub size_px: [u32; 2],
    /// What of it is shown: left, top, width, height.
    pub shown_px: [f64; 4],
    /// Drawn over it: shape, colour, centre.
    pub marks: Vec<(Shape, Colour, [f64; 2])>,
    /// What it shows.
    pub caption: String,
}

/// A mark on a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
pub enum Shape {
    /// A square with this side.
    Box {
        /// Its side.
        side_px: f64,
    },
    /// A cross, open in the middle.
    Cross,
}
