//! A recording at a glance: a dozen of its images, and every loss and recovery.

use std::fmt::Write as _;

use embedded_graphics::mono_font::iso_8859_1::{FONT_7X13, FONT_7X13_BOLD};
use embedded_graphics::text::Alignment;
use image::RgbImage;
use sonoloop_types::{Image, TrackState};

use super::OutputError;
use super::animation::Pictures;
use super::canvas::Canvas;
use super::colour::{self, grey};
use super::csv::snake;
use super::tracked::{HEADER, Place, Tracked, state_text};
use crate::track_recorded::TrackedImage;

/// Images spread evenly over the sequence.
const EVEN: usize = 12;
/// Losses and recoveries shown at most; the title says how many there were.
const MOST_CHANGES: usize = 36;
const COLUMNS: usize = 4;
const LEAST_WIDTH: i32 = 240;
/// Pictures wider than this are shrunk to it.
const MOST_WIDTH: i32 = 320;
const GAP: i32 = 6;
/// The enlarged surroundings of the tip: how large on the sheet, and how many times.
const INSET: i32 = 100;
const INSET_TIMES: i32 = 3;

/// The sheet.
pub(crate) fn strip(tracked: &Tracked<'_>) -> Result<RgbImage, OutputError> {
    let rows = &tracked.rows[..tracked.len()];
    let (shown, changes) = chosen(rows);
    let first = tracked.image(0)?;
    let divisor = (first.width_px as i32 + MOST_WIDTH - 1) / MOST_WIDTH;
    let picture = [first.width_px as i32 / divisor, first.height_px as i32 / divisor];
    let cell = [picture[0].max(LEAST_WIDTH), picture[1] + HEADER];
    let columns = COLUMNS.min(shown.len()) as i32;
    let lines = shown.len().div_ceil(COLUMNS) as i32;
    let size = [GAP + columns * (cell[0] + GAP), HEADER + GAP + lines * (cell[1] + GAP)];
    let mut canvas = Canvas::new(size[0] as u32, size[1] as u32);
    let losses = changes.iter().filter(|&&k| rows[k - 1].estimate.state == TrackState::Tracking).count();
    let mut title = format!("{} images, lost {losses} x, found {} x", rows.len(), changes.len() - losses);
    if changes.len() > MOST_CHANGES {
        let _ = write!(title, "; only the first {MOST_CHANGES} of these are shown");
    }
    canvas.text(&title, [GAP, 5], &FONT_7X13_BOLD, grey(255), Alignment::Left);
    for (order, &index) in shown.iter().enumerate() {
        let at = |k: usize, axis: usize| GAP + k as i32 * (cell[axis] + GAP);
        let corner = [at(order % COLUMNS, 0), HEADER + at(order / COLUMNS, 1)];
        let place = Place { origin: [corner[0], corner[1] + HEADER], divisor };
        let (image, row) = (tracked.image(index)?, &rows[index]);
        // Marks may leave the picture; what comes later covers them, so cells are drawn one by one, text last.
        place.picture(&mut canvas, &image);
        place.marks(&mut canvas, row, tracked.template_px);
        inset(&mut canvas, &place, picture, &image, row);
        label(&mut canvas, corner, cell[0], index, row, changes.contains(&index));
    }
    Ok(canvas.0)
}

fn label(
    canvas: &mut Canvas,
    [x, y]: [i32; 2],
    width: i32,
    index: usize,
    row: &TrackedImage,
    has_changed: bool,
) {
    canvas.fill([x, y], [width, HEADER], grey(28));
    canvas.text(&index.to_string(), [x + 4, y + 5], &FONT_7X13_BOLD, grey(255), Alignment::Left);
    let state = row.estimate.state;
    let colour = colour::of_state(Some(state));
    let text = match (has_changed, state) {
        (false, _) => state_text(state),
        (true, TrackState::Tracking) => "FOUND".to_owned(),
        (true, _) => format!("LOST: {}", snake(&row.estimate.reason).replace('_', " ")),
    };
    canvas.text(&text, [x + width / 2, y + 5], &FONT_7X13_BOLD, colour, Alignment::Center);
    let ncc = row.estimate.ncc_previous.map_or("NCC -".to_owned(), |ncc| format!("NCC {ncc:.2}"));
    canvas.text(&ncc, [x + width - 4, y + 5], &FONT_7X13, grey(255), Alignment::Right);
}

