use std::convert::Infallible;

use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Line, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use image::{Rgb, RgbImage};

/// A colour picture to draw on; whatever falls outside is clipped.
pub(super) struct Canvas(pub RgbImage);

impl Canvas {
    pub fn new(width_px: u32, height_px: u32) -> Self {
        Self(RgbImage::new(width_px, height_px))
    }

    pub fn fill(&mut self, [x, y]: [i32; 2], [width, height]: [i32; 2], colour: Rgb888) {
        let size = Size::new(width.max(0).unsigned_abs(), height.max(0).unsigned_abs());
        let area = Rectangle::new(Point::new(x, y), size);
        infallible(area.into_styled(PrimitiveStyle::with_fill(colour)).draw(self));
    }

    pub fn outline(&mut self, [x, y]: [i32; 2], [width, height]: [i32; 2], colour: Rgb888) {
        let size = Size::new(width.max(0).unsigned_abs(), height.max(0).unsigned_abs());
        let area = Rectangle::new(Point::new(x, y), size);
        infallible(area.into_styled(PrimitiveStyle::with_stroke(colour, 1)).draw(self));
    }

    pub fn line(&mut self, [x0, y0]: [i32; 2], [x1, y1]: [i32; 2], colour: Rgb888) {
        let line = Line::new(Point::new(x0, y0), Point::new(x1, y1));
        infallible(line.into_styled(PrimitiveStyle::with_stroke(colour, 1)).draw(self));
    }

    /// Text whose top edge is y; x is its left, middle or right end by `alignment`.
    pub fn text(
        &mut self,
        text: &str,
        [x, y]: [i32; 2],
        font: &MonoFont<'_>,
        colour: Rgb888,
        alignment: Alignment,
    ) {
        let layout = TextStyleBuilder::new().alignment(alignment).baseline(Baseline::Top).build();
        let style = MonoTextStyle::new(font, colour);
        infallible(Text::with_text_style(text, Point::new(x, y), style, layout).draw(self).map(|_| ()));
    }
}

fn infallible(result: Result<(), Infallible>) {
    match result {
        Ok(()) => {}
        Err(never) => match never {},
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, colour) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                && let Some(pixel) = self.0.get_pixel_mut_checked(x, y)
            {
                *pixel = Rgb([colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}
