//! The video with overlay: H.264 when ffmpeg is there and can, an animated GIF otherwise.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use image::RgbImage;
use sonoloop_types::TICKS_PER_SECOND;

use super::OutputError;
use super::animation::{Pictures, write_gif};
use super::overlay::{Display, Scale};
use super::stage::Stage;
use crate::record::{ImageRow, ImageStore};

/// Name of the video when ffmpeg wrote it.
pub const MP4: &str = "video.mp4";
/// Name of the animated picture otherwise.
pub const GIF: &str = "video.gif";

/// Encoders tried in this order; all play in browsers.
const CODECS: [&str; 2] = ["libx264", "libopenh264"];

/// The pictures of a run, drawn one by one.
pub(super) struct Frames<'a> {
    rows: &'a [ImageRow],
    pixels: &'a ImageStore,
    display: &'a Display,
    period_ticks: u64,
}

impl<'a> Frames<'a> {
    pub fn new(
        rows: &'a [ImageRow],
        pixels: &'a ImageStore,
        display: &'a Display,
        period_ticks: u64,
    ) -> Self {
        Self { rows, pixels, display, period_ticks }
    }
}

impl Pictures for Frames<'_> {
    fn len(&self) -> usize {
        self.rows.len().min(self.pixels.len())
    }

    fn period_ms(&self) -> u64 {
        self.period_ticks * 1000 / TICKS_PER_SECOND
    }

    fn size_px(&self, scale: Scale) -> (u32, u32) {
        self.display.size_px(scale)
    }

    fn draw(&self, index: usize, scale: Scale) -> Result<RgbImage, OutputError> {
        let image = self.pixels.get(index).map_err(OutputError::Pictures)?;
        Ok(self.display.draw(&image, &self.rows[index], scale))
    }
}

/// Which kind of video was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VideoKind {
    /// `video.mp4`, every image, by this encoder of ffmpeg.
    Mp4 {
        /// Name of the encoder.
        codec: &'static str,
    },
    /// `video.gif`.
    Gif {
        /// Why there is no `video.mp4`.
        reason: String,
        /// Every how many images one is shown.
        stride: usize,
        /// Whether the picture is drawn at half its size.
        half_size: bool,
    },
}

impl VideoKind {
    /// Name of the file.
    pub fn file_name(&self) -> &'static str {
        match self {
            Self::Mp4 { .. } => MP4,
            Self::Gif { .. } => GIF,
        }
    }
}

impl fmt::Display for VideoKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mp4 { codec } => write!(f, "{MP4} (H.264 by ffmpeg, {codec})"),
            Self::Gif { reason, stride, half_size } => {
                let size = if *half_size { ", picture at half size" } else { "" };
                write!(f, "{GIF} (1 of {stride} images{size}; no H.264: {reason})")
            }
        }
    }
}

/// Writes the video of a run into `stage`; `None` when the run has no pictures.
pub(super) fn write_video(stage: &Stage, frames: &Frames<'_>) -> Result<Option<VideoKind>, OutputError> {
    if frames.len() == 0 {
        return Ok(None);
    }
    let reason = match write_mp4(&stage.path(MP4), frames)? {
        Ok(codec) => return Ok(Some(VideoKind::Mp4 { codec })),
        Err(reason) => reason,
    };
    let thinning = write_gif(&stage.path(GIF), frames)?;
    let half_size = thinning.scale == Scale::Half;
    Ok(Some(VideoKind::Gif { reason, stride: thinning.stride, half_size }))
}

/// Pipes the pictures through ffmpeg. The inner error says why no encoder did it; no file is left then.
fn write_mp4(path: &Path, frames: &Frames<'_>) -> Result<Result<&'static str, String>, OutputError> {
    let mut reason = String::new();
    for codec in CODECS {
        match encode(path, frames, codec)? {
            Ok(()) => return Ok(Ok(codec)),
            Err(why) => reason = why,
        }
        let _ = fs::remove_file(path);
        if reason == NOT_INSTALLED {
            break;
        }
    }
    Ok(Err(reason))
}

const NOT_INSTALLED: &str = "ffmpeg is not installed";

fn encode(path: &Path, frames: &Frames<'_>, codec: &str) -> Result<Result<(), String>, OutputError> {
    // Its messages go to a file: a pipe that nobody reads could fill up and stop it.
    let messages = path.with_extension("log");
    let log = File::create(&messages).map_err(|source| OutputError::at(&messages, source))?;
    let (width, height) = frames.size_px(Scale::Full);
    let spawned = Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-video_size", &format!("{width}x{height}")])
        .args(["-framerate", &format!("{TICKS_PER_SECOND}/{}", frames.period_ticks.max(1))])
        .args(["-i", "-", "-c:v", codec, "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
        .args(if codec == "libx264" { &["-crf", "23", "-preset", "veryfast"][..] } else { &["-b:v", "4M"] })
        .arg(path)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(log)
        .spawn();
    let result = match spawned {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(NOT_INSTALLED.to_owned()),
        Err(error) => Err(format!("ffmpeg does not start: {error}")),
        Ok(mut child) => {
            let fed = feed(child.stdin.take(), frames);
            let status = child.wait();
            let said = fs::read_to_string(&messages).unwrap_or_default();
            let first_line = said.lines().next().unwrap_or("it gave no reason").to_owned();
            match (fed?, status) {
                (Ok(()), Ok(status)) if status.success() => Ok(()),
                _ => Err(format!("ffmpeg failed with {codec}: {first_line}")),
            }
        }
    };
    let _ = fs::remove_file(&messages);
    Ok(result)
}

/// Writes all pictures; the inner error is ffmpeg's end of the pipe, the outer one ours.
fn feed(pipe: Option<impl Write>, frames: &Frames<'_>) -> Result<io::Result<()>, OutputError> {
    let Some(mut pipe) = pipe else { return Ok(Err(io::ErrorKind::BrokenPipe.into())) };
    for index in 0..frames.len() {
        let picture = frames.draw(index, Scale::Full)?;
        if let Err(error) = pipe.write_all(picture.as_raw()) {
            return Ok(Err(error));
        }
    }
    Ok(Ok(()))
}
