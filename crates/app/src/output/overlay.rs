//! The display: picture in the middle as on a scanner, numbers at its sides, state over time below.

use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_7X13, FONT_7X13_BOLD};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::text::Alignment;
use image::{Rgb, RgbImage};
use sonoloop_scenario::Scenario;
use sonoloop_types::{Image, ImageGeometry, ProbeSpec, TICKS_PER_SECOND, TrackState};

use super::canvas::Canvas;
use super::colour::{self, grey};
use super::csv::snake;
use crate::judge::tip_error_px;
use crate::record::{ImageRow, Recording};

const PANEL: i32 = 128;
const HEADER: i32 = 24;
const FOOTER: i32 = 24;
const BLACK: Rgb888 = grey(0);
const WHITE: Rgb888 = grey(255);
const LABEL: Rgb888 = grey(150);
/// Half the range of the plane-offset bar.
const OFFSET_RANGE_MM: f64 = 4.0;

/// Everything about a run that its display shows beside the image itself.
#[derive(Debug, Clone)]
pub struct Display {
    title: String,
    probe: ProbeSpec,
    template_px: u32,
    loss_ncc_previous: f64,
    loss_ncc_anchor: f64,
    loss_brightness_ratio: Option<f64>,
    /// State after every image, with the tick it holds from.
    states: Vec<(u64, Option<TrackState>)>,
    end_tick: u64,
    /// Draw what only the judge knows: the true tip, its distance to the plane, the tip error.
    pub show_truth: bool,
}

/// How large the picture is drawn; panels and texts keep their size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// One pixel per pixel.
    Full,
    /// The mean of four pixels per pixel.
    Half,
}

impl Scale {
    pub(super) fn divisor(self) -> i32 {
        match self {
            Self::Full => 1,
            Self::Half => 2,
        }
    }
}

/// Where the picture lies on the canvas.
struct Place {
    /// First and one-past-last column shown; the black margins are cut.
    columns: [i32; 2],
    divisor: i32,
    width: i32,
    height: i32,
}

impl Place {
    fn xy(&self, [u, v]: [f64; 2]) -> [i32; 2] {
        let divisor = f64::from(self.divisor);
        let x = (u - f64::from(self.columns[0])) / divisor;
        [PANEL + x.round() as i32, HEADER + (v / divisor).round() as i32]
    }
}

/// First column of the pictures that the aperture reaches, a multiple of four, and the first beyond it; the rest is black.
pub(super) fn aperture_columns_px(probe: &ProbeSpec) -> [u32; 2] {
    let geometry = &probe.geometry;
    let half_px = probe.aperture_m() / geometry.spacing_m / 2.0 + 8.0;
    let centre_px = geometry.centre_column_px();
    let first = ((centre_px - half_px).floor().max(0.0) as u32) / 4 * 4;
    [first, (centre_px + half_px).ceil().min(f64::from(geometry.width_px)) as u32]
}

impl Display {
    /// The display of one run.
    pub fn new(scenario: &Scenario, recording: &Recording) -> Self {
        let states: Vec<_> =
            recording.images.iter().map(|row| (row.acquisition.publication_tick, row.state())).collect();
        let last_image_tick = states.last().map_or(0, |&(tick, _)| tick);
        Self {
            title: format!("{}  seed {}", scenario.name, scenario.seed),
            probe: scenario.probe.clone(),
            template_px: scenario.tracker.template_px,
            loss_ncc_previous: scenario.tracker.loss_ncc_previous,
            loss_ncc_anchor: scenario.tracker.loss_ncc_anchor,
            loss_brightness_ratio: scenario.tracker.loss_brightness_ratio,
            states,
            end_tick: recording.ticks.last().map_or(last_image_tick, |row| row.tick).max(1),
            show_truth: true,
        }
    }

    /// Draws image and numbers. Width and height of the result are even and depend on the scenario and
    /// `scale` alone. An image of another size than the probe's is cut or padded with black.
    pub fn draw(&self, image: &Image, row: &ImageRow, scale: Scale) -> RgbImage {
        let place = self.place(scale);
        let (width_px, height_px) = self.size_px(scale);
        let mut canvas = Canvas::new(width_px, height_px);
        self.picture(&mut canvas, &place, image);
        self.marks(&mut canvas, &place, row);
        self.frame(&mut canvas, &place);
        self.depth_scale(&mut canvas, &place);
        self.left_panel(&mut canvas, row);
        self.right_panel(&mut canvas, &place, row);
        if scale == Scale::Full {
            self.magnifier(&mut canvas, &place, image, row);
        }
        self.timeline(&mut canvas, &place, row);
        canvas.0
    }

