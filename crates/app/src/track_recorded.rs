//! The tracker alone on a recorded sequence: `sonoloop track SEQUENCE --init U,V`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use sonoloop_tracker::baseline::{BaselineTracker, Insertion, Localizer};
use sonoloop_tracker::{Context, Tracker, TrackerError};
use sonoloop_types::{Estimate, Image, Reason, TrackState, TrackerSettings};

use crate::error::AppError;
use crate::first_fix::first_fix;
use crate::output::{Stage, Tracked, rgb_png, snake, strip, write_gif};
use crate::paths::no_file_in_the_way;
use crate::record::ImageStore;
use crate::say::say;
use crate::sequence::Sequence;

/// Names of the files in `--out DIR`.
const TABLE: &str = "track.csv";
const GIF: &str = "track.gif";
const STRIP: &str = "strip.png";
/// Time between images where the recording does not say.
const PERIOD_MS: u64 = 40;

/// What to track, and how.
///
/// Sequence and click are not marked as required so that the group as a whole can be left out; given in part, what
/// is missing is asked for.
#[derive(Debug, Clone, Args)]
pub struct TrackRecorded {
    /// Recorded images: an .mha file of the PLUS kind, or a folder of PNG files
    #[arg(required = false)]
    pub sequence: PathBuf,
    /// The tip in the first image, in pixels with depth running down; or `localize`: look for a needle until there is one
    #[arg(long, value_name = "U,V|localize", required = false, value_parser = parse_init, allow_hyphen_values = true)]
    pub init: Init,
    /// The template tracker, or the authors' earlier method, which localises the needle in every image
    #[arg(long, value_enum, default_value = "template")]
    pub tracker: TrackerArg,
    /// Folder for track.csv, track.gif (every image with the template's box) and strip.png (a dozen, every loss and recovery)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// A place (u, v) in a picture.
pub type Px = [f64; 2];

/// `--init`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// The tip is here in the first image.
    At(Px),
    /// The tip is where a needle ends that is found in the picture.
    Localize,
}

/// `--tracker`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrackerArg {
    /// Templates
    Template,
    /// Gabor filter, RANSAC line and Kalman filter in every image; goes with `--init localize`
    Baseline,
}

fn parse_init(text: &str) -> Result<Init, String> {
    if text == "localize" {
        return Ok(Init::Localize);
    }
    let (u, v) = text.split_once(',').ok_or("must be U,V, for example 238.1,327.6, or localize")?;
    let number = |text: &str| {
        let parsed = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        parsed.ok_or_else(|| format!("\"{}\" is not a number", text.trim()))
    };
    Ok(Init::At([number(u)?, number(v)?]))
}

/// One line of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedImage {
    /// What the tracker said; image 0 is the one with the click.
    pub estimate: Estimate,
    /// Linear part of the template's warp, row by row; `None` without a template.
    pub linear: Option<[[f64; 2]; 2]>,
    /// How long the tracker took, wall clock; reading and drawing are not in it.
    pub time_us: f64,
}

/// Tracks the sequence, writes table and pictures, prints a short summary. Bad input leaves nothing behind.
pub fn run(args: &TrackRecorded, settings: TrackerSettings) -> Result<(), AppError> {
    no_file_in_the_way("--out", args.out.as_deref())?;
    let rows = track(args, settings)?;
    if let Some(folder) = &args.out {
        write_files(folder, args, &rows, settings.template_px)?;
    }
    say(summary(&rows).trim_end());
    Ok(())
}

/// Tracks the whole sequence in memory.
pub fn track(args: &TrackRecorded, settings: TrackerSettings) -> Result<Vec<TrackedImage>, AppError> {
    let bad = |error: &dyn std::fmt::Display| AppError::BadInput(format!("error: {error}"));
    let mut sequence = Sequence::open(&args.sequence).map_err(|error| bad(&error))?;
    let mut rows: Vec<TrackedImage> = Vec::with_capacity(sequence.image_count());
    let mut tracker = Begun::new(args)?;
    while let Some(image) = sequence.next_image().map_err(|error| bad(&error))? {
        let start = Instant::now();
        let estimate = tracker.track(settings, &image).map_err(|(at, error)| {
            AppError::BadInput(format!(
                "error: {}: --init {},{} in an image of {} × {} px: {error}",
                args.sequence.display(),
                at[0],
                at[1],
                image.width_px,
                image.height_px
            ))
        })?;
        let time_us = start.elapsed().as_secs_f64() * 1e6;
        rows.push(TrackedImage { estimate, linear: tracker.linear(), time_us });
    }
    Ok(rows)
}

