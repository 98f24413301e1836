//! The command line, as [`clap`] sees it.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use sonoloop_wire::Control;

use crate::track_recorded::TrackRecorded;
use crate::tracker_args::TrackerArgs;

/// Simulation in the loop for robotic ultrasound needle guidance.
#[derive(Debug, Parser)]
#[command(name = "sonoloop", version, about, arg_required_else_help = true, after_help = EXAMPLES)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const EXAMPLES: &str = "\
Examples:
  sonoloop run scenarios/lateral_recovery.yaml --out out/recovery
  sonoloop view scenarios/lateral_recovery.yaml
  sonoloop run scenarios/lateral_plain.yaml --seed 7 --set servo.dither_mm=0.2 --json
  sonoloop suite scenarios --seeds 10
  sonoloop render phantoms/gelatin_agar_heterogeneous.yaml --needle-angle-deg 40 --out picture.png
  sonoloop replay out/recovery
  sonoloop render --gallery out/atlas
  sonoloop track recording.mha --init 238.1,327.6 --out out/track
  sonoloop paper --out out/paper

Exit codes: 0 pass, 1 an expectation failed, 2 bad input, 3 runtime fault.
Not for clinical use.";

const TRACK_EXAMPLES: &str = "\
Examples:
  sonoloop track recording.mha --init 238.1,327.6 --out out/track
  sonoloop track recording.mha --init 238.1,327.6 --profile paper --similarity ssd --template 31 --update naive
  sonoloop track folder_of_png --init 238.1,327.6 --guess kalman --pyramid-levels 3
  sonoloop track recording.mha --init 238.1,327.6 --loss-ncc-anchor 0.6 --loss-brightness-ratio none
  sonoloop track recording.mha --init localize --warp rigid --weight-sigma-px 6 --out out/found
  sonoloop track recording.mha --init localize --tracker baseline --out out/baseline

Every option that is left out has its value from the profile. Not for clinical use.";

const VIEW_EXAMPLES: &str = "\
Examples:
  sonoloop view scenarios/lateral_recovery.yaml
  sonoloop view scenarios/lateral_plain.yaml --speed 0.5 --port 9000
  sonoloop view scenarios/transverse_plain.yaml --set servo.dither_mm=0.2 --out out/watched

Prints the page's address, and ends with Ctrl-C. The run waits at its first image for the first browser, and at its end for
\"restart\". Only this machine can see the page unless --address says otherwise: there is no password. Not for clinical use.";

const REPORT_EXAMPLES: &str = "\
Examples:
  sonoloop run scenarios/lateral_recovery.yaml --out out/recovery
  sonoloop report out/recovery

Reads summary.json, images.csv, events.csv and scenario.yaml, and the pictures from pictures.mjpeg where it is there.
Not for clinical use.";

const REPLAY_EXAMPLES: &str = "\
Examples:
  sonoloop run scenarios/lateral_recovery.yaml --out out/recovery
  sonoloop replay out/recovery

Exit codes: 0 all the same, 1 something differs (the first difference is named), 2 no comparison is possible: a file is
missing or damaged, or the run was paced by the clock, had a tracker of its own or ended early.";

const PAPER_EXAMPLES: &str = "\
Examples:
  sonoloop paper --out out/paper
  sonoloop paper --out out/paper --studies