/// The tip enlarged, in the upper corner of the picture that is farther from it.
fn inset(canvas: &mut Canvas, place: &Place, [width, height]: [i32; 2], image: &Image, row: &TrackedImage) {
    let Some([u, v]) = row.estimate.tip_px else { return };
    if width < 2 * INSET || height < INSET {
        return;
    }
    let on_the_left = u > f64::from(image.width_px) / 2.0;
    let x0 = place.origin[0] + if on_the_left { 0 } else { width - INSET };
    let y0 = place.origin[1];
    // Far outside any picture is far enough.
    let [u, v] = [u, v].map(|c| c.round().clamp(-1e6, 1e6) as i32);
    for dy in 0..INSET {
        for dx in 0..INSET {
            let at = |d: i32| (d - INSET / 2 + 1).div_euclid(INSET_TIMES);
            let (column, line) = (u + at(dx), v + at(dy));
            let inside =
                (0..image.width_px as i32).contains(&column) && (0..image.height_px as i32).contains(&line);
            let level = if inside { image.row(line as u32)[column as usize] } else { 0 };
            canvas.fill([x0 + dx, y0 + dy], [1, 1], grey(level));
        }
    }
    canvas.outline([x0, y0], [INSET, INSET], colour::of_state(Some(row.estimate.state)));
}

/// The images shown, in their order, and those at which the tip was lost or found.
fn chosen(rows: &[TrackedImage]) -> (Vec<usize>, Vec<usize>) {
    let is_tracking = |row: &TrackedImage| row.estimate.state == TrackState::Tracking;
    let changes: Vec<usize> =
        (1..rows.len()).filter(|&k| is_tracking(&rows[k - 1]) != is_tracking(&rows[k])).collect();
    let last = rows.len().saturating_sub(1);
    let mut shown: Vec<usize> = (0..EVEN).map(|k| (k * last + (EVEN - 1) / 2) / (EVEN - 1)).collect();
    shown.extend(changes.iter().take(MOST_CHANGES));
    shown.sort_unstable();
    shown.dedup();
    (shown, changes)
}

#[cfg(test)]
mod tests {
    use sonoloop_types::{Estimate, Reason};

    use super::*;

    fn rows(states: &str) -> Vec<TrackedImage> {
        let state = |letter| match letter {
            'T' => TrackState::Tracking,
            'R' => TrackState::Recovering,
            'S' => TrackState::Searching,
            _ => TrackState::Lost,
        };
        let row = |letter| TrackedImage {
            estimate: Estimate::bare(state(letter), Reason::Ok, None),
            linear: None,
            time_us: 1.0,
        };
        states.chars().map(row).collect()
    }

    #[test]
    fn a_dozen_images_and_every_change() {
        assert_eq!(chosen(&rows("T")), (vec![0], vec![]));
        assert_eq!(chosen(&rows("TTTTT")), (vec![0, 1, 2, 3, 4], vec![]));
        let even = [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110];
        assert_eq!(chosen(&rows(&"T".repeat(111))), (even.to_vec(), vec![]));
        let states = format!("{}LLRRT{}", "T".repeat(44), "T".repeat(62));
        let (shown, changes) = chosen(&rows(&states));
        assert_eq!(changes, [44, 48], "a candidate is neither");
        assert!(changes.iter().all(|k| shown.contains(k)) && shown.len() == 14, "{shown:?}");
        // Found at first: a change too.
        assert_eq!(chosen(&rows("SSTTT")).1, [2]);
    }

    #[test]
    fn a_flickering_sequence_does_not_fill_the_wall() {
        let (shown, changes) = chosen(&rows(&"TL".repeat(500)));
        assert_eq!(changes.len(), 999);
        assert!(shown.len() <= EVEN + MOST_CHANGES, "{}", shown.len());
    }
}
