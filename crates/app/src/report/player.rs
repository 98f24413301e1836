//! Pictures of a run with what the tracker said of them.

use super::curves::{seconds, state_colour, state_text};
use super::keys::key_images;
use super::{Files, ImageLine};
use crate::output::snake;
use crate::page::{Colour, Picture, Pictures, Reading, Shape, Spot, StripPicture};

/// Bytes of JPEG that a page may carry; base64 takes a third more.
const BUDGET_BYTES: usize = 9_000_000;

/// The columns that the aperture reaches, all of the depth: left, top, width, height.
fn shown_px(files: &Files) -> [f64; 4] {
    let [left, right] = files.summary.setting.columns_px.map(f64::from);
    [left, 0.0, right - left, f64::from(files.summary.setting.image_px[1])]
}

fn template(files: &Files) -> Shape {
    Shape::Box { side_px: f64::from(files.summary.setting.template_px) }
}

/// The images that tell the run, with the tracker's box and the true tip.
pub(super) fn strip(files: &Files, pictures: &[Vec<u8>]) -> Vec<StripPicture> {
    let key_images = key_images(&files.images);
    let picture = |key: &super::keys::KeyImage| {
        let row = &files.images[key.index];
        let estimate = row.estimate_px().map(|at| (template(files), state_colour(row.state), at));
        let marks = estimate.into_iter().chain([(Shape::Cross, Colour::Turquoise, row.tip_px())]).collect();
        StripPicture {
            picture: Picture::from_jpeg(&pictures[key.index]),
            size_px: files.summary.setting.image_px,
            shown_px: shown_px(files),
            marks,
            caption: format!("{}, {:.2} s, {}", key.label, seconds(row.tick), state_text(row.state)),
        }
    };
    key_images.iter().map(picture).collect()
}

/// Every how many images one is carried so that the page keeps within its size.
pub(super) fn stride(pictures: &[Vec<u8>]) -> usize {
    let bytes: usize = pictures.iter().map(Vec::len).sum();
    bytes.div_ceil(BUDGET_BYTES).max(1)
}

/// The pictures that the charts' cursor leads to.
pub(super) fn player(files: &Files, pictures: &[Vec<u8>]) -> Pictures {
    let rows = &files.images;
    let places: Vec<usize> = (0..rows.len()).step_by(stride(pictures)).collect();
    let spot = |label: &str, shape, colour, hidden, at_px| Spot {
        label: label.to_owned(),
        shape,
        colour,
        hidden,
        at_px,
    };
    Pictures {
        size_px: files.summary.setting.image_px,
        shown_px: shown_px(files),
        spacing_mm: Some(files.summary.setting.spacing_mm),
        pictures: places.iter().map(|&index| Picture::from_jpeg(&pictures[index])).collect(),
        places,
        spots: vec![
            spot(
                "tip as estimated",
                Shape::Cross,
                None,
                false,
                rows.iter().map(ImageLine::estimate_px).collect(),
            ),
            spot("template", template(files), None, false, rows.iter().map(ImageLine::estimate_px).collect()),
            spot(
                "truth",
                Shape::Cross,
                Some(Colour::Turquoise),
                true,
                rows.iter().map(|row| Some(row.tip_px())).collect(),
            ),
        ],
        readings: readings(files),
        plays_s: Some(1.0),
    }
}

fn readings(files: &Files) -> Vec<Reading> {
    let spacing_mm = files.summary.setting.spacing_mm;
    let reading = |label: &str, hidden, text: &dyn Fn(&ImageLine) -> String| Reading {
        label: label.to_owned(),
        hidden,
        values: files.images.iter().map(text).collect(),
    };
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
    let reason =
        |row: &ImageLine| row.reason.map_or("–".to_owned(), |reason| snake(&reason).replace('_', " "));
    vec![
        reading("image", false, &|row| row.sequence.to_string()),
        reading("time", false, &|row| format!("{:.2} s", seconds(row.tick))),
        reading("state", false, &|row| state_text(row.state).to_owned()),
        reading("reason", false, &reason),
        reading("NCC previous", false, &|row| number(row.ncc_previous)),
        reading("NCC first", false, &|row| number(row.ncc_anchor)),
        reading("brightness", false, &|row| number(row.brightness_ratio)),
        reading("force", false, &|row| format!("{:.1} N", row.force_n)),
        reading("depth", false, &|row| format!("{:.1} mm", row.depth_mm)),
        reading("feed", false, &|row| format!("{:.1} mm/s", row.feed_mm_s)),
        reading("tip error", true, &|row| {
            let error = row.tip_error_px().filter(|_| row.is_tracking());
            error.map_or("–".to_owned(), |px| format!("{:.2} mm", px * spacing_mm))
        }),
        reading("off plane", true, &|row| format!("{:+.2} mm", row.plane_offset_mm)),
        reading("tip in slice", true, &|row| if row.visible == 1 { "yes" } else { "no" }.to_owned()),
    ]
}
