//! Sections of the report that hold the paper's tables and claims.

use sonoloop_types::{Optimisation, Similarity};

use super::Results;
use super::earlier::{Claims, Comparison};
use super::timing::Cell;
use crate::page::{Block, Column, Mark, Row, Section, Table};

/// Table I of the paper: seconds per image, mean and σ; first, then second order.
const PAPER_SSD_S: [(f64, f64); 2] = [(0.18, 0.13), (0.10, 0.04)];
const PAPER_SCV_S: [(f64, f64); 2] = [(0.24, 0.09), (0.14, 0.02)];

/// The result of every sequence.
pub(super) fn results(results: &Results) -> Section {
    let columns = ["sequence", "medium", "needle", "by", "what goes wrong"].map(Column::text).into_iter();
    let numbers = ["images", "lost", "found", "falsely", "RMSE, mm", "95 %, mm", "coverage"];
    let columns = columns.chain(numbers.map(Column::number)).collect();
    let rows = results.sequences.iter().map(|looked| {
        let sequence = &looked.sequence;
        let (scenario, metrics) = (&sequence.scenario, &sequence.metrics);
        let spacing_mm = scenario.probe.geometry.spacing_m * 1e3;
        let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
        let stretches = sequence.lost_stretches();
        let found = stretches.iter().filter(|(_, end)| *end < sequence.rows.len()).count();
        Row::new([
            scenario.name.clone(),
            scenario.phantom.name.clone(),
            scenario.needle.name.split(' ').next().unwrap_or_default().to_owned(),
            sequence.insertion_text().to_owned(),
            sequence.disturbances_text(),
            metrics.images.to_string(),
            stretches.len().to_string(),
            found.to_string(),
            metrics.false_recoveries.to_string(),
            number(metrics.tip_rmse_mm),
            number(metrics.tip_p95_px.map(|px| px * spacing_mm)),
            metrics.coverage.map_or("–".to_owned(), |share| format!("{:.0} %", 100.0 * share)),
        ])
        .marked(Mark::of(sequence.passed()))
    });
    let rows = rows.collect();
    let mut blocks = vec![
        Block::Text(
            "The paper: “16 lateral and 4 transverse frame sequences … 7074 … During the needle insertions, the needle tip was \
             tracked successfully in all of the frame sequences … After the needle tip was aligned with US probe, the needle \
             tip was detected without using any needle tip localization algorithm.” It gives no tip error in numbers."
                .into(),
        ),
        Block::Text(results_text(results)),
        Block::Table(Table { columns, rows }),
        Block::Note(
            "One tracker configuration for all lateral sequences and one for all transverse ones. Lost: losses that the tracker \
             declared; found, falsely: those found again, and recoveries where the tip was not. Tip error over images in which \
             the tip is in the slice and TRACKING; coverage: share of images with the tip in the slice that are TRACKING. A \
             sequence passes when every bound of its file holds: tip RMSE at most 0.6 mm, no false recovery, target reached, and more."
                .into(),
        ),
    ];
    let failed: Vec<_> = results.sequences.iter().filter(|looked| !looked.sequence.passed()).collect();
    for looked in failed {
        blocks.push(Block::Text(format!(
            "{} fails: {}.",
            looked.sequence.name(),
            looked.sequence.failures()
        )));
    }
    Section::new("Results", blocks)
}

fn results_text(results: &Results) -> String {
    let all = results.sequences.len();
    let passed = results.sequences.iter().filter(|looked| looked.sequence.passed()).count();
    let images: u64 = results.sequences.iter().map(|looked| looked.sequence.metrics.images).sum();
    let stretches: Vec<_> =
        results.sequences.iter().map(|looked| looked.sequence.lost_stretches().len()).collect();
    let ends = results.sequences.iter().filter(|looked| looked.sequence.ends_tracking()).count();
    let false_recoveries: u64 =
        results.sequences.iter().map(|looked| looked.sequence.metrics.false_recoveries).sum();
    let worst =
        results.sequences.iter().filter_map(|looked| looked.sequence.metrics.tip_rmse_mm).fold(0.0, f64::max);
    format!(
        "Measured: {passed} of {all} sequences pass, {images} images; {} losses were declared, {false_recoveries} recoveries were \
         false, and {ends} of {all} sequences end with the tip tracked. Largest tip RMSE {worst:.2} mm.",
        stretches.iter().sum::<usize>()
    )
}