    /// Width and height of the drawn display.
    pub fn size_px(&self, scale: Scale) -> (u32, u32) {
        let place = self.place(scale);
        ((place.width + 2 * PANEL) as u32, (place.height + HEADER + FOOTER) as u32)
    }

    fn geometry(&self) -> &ImageGeometry {
        &self.probe.geometry
    }

    fn place(&self, scale: Scale) -> Place {
        let geometry = self.geometry();
        let [first, last] = aperture_columns_px(&self.probe).map(|column| column as i32);
        let divisor = scale.divisor();
        let even = |length: i32| (length / divisor + 1) / 2 * 2;
        let (width, height) = (even(last - first), even(geometry.height_px as i32));
        Place { columns: [first, last], divisor, width, height }
    }

    fn picture(&self, canvas: &mut Canvas, place: &Place, image: &Image) {
        let divisor = place.divisor as u32;
        let area = divisor * divisor;
        let first = place.columns[0] as u32;
        for y in 0..place.height as u32 {
            for x in 0..place.width as u32 {
                let (u, v) = (first + x * divisor, y * divisor);
                if u + divisor > image.width_px || v + divisor > image.height_px {
                    continue;
                }
                let sum: u32 = (0..divisor)
                    .flat_map(|dv| &image.row(v + dv)[u as usize..][..divisor as usize])
                    .map(|&level| u32::from(level))
                    .sum();
                let level = ((sum + area / 2) / area) as u8;
                canvas.0.put_pixel(x + PANEL as u32, y + HEADER as u32, Rgb([level; 3]));
            }
        }
    }