In the folder: report.html, and all its data as CSV. A few minutes on two cores; with --studies up to half an hour.
Exit codes: 0 all sequences pass, 1 one fails, 2 bad input, 3 runtime fault. Not for clinical use.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a scenario: two processes, progress, metrics, verdict
    Run(RunArgs),
    /// Run every scenario below the given paths: success rates, medians of the metrics, pooled by folder
    Suite(SuiteArgs),
    /// The simulator's half: wait for a tracker started elsewhere, then run
    Sim(SimArgs),
    /// Show a run in the browser, live: pause, step, disturb, tune, restart; lessons
    #[command(after_help = VIEW_EXAMPLES)]
    View(ViewArgs),
    /// The tracker's half (--domain), or the tracker alone on recorded images (SEQUENCE --init U,V)
    #[command(after_help = TRACK_EXAMPLES)]
    Track(Box<TrackArgs>),
    /// Render one image of a phantom as PNG, or an atlas (--gallery)
    Render(RenderArgs),
    /// Check scenarios, phantoms, materials, probes and needles without running them
    Check(CheckArgs),
    /// Show what is in the box: scenarios, robots, probes, needles, phantoms
    List(ListArgs),
    /// Make report.html of a run again, from the files in its folder alone
    #[command(after_help = REPORT_EXAMPLES)]
    Report(FolderArgs),
    /// Run a recorded run again and compare: every image's hash, estimate and truth, and the events
    #[command(after_help = REPLAY_EXAMPLES)]
    Replay(FolderArgs),
    /// Run the paper's twenty sequences and make its figures and tables again: one report, what was measured beside what the
    /// paper says
    #[command(after_help = PAPER_EXAMPLES)]
    Paper(PaperArgs),
    /// Remove shared memory left over by killed runs; live runs are not touched
    Clean,
}

