//! Table I: time per image of SSD and SCV with first- and second-order optimisation.

use std::time::Instant;

use sonoloop_tracker::Context;
use sonoloop_types::{Optimisation, Profile, Similarity, TrackState, TrackerSettings};

use super::sequence::Sequence;
use super::updates::begin;
use crate::error::AppError;
use crate::output::median;

/// The paper's template, and that of its Fig. 1.
const TEMPLATES_PX: [u32; 2] = [20, 61];
/// Every image is timed this often; the median counts, so that what else a machine does is not in it.
const REPEATS: usize = 5;

/// One cell of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    pub template_px: u32,
    pub similarity: Similarity,
    pub order: Optimisation,
    /// Images timed: those in which the needle moves and the tip is tracked, within 5 px.
    pub images: usize,
    /// Mean time of an image.
    pub mean_us: f64,
    /// Standard deviation over the images.
    pub sigma_us: f64,
    /// Mean number of iterations of an image.
    pub iterations: f64,
}

/// Both similarities with both orders, by template. One thread; nothing else of this program runs meanwhile.
pub(super) fn table(sequence: &Sequence) -> Result<Vec<Cell>, AppError> {
    let mut cells = Vec::new();
    for template_px in TEMPLATES_PX {
        for similarity in [Similarity::Ssd, Similarity::Scv] {
            for order in [Optimisation::FirstOrder, Optimisation::SecondOrder] {
                let settings = TrackerSettings {
                    similarity,
                    optimisation: order,
                    // The paper's.
                    max_iterations: 50,
                    epsilon_px: 0.01,
                    ..TrackerSettings::profile(Profile::Paper, template_px)
                };
                cells.push(cell(sequence, settings)?);
            }
        }
    }
    Ok(cells)
}

/// What is called tracked here; farther off the time is that of following something else.
fn is_near(tip_px: Option<[f64; 2]>, true_px: [f64; 2]) -> bool {
    tip_px.is_some_and(|[u, v]| (u - true_px[0]).hypot(v - true_px[1]) <= 5.0)
}

fn cell(sequence: &Sequence, settings: TrackerSettings) -> Result<Cell, AppError> {
    let mut times_us: Vec<Vec<f64>> = vec![Vec::new(); sequence.rows.len()];
    let mut iterations = vec![0; sequence.rows.len()];
    for _ in 0..REPEATS {
        let mut tracker = begin(sequence, settings)?;
        for (index, row) in sequence.rows.iter().enumerate().skip(1) {
            let image = sequence.image(index)?;
            let began = Instant::now();
            let estimate = tracker.track(&image, &Context::default());
            let time_us = began.elapsed().as_secs_f64() * 1e6;
            // The first image of a size allocates what all others use.
            let is_tracked =
                estimate.state == TrackState::Tracking && is_near(estimate.tip_px, row.truth.reference_px);
            if index > 1 && is_tracked && row.truth.feed_m_s > 0.0 {
                times_us[index].push(time_us);
                iterations[index] = estimate.iterations;
            }
        }
    }
    let medians: Vec<f64> = times_us.iter().filter_map(|times| median(times)).collect();
    let timed = times_us.iter().zip(&iterations).filter(|(times, _)| !times.is_empty());
    let total: u32 = timed.map(|(_, iterations)| iterations).sum();
    let images = medians.len();
    let mean_us = medians.iter().sum::<f64>() / images as f64;
    let variance = medians.iter().map(|time| (time - mean_us).powi(2)).sum::<f64>() / images as f64;
    Ok(Cell {
        template_px: settings.template_px,
        similarity: settings.similarity,
        order: settings.optimisation,
        images,
        mean_us,
        sigma_us: variance.sqrt(),
        iterations: f64::from(total) / images as f64,
    })
}