    /// Tracked box and true tip.
    fn marks(&self, canvas: &mut Canvas, place: &Place, row: &ImageRow) {
        if self.show_truth {
            let [x, y] = place.xy(row.truth.reference_px);
            for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                canvas.line([x + 3 * dx, y + 3 * dy], [x + 7 * dx, y + 7 * dy], colour::TRUTH);
            }
            // Beside the box, on black: speckle would swallow it.
            canvas.fill([x + 13, y + 8], [33, 10], BLACK);
            canvas.text("truth", [x + 15, y + 8], &FONT_6X10, colour::TRUTH, Alignment::Left);
        }
        let Some(command) = &row.command else { return };
        let Some([u, v]) = command.estimate.tip_px.filter(|px| px.iter().all(|x| x.is_finite())) else {
            return;
        };
        let colour = colour::of_state(row.state());
        let side = self.template_px as i32 / place.divisor;
        let [x, y] = place.xy([u, v]);
        canvas.outline([x - side / 2, y - side / 2], [side, side], colour);
        canvas.outline([x - side / 2 - 1, y - side / 2 - 1], [side + 2, side + 2], colour);
    }

    /// Panels over whatever marks left the picture, and the header.
    fn frame(&self, canvas: &mut Canvas, place: &Place) {
        let right = PANEL + place.width;
        canvas.fill([0, 0], [PANEL, HEADER + place.height], BLACK);
        canvas.fill([right, 0], [PANEL, HEADER + place.height], BLACK);
        canvas.fill([0, 0], [right + PANEL, HEADER], grey(28));
        canvas.text(&self.title, [8, 6], &FONT_7X13_BOLD, WHITE, Alignment::Left);
        let note = "SIMULATED - NOT FOR CLINICAL USE";
        canvas.text(note, [right + PANEL - 8, 7], &FONT_6X10, LABEL, Alignment::Right);
    }

    /// Depth in millimetres along the left edge of the picture, a tick every 5 mm.
    fn depth_scale(&self, canvas: &mut Canvas, place: &Place) {
        let spacing_mm = self.geometry().spacing_m * 1e3;
        let depth_mm = f64::from(self.geometry().height_px) * spacing_mm;
        let mut mark_mm = 0.0;
        while mark_mm < depth_mm {
            let y = place.xy([0.0, mark_mm / spacing_mm])[1];
            let is_labelled = mark_mm % 10.0 == 0.0;
            let length = if is_labelled { 7 } else { 4 };
            canvas.line([PANEL - 1 - length, y], [PANEL - 2, y], LABEL);
            if is_labelled && mark_mm > 0.0 {
                let text = format!("{mark_mm:.0}");
                canvas.text(&text, [PANEL - 10, y - 5], &FONT_6X10, LABEL, Alignment::Right);
            }
            mark_mm += 5.0;
        }
        canvas.text("mm", [PANEL - 10, HEADER + 3], &FONT_6X10, LABEL, Alignment::Right);
    }

    fn left_panel(&self, canvas: &mut Canvas, row: &ImageRow) {
        let measured = &row.acquisition;
        let seconds = measured.acquisition_tick as f64 / TICKS_PER_SECOND as f64;
        let or_none = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
        let mut items = vec![
            ("TIME", format!("{seconds:.2} s"), LABEL),
            ("IMAGE", measured.sequence.to_string(), LABEL),
            ("DEPTH", or_none(measured.depth_m.map(|depth_m| format!("{:.1} mm", depth_m * 1e3))), LABEL),
            ("FEED", or_none(measured.feed_m_s.map(|feed_m_s| format!("{:.1} mm/s", feed_m_s * 1e3))), LABEL),
            ("FORCE", format!("{:.1} N", measured.contact_force_n), LABEL),
        ];
        if self.show_truth {
            let distance_mm = row.truth.target_distance_m * 1e3;
            items.push(("TO TARGET", format!("{distance_mm:.1} mm"), colour::TRUTH));
        }
        for (index, (label, value, colour)) in items.iter().enumerate() {
            let y = HEADER + 10 + 34 * index as i32;
            canvas.text(label, [8, y], &FONT_6X10, *colour, Alignment::Left);
            canvas.text(value, [8, y + 11], &FONT_7X13, WHITE, Alignment::Left);
        }
    }

    fn right_panel(&self, canvas: &mut Canvas, place: &Place, row: &ImageRow) {
        let x = PANEL + place.width + 8;
        let width = PANEL - 16;
        let state = row.state();
        let estimate = row.command.map(|command| command.estimate);
        let name = state.map_or("NO TRACKER".to_owned(), |state| snake(&state).to_uppercase());
        let y = HEADER + 8;
        canvas.fill([x, y], [width, 20], colour::of_state(state));
        canvas.text(&name, [x + width / 2, y + 4], &FONT_7X13_BOLD, BLACK, Alignment::Center);
        let reason = estimate.map_or(String::new(), |estimate| snake(&estimate.reason).replace('_', " "));
        canvas.text(&reason, [x + width / 2, y + 23], &FONT_6X10, LABEL, Alignment::Center);

        let ncc_previous = estimate.and_then(|estimate| estimate.ncc_previous);
        let ncc_anchor = estimate.and_then(|estimate| estimate.ncc_anchor);
        let ratio = estimate.and_then(|estimate| estimate.brightness_ratio);
        let above = |value: f64, bound: f64| value >= bound;
        let below = |value: f64, bound: f64| value <= bound;
        let at = |line: i32| [x, HEADER + 46 + 30 * line];
        gauge(canvas, at(0), "NCC previous", ncc_previous, Some(self.loss_ncc_previous), above);
        gauge(canvas, at(1), "NCC anchor", ncc_anchor, Some(self.loss_ncc_anchor), above);
        gauge(canvas, at(2), "brightness", ratio, self.loss_brightness_ratio, below);
        if self.show_truth {
            self.plane_offset(canvas, at(3), row);
            let [x, y] = at(4);
            let y = y + 10;
            let error = row.is_tracking().then(|| tip_error_px(row)).flatten();
            let error = error.map_or("-".to_owned(), |px| format!("{:.2} mm", px * self.spacing_mm()));
            canvas.text("tip error", [x, y], &FONT_6X10, colour::TRUTH, Alignment::Left);
            canvas.text(&error, [x + width, y], &FONT_6X10, WHITE, Alignment::Right);
            let seen = if row.truth.visible { "yes" } else { "no" };
            canvas.text("tip in slice", [x, y + 14], &FONT_6X10, colour::TRUTH, Alignment::Left);
            canvas.text(seen, [x + width, y + 14], &FONT_6X10, WHITE, Alignment::Right);
        }
    }

    /// What lies under the tracked box, enlarged, in the lower right corner; only on tall pictures.
    fn magnifier(&self, canvas: &mut Canvas, place: &Place, image: &Image, row: &ImageRow) {
        let centre_px = row.command.and_then(|command| command.estimate.tip_px);
        let Some([u, v]) = centre_px.filter(|px| px.iter().all(|x| x.is_finite())) else { return };
        let width = PANEL - 16;
        let corner = [PANEL + place.width + 8, HEADER + place.height - width - 8];
        if place.height < 230 + width {
            return;
        }
        canvas.text("3 x", [corner[0], corner[1] - 12], &FONT_6X10, LABEL, Alignment::Left);
        let (u, v) = (u.round() as i64, v.round() as i64);
        for dy in 0..width {
            for dx in 0..width {
                // The middle of the tracked pixel falls on the middle of the window.
                let at = |d: i32| i64::from((d - width / 2 + 1).div_euclid(3));
                let (column, line) = (u + at(dx), v + at(dy));
                let inside = (0..i64::from(image.width_px)).contains(&column)
                    && (0..i64::from(image.height_px)).contains(&line);
                let level = if inside { image.row(line as u32)[column as usize] } else { 0 };
                canvas.0.put_pixel((corner[0] + dx) as u32, (corner[1] + dy) as u32, Rgb([level; 3]));
            }
        }
        let side = (3 * self.template_px as i32).min(width);
        let inset = (width - side) / 2;
        canvas.outline([corner[0] + inset, corner[1] + inset], [side, side], colour::of_state(row.state()));
        canvas.outline(corner, [width, width], grey(64));
    }

    fn spacing_mm(&self) -> f64 {
        self.geometry().spacing_m * 1e3
    }

    /// Distance from plane to tip; the green stretch is the slice within which the tip shows.
    fn plane_offset(&self, canvas: &mut Canvas, [x, y]: [i32; 2], row: &ImageRow) {
        let width = PANEL - 16;
        let offset_mm = row.truth.plane_to_tip_m * 1e3;
        canvas.text("off plane", [x, y], &FONT_6X10, colour::TRUTH, Alignment::Left);
        let text = format!("{offset_mm:+.1} mm");
        canvas.text(&text, [x + width, y], &FONT_6X10, WHITE, Alignment::Right);
        let (bar_y, middle) = (y + 13, x + width / 2);
        canvas.fill([x, bar_y], [width, 8], grey(40));
        let per_mm = f64::from(width) / 2.0 / OFFSET_RANGE_MM;
        let thickness_mm = self.probe.slice_thickness_m(row.truth.tip_in_probe.z) * 1e3;
        let half = (thickness_mm / 2.0 * per_mm).round() as i32;
        let half = half.min(width / 2);
        canvas.fill([middle - half, bar_y], [2 * half + 1, 8], colour::DARK_GREEN);
        canvas.line([middle, bar_y], [middle, bar_y + 7], LABEL);
        let clamped_mm = offset_mm.clamp(-OFFSET_RANGE_MM, OFFSET_RANGE_MM);
        let marker = middle + (clamped_mm * per_mm).round() as i32;
        canvas.fill([marker - 1, bar_y - 2], [3, 12], colour::TRUTH);
    }

    /// State over the whole run; the past bright, the future dim.
    fn timeline(&self, canvas: &mut Canvas, place: &Place, row: &ImageRow) {
        let top = HEADER + place.height;
        let total = place.width + 2 * PANEL;
        canvas.fill([0, top], [total, FOOTER], grey(28));
        let (left, width) = (8, total - 16);
        let x = |tick: u64| left + (f64::from(width) * tick as f64 / self.end_tick as f64).round() as i32;
        let now = row.acquisition.publication_tick;
        for (index, &(tick, state)) in self.states.iter().enumerate() {
            let until = self.states.get(index + 1).map_or(self.end_tick, |&(tick, _)| tick);
            let colour = if tick <= now { colour::of_state(state) } else { dim(state) };
            canvas.fill([x(tick), top + 9], [x(until) - x(tick), 6], colour);
        }
        canvas.fill([x(now) - 1, top + 5], [2, 14], WHITE);
    }
}