/// What follows the tip, or looks for it still.
enum Begun {
    Clicked(Px),
    Searching(Box<Localizer>),
    Template(Box<Tracker>),
    Baseline(Box<BaselineTracker>),
}

impl Begun {
    fn new(args: &TrackRecorded) -> Result<Self, AppError> {
        match (args.tracker, args.init) {
            (TrackerArg::Baseline, Init::Localize) => {
                Ok(Self::Baseline(Box::new(BaselineTracker::new(Insertion::default()))))
            }
            (TrackerArg::Baseline, Init::At(_)) => Err(AppError::BadInput(
                "error: --tracker baseline finds the tip by itself: it goes with --init localize".to_owned(),
            )),
            (TrackerArg::Template, Init::At(at)) => Ok(Self::Clicked(at)),
            (TrackerArg::Template, Init::Localize) => {
                Ok(Self::Searching(Box::new(Localizer::new(Insertion::default()))))
            }
        }
    }

    /// Fails where no template fits around the click.
    fn track(&mut self, settings: TrackerSettings, image: &Image) -> Result<Estimate, (Px, TrackerError)> {
        match self {
            Self::Template(tracker) => Ok(tracker.track(image, &Context::default())),
            Self::Baseline(tracker) => Ok(tracker.track(image)),
            Self::Clicked(at) => {
                let made = Tracker::new(settings, image, *at).map_err(|error| (*at, error))?;
                Ok(self.begin(made))
            }
            Self::Searching(localizer) => {
                let nothing = Estimate::bare(TrackState::Searching, Reason::NoCandidate, None);
                Ok(first_fix(localizer, settings, image).map_or(nothing, |made| self.begin(made)))
            }
        }
    }

    fn linear(&self) -> Option<[[f64; 2]; 2]> {
        match self {
            Self::Template(tracker) => Some(tracker.linear()),
            _ => None,
        }
    }

    fn begin(&mut self, made: Tracker) -> Estimate {
        let estimate = made.last_estimate();
        *self = Self::Template(Box::new(made));
        estimate
    }
}

/// The table and the pictures, each whole before any gets its name. The recording is read once more for the pictures, so that
/// nothing but the tracker runs between two images while it is timed.
fn write_files(
    folder: &Path,
    args: &TrackRecorded,
    rows: &[TrackedImage],
    template_px: u32,
) -> Result<(), AppError> {
    let mut sequence = Sequence::open(&args.sequence).map_err(AppError::fault)?;
    let mut pixels = ImageStore::new().map_err(AppError::fault)?;
    while let Some(image) = sequence.next_image().map_err(AppError::fault)? {
        pixels.push(&image).map_err(AppError::fault)?;
    }
    let tracked = Tracked { rows, pixels: &pixels, template_px, period_ms: period_ms(&sequence) };
    let stage = Stage::ending_with(folder, TABLE).map_err(AppError::fault)?;
    write_gif(&stage.path(GIF), &tracked).map_err(AppError::fault)?;
    let sheet = strip(&tracked).map_err(AppError::fault)?;
    stage.write(STRIP, rgb_png(&sheet).map_err(AppError::fault)?).map_err(AppError::fault)?;
    stage.write(TABLE, table(rows)).map_err(AppError::fault)?;
    stage.publish(&[GIF, STRIP]).map_err(AppError::fault)
}

/// Mean time between images by the recording's own clock.
fn period_ms(sequence: &Sequence) -> u64 {
    let last = sequence.image_count().saturating_sub(1);
    let span_s = sequence.fields().and_then(|f| Some(f.timestamp_s(last)? - f.timestamp_s(0)?));
    let period_ms = span_s.map(|span_s| 1000.0 * span_s / last as f64);
    period_ms.filter(|ms| (1.0..=1000.0).contains(ms)).map_or(PERIOD_MS, |ms| ms.round() as u64)
}

const COLUMNS: &str = "image,u_px,v_px,state,ncc_previous,ncc_anchor,iterations,time_us,\
    reason,brightness_ratio,tip_level,conditioning,warp_uu,warp_uv,warp_vu,warp_vv";