/// Table I.
pub(super) fn table_1(cells: &[Cell]) -> Section {
    let find = |template_px, similarity, order| {
        cells.iter().find(|c| c.template_px == template_px && c.similarity == similarity && c.order == order)
    };
    let mut rows = Vec::new();
    let mut text = String::new();
    let templates: Vec<u32> =
        [20, 61].into_iter().filter(|px| cells.iter().any(|cell| cell.template_px == *px)).collect();
    for template_px in templates {
        for (similarity, name, paper) in
            [(Similarity::Ssd, "SSD", PAPER_SSD_S), (Similarity::Scv, "SCV", PAPER_SCV_S)]
        {
            let first = find(template_px, similarity, Optimisation::FirstOrder);
            let second = find(template_px, similarity, Optimisation::SecondOrder);
            let (Some(first), Some(second)) = (first, second) else { continue };
            if first.images == 0 || second.images == 0 {
                text += &format!(
                    " {name} on {template_px} × {template_px} px lost the tip before it could be timed."
                );
                continue;
            }
            let time = |cell: &Cell| format!("{:.0} ± {:.0}", cell.mean_us, cell.sigma_us);
            let less = 100.0 * (1.0 - second.mean_us / first.mean_us);
            let iterations = format!("{:.1} → {:.1}", first.iterations, second.iterations);
            let (paper_first, paper_second, paper_less) = if template_px == 20 {
                let [(mean_1, sigma_1), (mean_2, sigma_2)] = paper;
                let less = 100.0 * (1.0 - mean_2 / mean_1);
                (
                    format!("{mean_1:.2} ± {sigma_1:.2}"),
                    format!("{mean_2:.2} ± {sigma_2:.2}"),
                    format!("{less:.0} %"),
                )
            } else {
                ("–".to_owned(), "–".to_owned(), "–".to_owned())
            };
            if template_px == 20 {
                text += &format!(
                    " {name} on 20 × 20 px: second order takes {:.0} % {} time{}, its iterations go from {:.1} to {:.1} per image.",
                    less.abs(),
                    if less >= 0.0 { "less" } else { "more" },
                    if less >= 40.0 { ", as told" } else { ", not 40 % less" },
                    first.iterations,
                    second.iterations
                );
            }
            rows.push(Row::new([
                format!("{name}, {template_px} × {template_px}"),
                time(first),
                time(second),
                format!("{less:.0} %"),
                iterations,
                first.images.min(second.images).to_string(),
                paper_first,
                paper_second,
                paper_less,
            ]));
        }
    }
    let numbers = [
        "1st order, µs",
        "2nd order, µs",
        "less by",
        "iterations, 1st → 2nd",
        "images",
        "paper: 1st, s",
        "paper: 2nd, s",
        "paper: less by",
    ];
    let columns = std::iter::once(Column::text("method")).chain(numbers.map(Column::number)).collect();
    Section::new(
        "Table I: time per image",
        vec![
            Block::Text(
                "The paper's settings (at most 50 iterations, ε 0.01, template 20 × 20), and the template of its Fig. 1. Mean and σ \
                 over the images of one insertion in which the needle moves and is tracked, each the median of five passes, on one thread of \
                 this machine; both registrations (T_n and T_1) and all tests are in it."
                    .into(),
            ),
            Block::Table(Table { columns, rows }),
            Block::Text(format!(
                "The paper: “reduced over 40 % in both tracking methods”, in MATLAB.{text} Second order saves iterations where an \
                 image moves by more than what the sums rest on is wide: over rigid scenes with motions of 3 px it needs a third of them on \
                 61 × 61 px, and as many as first order on a tip of 20 × 20 px (tests of the tracker hold that)."
            )),
        ],
    )
}