fn dim(state: Option<TrackState>) -> Rgb888 {
    match state {
        Some(TrackState::Tracking) => colour::DARK_GREEN,
        Some(TrackState::Lost) => colour::DARK_RED,
        Some(TrackState::Recovering) => colour::DARK_AMBER,
        Some(TrackState::Searching) | None => grey(60),
    }
}

/// A value from 0 to 1 as a number and a bar with its threshold.
fn gauge(
    canvas: &mut Canvas,
    [x, y]: [i32; 2],
    label: &str,
    value: Option<f64>,
    bound: Option<f64>,
    keeps: impl Fn(f64, f64) -> bool,
) {
    let width = PANEL - 16;
    canvas.text(label, [x, y], &FONT_6X10, LABEL, Alignment::Left);
    let text = value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    canvas.text(&text, [x + width, y], &FONT_6X10, WHITE, Alignment::Right);
    let bar_y = y + 12;
    canvas.fill([x, bar_y], [width, 6], grey(40));
    if let Some(value) = value {
        let ok = bound.is_none_or(|bound| keeps(value, bound));
        let length = (value.clamp(0.0, 1.0) * f64::from(width)).round() as i32;
        canvas.fill([x, bar_y], [length, 6], if ok { grey(200) } else { colour::LOST });
    }
    if let Some(bound) = bound.filter(|bound| (0.0..=1.0).contains(bound)) {
        let mark = x + (bound * f64::from(width)).round() as i32;
        canvas.line([mark, bar_y - 2], [mark, bar_y + 7], THRESHOLD);
    }
}

const THRESHOLD: Rgb888 = grey(255);