/// The table as text. A value that the tracker does not have is left empty.
fn table(rows: &[TrackedImage]) -> String {
    let mut text = format!("{COLUMNS}\n");
    let number = |value: Option<f64>, digits: usize| value.map_or(String::new(), |v| format!("{v:.digits$}"));
    for (image, TrackedImage { estimate, linear, time_us }) in rows.iter().enumerate() {
        let _ = write!(
            text,
            "{image},{},{},{},{},{},{},{time_us:.1},{},{},{},{}",
            number(estimate.tip_px.map(|tip| tip[0]), 4),
            number(estimate.tip_px.map(|tip| tip[1]), 4),
            snake(&estimate.state),
            number(estimate.ncc_previous, 6),
            number(estimate.ncc_anchor, 6),
            estimate.iterations,
            snake(&estimate.reason),
            number(estimate.brightness_ratio, 6),
            number(estimate.tip_level, 3),
            number(estimate.conditioning, 6),
        );
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let _ = write!(text, ",{}", number(linear.map(|linear| linear[row][column]), 6));
        }
        text.push('\n');
    }
    text
}

fn summary(rows: &[TrackedImage]) -> String {
    let tracking = |row: &TrackedImage| row.estimate.state == TrackState::Tracking;
    let losses = rows.windows(2).filter(|pair| tracking(&pair[0]) && !tracking(&pair[1])).count();
    let mut times: Vec<f64> = rows.iter().skip(1).map(|row| row.time_us).collect();
    times.sort_by(f64::total_cmp);
    let median = times.get(times.len() / 2).map_or("none".to_owned(), |time| format!("{time:.0} µs"));
    let share = 100.0 * rows.iter().filter(|row| tracking(row)).count() as f64 / rows.len().max(1) as f64;
    format!(
        "images            {}\ntracking          {share:.1} %\nlosses            {losses}\nmedian time       {median}\n",
        rows.len()
    )
}

#[cfg(test)]
mod tests {
    use std::fs;

    use clap::Parser;

    use super::*;
    use crate::sequence::SequenceWriter;
    use crate::tracker_args::TrackerArgs;

    #[derive(Debug, Parser)]
    struct Cli {
        #[command(flatten)]
        recorded: Option<TrackRecorded>,
        #[command(flatten)]
        settings: TrackerArgs,
        #[arg(long)]
        domain: Option<String>,
    }

    fn args(sequence: &Path, more: &[&str]) -> (TrackRecorded, TrackerSettings) {
        let start = ["track", sequence.to_str().unwrap()];
        let cli = Cli::try_parse_from(start.iter().chain(more)).unwrap();
        (cli.recorded.unwrap(), cli.settings.settings().unwrap())
    }

    fn track_with(sequence: &Path, more: &[&str]) -> Vec<TrackedImage> {
        let (recorded, settings) = args(sequence, more);
        track(&recorded, settings).unwrap()
    }

    fn run_with(sequence: &Path, more: &[&str]) -> Result<(), AppError> {
        let (recorded, settings) = args(sequence, more);
        run(&recorded, settings)
    }

    /// A bright blob that moves over a slow texture.
    fn image(k: u32) -> Image {
        let tip = [40.0 + 2.0 * f64::from(k), 50.0 + f64::from(k)];
        let level = |u: u32, v: u32| {
            let (x, y) = (f64::from(u) - tip[0], f64::from(v) - tip[1]);
            (40.0
                + 15.0 * (f64::from(u) * 0.3).sin() * (f64::from(v) * 0.37).cos()
                + 170.0 * (-(x * x) / 24.0 - y * y / 12.0).exp()) as u8
        };
        Image::from_pixels(160, 120, (0..120).flat_map(|v| (0..160).map(move |u| level(u, v))).collect())
            .unwrap()
    }

    fn sequence(folder: &Path) -> PathBuf {
        let path = folder.join("blob.mha");
        let mut writer = SequenceWriter::create(&path, [160, 120], 0.1).unwrap();
        for k in 0..20 {
            writer.push(&image(k), 0.04 * f64::from(k), &[], &[]).unwrap();
        }
        writer.finish().unwrap();
        path
    }