/// Which experiment, and what to change in it.
#[derive(Debug, Clone, Args)]
pub struct ScenarioArgs {
    /// Scenario file
    pub file: PathBuf,
    /// Seed of everything random; the file's own when absent
    #[arg(long)]
    pub seed: Option<u64>,
    /// Override any value of the file, e.g. --set servo.dither_mm=0.2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Where results go.
#[derive(Debug, Args)]
pub struct OutputArgs {
    /// Folder for summary, tables, plots, report and video
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Also write every image to sequence.mha (with --out)
    #[arg(long, requires = "out")]
    pub record: bool,
    /// Print the summary as JSON, and nothing else, on standard output
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The experiment.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Where results go.
    #[command(flatten)]
    pub output: OutputArgs,
    /// One process without shared memory; the same bytes
    #[arg(long)]
    pub in_process: bool,
    /// Paced by the clock: nobody waits for the tracker, the newest command counts, how stale it was is reported; the same
    /// seed gives another run next time
    #[arg(long, conflicts_with = "in_process")]
    pub realtime: bool,
    /// Own tracker: a command that joins through SONOLOOP_DOMAIN and SONOLOOP_ROOT; "none" for no tracker; or one
    /// of the trackers that do not look: dead-reckoning, always-tracking, always-lost
    #[arg(long, value_name = "CMD", conflicts_with = "in_process")]
    pub tracker: Option<String>,
}

/// Arguments of `suite`.
#[derive(Debug, Args)]
pub struct SuiteArgs {
    /// Scenario files, or folders that are searched for *.yaml
    #[arg(required = true)]
    pub paths: Vec<PathBuf>,
    /// Runs at a time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: u16,
    /// Seeds per scenario, counted from the file's own; rates come with 95 % Wilson intervals
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    pub seeds: u16,
    /// Override a value in every scenario
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write the results as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Print the results as JSON, and nothing else, on standard output
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `sim`.
#[derive(Debug, Args)]
pub struct SimArgs {
    /// The experiment.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Where results go.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Seconds to wait for a tracker
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub wait_s: u64,
}

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The experiment.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Port of the page; 0 for any that is free
    #[arg(long, default_value_t = 8400)]
    pub port: u16,
    /// Address to listen on; whoever reaches it may steer the run
    #[arg(long, default_value = "127.0.0.1")]
    pub address: IpAddr,
    /// Simulated seconds per second, 0.01 to 1000, or "max" for as fast as it goes; the page can change it
    #[arg(long, default_value = "1", value_parser = speed)]
    pub speed: Speed,
    /// Folder of lessons: a Markdown file and a scenario of the same name each
    #[arg(long, value_name = "DIR", default_value = "lessons")]
    pub lessons: PathBuf,
    /// Folder for the files of every run that comes to its end, as `run --out` writes them: DIR/1, DIR/2, …
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Simulated seconds per second; `None` for as fast as it goes.
pub type Speed = Option<f64>;

fn speed(text: &str) -> Result<Speed, String> {
    let json = if text == "max" { "null" } else { text };
    match Control::decode(format!(r#"{{"speed": {json}}}"#).as_bytes())? {
        Control::Speed(speed) => Ok(speed),
        _ => Err("no speed".into()),
    }
}

/// Arguments of `track`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct TrackArgs {
    /// Join the run with this domain (SONOLOOP_DOMAIN)
    #[arg(long, requires = "root")]
    pub domain: Option<String>,
    /// Root folder of that run (SONOLOOP_ROOT)
    #[arg(long)]
    pub root: Option<PathBuf>,
    /// With --domain: answer as one of the trackers that do not look
    #[arg(long, value_name = "NAME", requires = "domain")]
    pub null: Option<String>,
    /// The tracker alone.
    #[command(flatten)]
    pub recorded: Option<TrackRecorded>,
    /// How it tracks.
    #[command(flatten)]
    pub settings: TrackerArgs,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Phantom file; with --gallery the one that carries the needle, and its folder's phantoms are pictured too
    /// [with --gallery default: phantoms/gelatin_agar.yaml]
    #[arg(required_unless_present = "gallery")]
    pub phantom: Option<PathBuf>,
    /// Write an atlas into this folder instead: every phantom, needle angles and offsets, contact, settings, index.html
    #[arg(long, value_name = "DIR", conflicts_with_all = ["x_mm", "y_mm", "yaw_deg", "tilt_deg", "needle_angle_deg",
        "tip_depth_mm", "offset_mm", "transverse", "gain_db", "out"])]
    pub gallery: Option<PathBuf>,
    /// Probe file
    #[arg(long, default_value = "robots/probes/l12_3v.yaml")]
    pub probe: PathBuf,
    /// Turn a setting of the probe: any key of its file, e.g. --set depth_mm=60, --set transmit_focus_mm=20,
    /// --set effects.boundaries=false
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Needle file
    #[arg(long, default_value = "robots/needles/22g_150mm.yaml")]
    pub needle: PathBuf,
    /// Middle of the probe along the phantom's x
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub x_mm: f64,
    /// Middle of the probe along the phantom's y
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub y_mm: f64,
    /// Turn about the vertical
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub yaw_deg: f64,
    /// Lean of the plane in elevation
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub tilt_deg: f64,
    /// Put a needle into the picture, this far below the horizontal
    #[arg(long, allow_negative_numbers = true)]
    pub needle_angle_deg: Option<f64>,
    /// Depth of the needle's tip below the probe
    #[arg(long, default_value_t = 25.0)]
    pub tip_depth_mm: f64,
    /// Distance of the needle from the plane
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub offset_mm: f64,
    /// Let the needle cross the plane instead of lying in it
    #[arg(long)]
    pub transverse: bool,
    /// Gain on top of the probe's own
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub gain_db: f64,
    /// Seed of the speckle
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// The picture to write, a .png
    #[arg(long, value_name = "FILE", default_value = "render.png")]
    pub out: PathBuf,
}

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Files, or folders that are searched for *.yaml; a file without a schema line is taken for a scenario
    #[arg(required = true)]
    pub paths: Vec<PathBuf>,
}

/// Arguments of `report` and `replay`.
#[derive(Debug, Args)]
pub struct FolderArgs {
    /// Folder that a run has written with --out
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// Arguments of `list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Folder that holds scenarios, robots and phantoms
    #[arg(default_value = ".")]
    pub folder: PathBuf,
}

/// Arguments of `paper`.
#[derive(Debug, Args)]
pub struct PaperArgs {
    /// Folder for report.html and its data
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Also compare the paper's plain configuration with the defaults over ten seeds, and map where both break
    #[arg(long)]
    pub studies: bool,
    /// Folder that holds the sequences
    #[arg(long, value_name = "DIR", default_value = "scenarios/paper")]
    pub scenarios: PathBuf,
}
