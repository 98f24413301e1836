//! What a run has left in its folder, read back.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use sonoloop_types::{Event, Reason, TrackState};

use crate::output::{PICTURES, Summary, split};

/// One row of `images.csv`, as far as anybody reads it back; columns are found by their names.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[expect(missing_docs, reason = "the columns of the file, described where they are written")]
pub struct ImageLine {
    pub sequence: u64,
    pub tick: u64,
    pub publication_tick: u64,
    pub tip_u_px: f64,
    pub tip_v_px: f64,
    pub visible: u8,
    pub plane_offset_mm: f64,
    pub half_slice_mm: f64,
    pub estimate_u_px: Option<f64>,
    pub estimate_v_px: Option<f64>,
    pub state: Option<TrackState>,
    pub reason: Option<Reason>,
    pub ncc_previous: Option<f64>,
    pub ncc_anchor: Option<f64>,
    pub brightness_ratio: Option<f64>,
    pub depth_mm: f64,
    pub feed_mm_s: f64,
    pub force_n: f64,
}

impl ImageLine {
    /// The tip as estimated.
    pub fn estimate_px(&self) -> Option<[f64; 2]> {
        Some([self.estimate_u_px?, self.estimate_v_px?])
    }

    /// The true tip in the picture.
    pub fn tip_px(&self) -> [f64; 2] {
        [self.tip_u_px, self.tip_v_px]
    }

    /// Distance of estimate and true tip.
    pub fn tip_error_px(&self) -> Option<f64> {
        let ([u, v], [true_u, true_v]) = (self.estimate_px()?, self.tip_px());
        Some((u - true_u).hypot(v - true_v))
    }

    /// True when the tracker claims to see the tip.
    pub fn is_tracking(&self) -> bool {
        self.state == Some(TrackState::Tracking)
    }
}

/// A run's folder cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum FilesError {
    /// There is no such file, or it cannot be opened.
    #[error("{}: {source}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file does not hold what a run of this version writes.
    #[error("{}: {why}", path.display())]
    Damaged {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// The files of a run that a report is made from.
#[derive(Debug)]
pub struct Files {
    /// Where they are.
    pub folder: PathBuf,
    /// `summary.json`.
    pub summary: Summary,
    /// `images.csv`.
    pub images: Vec<ImageLine>,
    /// `events.csv`.
    pub events: Vec<Event>,
    /// `scenario.yaml`.
    pub scenario_yaml: String,
    /// `pictures.mjpeg`, one picture per image; `None` when there is no such file.
    pub pictures: Option<Vec<Vec<u8>>>,
}

impl Files {
    /// Reads a run's folder.
    ///
    /// # Errors
    ///
    /// Names the first file that is missing, damaged or does not fit to the others. `pictures.mjpeg` may be missing.
    pub fn read(folder: &Path) -> Result<Self, FilesError> {
        let summary = read_summary(folder)?;
        let images: Vec<ImageLine> = read_csv(folder, "images.csv")?;
        if images.len() as u64 != summary.metrics.images {
            let why = format!("{} images, but summary.json counts {}", images.len(), summary.metrics.images);
            return Err(FilesError::Damaged { path: folder.join("images.csv"), why });
        }
        let pictures = read_pictures(folder, images.len())?;
        Ok(Self {
            folder: folder.to_owned(),
            summary,
            images,
            events: read_csv(folder, "events.csv")?,
            scenario_yaml: read_text(folder, "scenario.yaml")?,
            pictures,
        })
    }
}

/// Reads `summary.json`; says so when one that does not fit is of another version.
pub fn read_summary(folder: &Path) -> Result<Summary, FilesError> {
    let text = read_text(folder, "summary.json")?;
    serde_json::from_str(&text).map_err(|error| {
        let version = serde_json::from_str::<Value>(&text)
            .ok()
            .and_then(|json| Some(json["version"].as_str()?.to_owned()));
        let own = env!("CARGO_PKG_VERSION");
        let other = version.filter(|version| version != own);
        let from =
            other.map_or(String::new(), |other| format!(" (written by sonoloop {other}, read by {own})"));
        damaged(folder, "summary.json", format_args!("{error}{from}"))
    })
}

/// Reads a text file of a folder.
pub fn read_text(folder: &Path, name: &str) -> Result<String, FilesError> {
    let path = folder.join(name);
    fs::read_to_string(&path).map_err(|source| FilesError::Read { path, source })
}

fn read_csv<T: DeserializeOwned>(folder: &Path, name: &str) -> Result<Vec<T>, FilesError> {
    let text = read_text(folder, name)?;
    parse_csv(&text).map_err(|error| damaged(folder, name, error))
}

/// The rows of a table with a head.
pub fn parse_csv<T: DeserializeOwned>(text: &str) -> Result<Vec<T>, csv::Error> {
    csv::Reader::from_reader(text.as_bytes()).into_deserialize().collect()
}

fn read_pictures(folder: &Path, images: usize) -> Result<Option<Vec<Vec<u8>>>, FilesError> {
    let path = folder.join(PICTURES);
    let stream = match fs::read(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        read => read.map_err(|source| FilesError::Read { path, source })?,
    };
    let Some(pictures) = split(&stream) else {
        return Err(damaged(folder, PICTURES, "is no stream of whole JPEG pictures"));
    };
    if pictures.len() != images {
        let why = format!("{} pictures, but images.csv has {images} images", pictures.len());
        return Err(damaged(folder, PICTURES, why));
    }
    Ok(Some(pictures.into_iter().map(<[u8]>::to_vec).collect()))
}

fn damaged(folder: &Path, name: &str, why: impl ToString) -> FilesError {
    FilesError::Damaged { path: folder.join(name), why: why.to_string() }
}