    #[test]
    fn a_recording_becomes_a_table() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("deep/out");
        let path = sequence(folder.path());
        for (profile, similarity, order) in
            [("robust", "scv", "2"), ("robust", "ssd", "1"), ("paper", "ssd", "2")]
        {
            let options =
                ["--init", "40,50", "--profile", profile, "--similarity", similarity, "--order", order];
            run_with(&path, &[&options[..], &["--out", out.to_str().unwrap()]].concat()).unwrap();
            let text = fs::read_to_string(out.join(TABLE)).unwrap();
            let lines: Vec<&str> = text.lines().collect();
            assert_eq!(lines[0], COLUMNS);
            assert_eq!(lines.len(), 21);
            assert!(lines[1].starts_with("0,40.0000,50.0000,tracking,1.000000,1.000000,0,"), "{}", lines[1]);
            for (k, line) in lines[1..].iter().enumerate() {
                let cells: Vec<&str> = line.split(',').collect();
                assert_eq!(cells[0], k.to_string());
                assert_eq!(cells[3], "tracking");
                assert!((cells[1].parse::<f64>().unwrap() - 40.0 - 2.0 * k as f64).abs() < 1.0, "{line}");
                assert!((cells[2].parse::<f64>().unwrap() - 50.0 - k as f64).abs() < 1.0, "{line}");
            }
        }
        assert_eq!(fs::read_dir(&out).unwrap().count(), 3, "no temporary file is left");
        let strip = image::open(out.join(STRIP)).unwrap().into_rgb8();
        // Twelve cells of 240 × (120 + 22) px in four columns, and the title.
        assert_eq!(strip.dimensions(), (4 * (240 + 6) + 6, 22 + 3 * (120 + 22 + 6) + 6));
        let gif = fs::read(out.join(GIF)).unwrap();
        assert!(gif.starts_with(b"GIF89a"));
        assert_eq!(gif[6..10], [400_u16.to_le_bytes(), (120_u16 + 22).to_le_bytes()].concat());
    }

    /// Columns that came later stand behind the first eight, whose order others rely on.
    #[test]
    fn what_the_tracker_knows_of_an_image_is_in_its_row() {
        let estimate = Estimate {
            ncc_previous: Some(0.75),
            ncc_anchor: Some(0.5),
            brightness_ratio: Some(0.25),
            tip_level: Some(99.5),
            iterations: 7,
            conditioning: Some(0.125),
            ..Estimate::bare(TrackState::Lost, Reason::NccPrevious, Some([12.5, 3.25]))
        };
        let linear = Some([[1.0, -0.5], [0.5, 2.0]]);
        let nothing = Estimate::bare(TrackState::Searching, Reason::NoCandidate, None);
        let text = table(&[
            TrackedImage { estimate, linear, time_us: 41.26 },
            TrackedImage { estimate: nothing, linear: None, time_us: 1.0 },
        ]);
        let lines: Vec<_> = text.lines().collect();
        assert!(
            lines[0].starts_with("image,u_px,v_px,state,ncc_previous,ncc_anchor,iterations,time_us,reason,")
        );
        assert_eq!(
            lines[1],
            "0,12.5000,3.2500,lost,0.750000,0.500000,7,41.3,ncc_previous,0.250000,99.500,0.125000,\
             1.000000,-0.500000,0.500000,2.000000"
        );
        assert_eq!(lines[2], "1,,,searching,,,0,1.0,no_candidate,,,,,,,");
        assert!(lines.iter().all(|line| line.split(',').count() == 16));
    }

    #[test]
    fn a_needle_is_found_without_a_click() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("needle.mha");
        let mut writer = SequenceWriter::create(&path, [320, 240], 0.1).unwrap();
        // Three images without a needle, then one that comes in from the top left, bright at its tip.
        for k in 0..20u32 {
            let tip = [120.0 + 2.0 * f64::from(k), 80.0 + f64::from(k)];
            let level = |u: u32, v: u32| {
                let (x, y) = (f64::from(u) - tip[0], f64::from(v) - tip[1]);
                let (along, across) = (0.894 * x + 0.447 * y, 0.894 * y - 0.447 * x);
                let shaft = if along < 0.0 { 90.0 * (-across * across / 5.0).exp() } else { 0.0 };
                let bead = 120.0 * (-(along + 2.0).powi(2) / 18.0 - across * across / 10.0).exp();
                let ground = 40.0 + 12.0 * (f64::from(u) * 0.31).sin() * (f64::from(v) * 0.27).cos();
                (ground + if k < 3 { 0.0 } else { shaft + bead }).min(255.0) as u8
            };
            let pixels = (0..240).flat_map(|v| (0..320).map(move |u| level(u, v))).collect();
            writer
                .push(&Image::from_pixels(320, 240, pixels).unwrap(), 0.04 * f64::from(k), &[], &[])
                .unwrap();
        }
        writer.finish().unwrap();
        for tracker in ["template", "baseline"] {
            let rows = track_with(&path, &["--init", "localize", "--tracker", tracker]);
            for (k, TrackedImage { estimate, .. }) in rows.iter().enumerate() {
                if k < 3 {
                    assert_eq!(estimate.state, TrackState::Searching, "{tracker}, image {k}");
                    continue;
                }
                let [u, v] = estimate.tip_px.unwrap();
                assert_eq!(estimate.state, TrackState::Tracking, "{tracker}, image {k}");
                let off = (u - 120.0 - 2.0 * k as f64).hypot(v - 80.0 - k as f64);
                assert!(off < 6.0, "{tracker}, image {k}: {off} px off");
            }
        }
        let error = run_with(&path, &["--init", "40,50", "--tracker", "baseline"]).unwrap_err();
        assert!(error.to_string().contains("--init localize"), "{error}");
    }

    #[test]
    fn bad_input_is_named_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let path = sequence(folder.path());
        let refused = |path: &Path, more: &[&str], expected: &str| {
            let error = run_with(path, &[more, &["--out", out.to_str().unwrap()]].concat()).unwrap_err();
            assert!(matches!(error, AppError::BadInput(_)));
            let message = error.to_string();
            assert!(message.contains(expected) && !message.contains('\n'), "{message}");
            assert!(!out.exists());
        };
        refused(&path, &["--init", "400,50"], "--init 400,50 in an image of 160 × 120 px: tip (400, 50) px");
        refused(&path, &["--init", "-4,50"], "--init -4,50");
        refused(&path, &["--init", "80,60", "--template", "128"], "a template of 128 px does not fit");
        let missing = folder.path().join("missing.mha");
        refused(&missing, &["--init", "80,60"], "missing.mha: ");
        let whole = fs::read(&path).unwrap();
        let cut = folder.path().join("cut.mha");
        fs::write(&cut, &whole[..whole.len() - 500]).unwrap();
        refused(&cut, &["--init", "40,50"], "cut.mha: CompressedDataSize = ");
    }

    #[test]
    fn the_group_may_be_left_out_but_not_given_in_part() {
        assert!(Cli::try_parse_from(["track", "--domain", "d"]).unwrap().recorded.is_none());
        for bad in [
            &["track", "a.mha"][..],
            &["track", "--init", "1,2"],
            &["track", "a.mha", "--init", "1;2"],
            &["track", "a.mha", "--init", "1,x"],
            &["track", "a.mha", "--init", "1,NaN"],
            &["track", "--domain", "d", "--template", "31"],
            &["track", "--domain", "d", "--profile", "paper"],
            &["track", "a.mha", "--init", "1,2", "--order", "3"],
            &["track", "a.mha", "--init", "1,2", "--warp", "bicubic"],
        ] {
            assert_eq!(Cli::try_parse_from(bad).unwrap_err().exit_code(), 2, "{bad:?}");
        }
    }

    /// Six wire centres per image as the PLUS toolkit's own segmentation found them, by image.
    fn wires(text: &str) -> Vec<(usize, Vec<f64>)> {
        let attribute = |case: &str, name: &str| {
            let start = case.find(&format!("{name}=\""))? + name.len() + 2;
            Some(case[start..].split('"').next()?.to_owned())
        };
        let case = |case: &str| {
            let image = attribute(case, "ImageSeqFrameIndex")?.parse().ok()?;
            let points: Vec<f64> = attribute(case, "SegmentationPoints")?
                .split_whitespace()
                .map(|n| n.parse().unwrap())
                .collect();
            (points.len() == 12).then_some((image, points))
        };
        text.split("<TestCase ").skip(1).filter_map(case).collect()
    }

    #[test]
    fn truth_wires_in_water_are_followed() {
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/plus_wires");
        let Ok(text) = fs::read_to_string(data.join("wires_truth.xml")) else {
            println!("skipped: the recorded wires are not beside this repository");
            return;
        };
        let truth = wires(&text);
        assert_eq!(truth.len(), 196);
        for (wire, bound_px) in [(1, 1.25), (4, 0.65)] {
            for similarity in ["ssd", "scv"] {
                let at = |points: &[f64]| [points[2 * wire], points[2 * wire + 1]];
                let [u, v] = at(&truth[0].1);
                let init = format!("{u},{v}");
                let rows =
                    track_with(&data.join("wires.igs.mha"), &["--init", &init, "--similarity", similarity]);
                let mut errors: Vec<f64> = truth[1..]
                    .iter()
                    .map(|(image, points)| {
                        let (estimate, [u, v]) = (rows[*image].estimate, at(points));
                        let tip = estimate.tip_px.filter(|_| estimate.state == TrackState::Tracking);
                        tip.map_or(f64::INFINITY, |tip| (tip[0] - u).hypot(tip[1] - v))
                    })
                    .collect();
                errors.sort_by(f64::total_cmp);
                let median = errors[errors.len() / 2];
                println!("wire {wire} {similarity}: median {median:.3} px");
                assert!(median <= bound_px, "wire {wire} {similarity}: {median} px");
            }
        }
    }
}
