//! A tracked image of a recording: the picture, the template's box turned by its warp, a cross on the tip, and what the
//! tracker says.

use embedded_graphics::mono_font::iso_8859_1::{FONT_7X13, FONT_7X13_BOLD};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::text::Alignment;
use image::{Rgb, RgbImage};
use sonoloop_types::{Image, TrackState};

use super::OutputError;
use super::animation::Pictures;
use super::canvas::Canvas;
use super::colour::{self, grey};
use super::csv::snake;
use super::overlay::Scale;
use crate::record::ImageStore;
use crate::track_recorded::TrackedImage;

/// Height of the line of text above a picture.
pub(super) const HEADER: i32 = 22;
/// The line of text needs as much width, whatever the picture has.
const LEAST_WIDTH: u32 = 400;

/// A recording and what was tracked in it, drawn one by one.
pub(crate) struct Tracked<'a> {
    pub rows: &'a [TrackedImage],
    pub pixels: &'a ImageStore,
    /// Side of the template; the earlier method has none, and gets a cross alone.
    pub template_px: u32,
    pub period_ms: u64,
}

impl Tracked<'_> {
    /// One of the images; the size is that of the first.
    pub fn image(&self, index: usize) -> Result<Image, OutputError> {
        self.pixels.get(index).map_err(OutputError::Pictures)
    }
}

impl Pictures for Tracked<'_> {
    fn len(&self) -> usize {
        self.rows.len().min(self.pixels.len())
    }

    fn period_ms(&self) -> u64 {
        self.period_ms
    }

    fn size_px(&self, scale: Scale) -> (u32, u32) {
        let (width, height) = self.pixels.size_px(0).unwrap_or((1, 1));
        let divisor = scale.divisor() as u32;
        ((width / divisor).max(LEAST_WIDTH), height / divisor + HEADER as u32)
    }

    fn draw(&self, index: usize, scale: Scale) -> Result<RgbImage, OutputError> {
        let (width, height) = self.size_px(scale);
        let mut canvas = Canvas::new(width, height);
        let place = Place { origin: [0, HEADER], divisor: scale.divisor() };
        place.picture(&mut canvas, &self.image(index)?);
        place.marks(&mut canvas, &self.rows[index], self.template_px);
        header(&mut canvas, width as i32, index, &self.rows[index]);
        Ok(canvas.0)
    }
}

/// Number, state, correlations and reason, over the whole width.
fn header(canvas: &mut Canvas, width: i32, index: usize, row: &TrackedImage) {
    let colour = colour::of_state(Some(row.estimate.state));
    canvas.fill([0, 0], [width, HEADER], grey(28));
    canvas.text(&format!("image {index}"), [6, 4], &FONT_7X13, grey(255), Alignment::Left);
    canvas.fill([92, 2], [86, HEADER - 4], colour);
    let name = state_text(row.estimate.state);
    canvas.text(&name, [135, 4], &FONT_7X13_BOLD, grey(0), Alignment::Center);
    let number = |ncc: Option<f64>| ncc.map_or("-".to_owned(), |ncc| format!("{ncc:.2}"));
    let estimate = &row.estimate;
    let nccs = format!("NCC {} first {}", number(estimate.ncc_previous), number(estimate.ncc_anchor));
    canvas.text(&nccs, [186, 4], &FONT_7X13, grey(255), Alignment::Left);
    let reason = snake(&estimate.reason).replace('_', " ");
    canvas.text(&reason, [width - 6, 4], &FONT_7X13, grey(150), Alignment::Right);
}

/// A state as it is written on pictures.
pub(super) fn state_text(state: TrackState) -> String {
    snake(&state).to_uppercase()
}

/// Where a picture lies on a canvas, and how many of its pixels make one there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub origin: [i32; 2],
    pub divisor: i32,
}

impl Place {
    /// The picture's grey levels, the mean of divisor × divisor each.
    pub fn picture(&self, canvas: &mut Canvas, image: &Image) {
        let divisor = self.divisor as usize;
        let area = (divisor * divisor) as u32;
        for y in 0..image.height_px as usize / divisor {
            for x in 0..image.width_px as usize / divisor {
                let rows = (0..divisor).map(|dv| image.row((y * divisor + dv) as u32));
                let sum: u32 =
                    rows.flat_map(|row| &row[x * divisor..][..divisor]).map(|level| u32::from(*level)).sum();
                self.pixel(canvas, [x as i32, y as i32], grey(((sum + area / 2) / area) as u8));
            }
        }
    }

    fn pixel(&self, canvas: &mut Canvas, [x, y]: [i32; 2], colour: Rgb888) {
        use embedded_graphics::prelude::RgbColor;
        let (x, y) = ((self.origin[0] + x) as u32, (self.origin[1] + y) as u32);
        if let Some(pixel) = canvas.0.get_pixel_mut_checked(x, y) {
            *pixel = Rgb([colour.r(), colour.g(), colour.b()]);
        }
    }

    /// Box and cross; nothing before the first fix.
    pub fn marks(&self, canvas: &mut Canvas, row: &TrackedImage, template_px: u32) {
        let Some(tip_px) = row.estimate.tip_px else { return };
        let colour = colour::of_state(Some(row.estimate.state));
        if let Some(linear) = row.linear {
            let corner = |x: f64, y: f64, half: f64| {
                let of = |axis: usize| tip_px[axis] + half * (linear[axis][0] * x + linear[axis][1] * y);
                self.xy([of(0), of(1)])
            };
            // Two lines, or speckle would swallow it.
            for half in [0.0, f64::from(self.divisor)].map(|more| f64::from(template_px) / 2.0 + more) {
                let around = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
                let corners = around.map(|[x, y]| corner(x, y, half));
                for k in 0..4 {
                    canvas.line(corners[k], corners[(k + 1) % 4], colour);
                }
            }
        }
        // Open in the middle, so that the tip itself is seen.
        let [x, y] = self.xy(tip_px);
        let [near, far] = [5, 8].map(|px| px / self.divisor);
        for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            canvas.line([x + near * dx, y + near * dy], [x + far * dx, y + far * dy], colour);
        }
    }

    fn xy(&self, at_px: [f64; 2]) -> [i32; 2] {
        // Far enough for any picture, near enough for the canvas's arithmetic.
        let on = |c: f64| (c / f64::from(self.divisor)).round().clamp(-20_000.0, 20_000.0) as i32;
        [self.origin[0] + on(at_px[0]), self.origin[1] + on(at_px[1])]
    }
}