/// The claim about earlier methods.
pub(super) fn earlier(results: &Results) -> Section {
    let mut rows = Vec::new();
    let mut all = Comparison { baseline: Claims::default(), template: Claims::default() };
    let spacing_m =
        results.sequences.first().map_or(1e-4, |looked| looked.sequence.scenario.probe.geometry.spacing_m);
    for looked in &results.sequences {
        let Some(comparison) = looked.comparison else { continue };
        let scenario = &looked.sequence.scenario;
        // What the claim is about: a plane that leaves the needle, or structures that look like one.
        if comparison.template.absent == 0 && scenario.phantom.inclusions.is_empty() {
            continue;
        }
        all.baseline = all.baseline.and(comparison.baseline);
        all.template = all.template.and(comparison.template);
        rows.push(row(&scenario.name, &scenario.phantom.name, &comparison, spacing_m));
    }
    rows.push(row("all", "of these", &all, spacing_m));
    let numbers = [
        "RMSE, mm: earlier",
        "template",
        "> 2 mm off: earlier",
        "template",
        "out of plane",
        "claimed there: earlier",
        "template",
    ];
    let columns =
        ["sequence", "medium"].map(Column::text).into_iter().chain(numbers.map(Column::number)).collect();
    let share = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    let (b, t) = (&all.baseline, &all.template);
    let [b_absent, t_absent] = [b, t].map(|claims| share(claims.false_detections, claims.absent));
    let [b_mm, t_mm] = [b, t].map(|claims| claims.rmse_mm(spacing_m).unwrap_or(f64::NAN));
    let holds = b_mm > t_mm && b_absent > t_absent;
    Section::new(
        "The claim about earlier methods",
        vec![
            Block::Text(
                "The paper: localisation in every image (Gabor filter, RANSAC line, Kalman filter) takes needle-like structures for \
                 the needle while that is out of the plane; templates do not. Both on the same pictures of the lateral sequences with \
                 a misalignment or an inhomogeneous phantom: the template tracker as it steered, the earlier method beside it, without a \
                 word in the steering."
                    .into(),
            ),
            Block::Table(Table { columns, rows }),
            Block::Text(format!(
                "Measured over all of these: tip RMSE {b_mm:.2} mm by the earlier method, {t_mm:.2} mm by templates; while the tip \
                 is out of the plane the earlier method says in {b_absent:.0} % of the images where it is, the template tracker in \
                 {t_absent:.0} %. {}",
                if holds {
                    "The claim holds here."
                } else {
                    "The claim does not hold here in every respect."
                }
            )),
            Block::Note(
                "Out of plane: images with the tip farther from the plane than half the −6 dB slice thickness, or without contact; the first images of a \
                 loss, until it is declared, count against both. The shaft is often still seen then."
                    .into(),
            ),
        ],
    )
}

fn row(name: &str, medium: &str, comparison: &Comparison, spacing_m: f64) -> Row {
    let number =
        |claims: &Claims| claims.rmse_mm(spacing_m).map_or("–".to_owned(), |mm| format!("{mm:.2}"));
    let share = |part: usize, of: usize| {
        if of == 0 { "–".to_owned() } else { format!("{:.0} %", 100.0 * part as f64 / of as f64) }
    };
    let Comparison { baseline: b, template: t } = comparison;
    Row::new([
        name.to_owned(),
        medium.to_owned(),
        number(b),
        number(t),
        share(b.wrong, b.claimed),
        share(t.wrong, t.claimed),
        b.absent.to_string(),
        share(b.false_detections, b.absent),
        share(t.false_detections, t.absent),
    ])
}
