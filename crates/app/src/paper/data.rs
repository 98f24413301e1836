//! The report's data as CSV.

use super::figures::profile_text;
use super::similarity::shift;
use super::studies::MapTrial;
use super::updates::STRATEGIES;
use super::{Looked, Results};
use crate::output::{images_csv, snake};

/// Every file: its name and its text.
pub(super) fn files(results: &Results) -> Vec<(String, String)> {
    let mut files = vec![("sequences.csv".to_owned(), sequences(results))];
    for Looked { sequence, .. } in &results.sequences {
        let text = images_csv(&sequence.rows, &sequence.scenario.probe);
        files.push((format!("images_{}.csv", sequence.name()), text));
    }
    let surfaces = results.sequences.iter().filter_map(surfaces).collect::<String>();
    files.push(with_head(
        "fig1_surfaces.csv",
        "sequence,template,measure,shift_u_px,shift_v_px,value",
        &surfaces,
    ));
    files.push(with_head(
        "fig2_updates.csv",
        "sequence,configuration,strategy,image,tip_u_px,tip_v_px,error_px",
        &results.sequences.iter().filter_map(updates).collect::<String>(),
    ));
    files.push(with_head(
        "fig6_ncc.csv",
        "sequence,image,state,ncc_previous,ncc_anchor,paper_ncc_previous,mark",
        &results.sequences.iter().filter_map(ncc).collect::<String>(),
    ));
    files.push(with_head(
        "table1_timing.csv",
        "template_px,similarity,order,images,mean_us,sigma_us,iterations",
        &timing(results),
    ));
    files.push(with_head(
        "earlier_methods.csv",
        "sequence,method,visible,claimed,wrong,tip_rmse_mm,out_of_plane,false_detections",
        &results.sequences.iter().filter_map(earlier).collect::<String>(),
    ));
    if let Some(studies) = &results.studies {
        let trials = studies.trials.iter().map(|t| {
            let m = &t.metrics;
            let [rmse, coverage, silent] = [m.tip_rmse_mm, m.coverage, m.silent_loss_s].map(number);
            format!(
                "{},{},{},{},{rmse},{coverage},{},{},{silent}\n",
                t.name, t.profile, t.seed, t.passed, m.losses, m.false_recoveries
            )
        });
        files.push(with_head(
            "study_seeds.csv",
            "sequence,profile,seed,passed,tip_rmse_mm,coverage,losses,false_recoveries,silent_loss_s",
            &trials.collect::<String>(),
        ));
        files.push(with_head(
            "study_maps.csv",
            "map,profile,fainter_db,rate_hz,delay_ms,seed,passed,tip_rmse_mm,coverage,silent_loss_s",
            &(map("motion", &studies.by_motion) + &map("delay", &studies.by_delay)),
        ));
    }
    files
}

fn with_head(name: &str, head: &str, rows: &str) -> (String, String) {
    (name.to_owned(), format!("{head}\n{rows}"))
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.4}"))
}

fn sequences(results: &Results) -> String {
    let head = "sequence,view,medium,needle,insertion,images,losses_declared,recoveries,false_recoveries,tip_rmse_mm,tip_p95_px,\
                coverage,final_target_distance_mm,ends_tracking,passed\n";
    let rows = results.sequences.iter().map(|Looked { sequence, .. }| {
        let (scenario, m) = (&sequence.scenario, &sequence.metrics);
        format!(
            "{},{},\"{}\",\"{}\",{},{},{},{},{},{},{},{},{},{},{}\n",
            scenario.name,
            sequence.view_text(),
            scenario.phantom.name,
            scenario.needle.name,
            sequence.insertion_text(),
            m.images,
            sequence.lost_stretches().len(),
            m.recoveries,
            m.false_recoveries,
            number(m.tip_rmse_mm),
            number(m.tip_p95_px),
            number(m.coverage),
            number(m.final_target_distance_mm),
            sequence.ends_tracking(),
            sequence.passed()
        )
    });
    head.to_owned() + &rows.collect::<String>()
}

fn surfaces(looked: &Looked) -> Option<String> {
    let figures = looked.surfaces.as_ref()?;
    let mut text = String::new();
    for (template, figure) in ["whole", "dimmed"].iter().zip(figures) {
        for surface in &figure.surfaces {
            for (index, value) in surface.values.iter().enumerate() {
                let ([u, v], measure) = (shift(index), surface.measure.name());
                text += &format!("{},{template},{measure},{u},{v},{value:.6}\n", looked.sequence.name());
            }
        }
    }
    Some(text)
}

fn updates(looked: &Looked) -> Option<String> {
    let (both, _) = looked.updates.as_ref()?;
    let mut text = String::new();
    for strategies in both {
        let profile = profile_text(strategies.profile);
        for (k, (_, strategy)) in STRATEGIES.iter().enumerate() {
            for (image, ([u, v], error)) in
                strategies.tips_px[k].iter().zip(&strategies.errors_px[k]).enumerate()
            {
                let name = looked.sequence.name();
                text += &format!("{name},{profile},{strategy},{image},{u:.3},{v:.3},{}\n", number(*error));
            }
        }
    }
    Some(text)
}

fn ncc(looked: &Looked) -> Option<String> {
    let (loss, _) = looked.loss.as_ref()?;
    let lines = looked.sequence.rows.iter().zip(&loss.paper_ncc).enumerate().map(|(image, (row, paper))| {
        let estimate = row.command.map(|command| command.estimate);
        let mark = loss.marks.iter().position(|mark| *mark == image).map_or("", |k| ["a", "b", "c", "d"][k]);
        format!(
            "{},{image},{},{},{},{},{mark}\n",
            looked.sequence.name(),
            row.state().map_or_else(String::new, |state| snake(&state)),
            number(estimate.and_then(|estimate| estimate.ncc_previous)),
            number(estimate.and_then(|estimate| estimate.ncc_anchor)),
            number(*paper)
        )
    });
    Some(lines.collect())
}

fn timing(results: &Results) -> String {
    let lines = results.timing.iter().map(|cell| {
        let (similarity, order) = (snake(&cell.similarity), snake(&cell.order));
        let super::timing::Cell { template_px, images, mean_us, sigma_us, iterations, .. } = cell;
        format!("{template_px},{similarity},{order},{images},{mean_us:.2},{sigma_us:.2},{iterations:.2}\n")
    });
    lines.collect()
}

fn earlier(looked: &Looked) -> Option<String> {
    let comparison = looked.comparison.as_ref()?;
    let spacing_m = looked.sequence.scenario.probe.geometry.spacing_m;
    let lines = [("earlier", &comparison.baseline), ("template", &comparison.template)].map(|(method, c)| {
        let rmse = number(c.rmse_mm(spacing_m));
        format!(
            "{},{method},{},{},{},{rmse},{},{}\n",
            looked.sequence.name(),
            c.visible,
            c.claimed,
            c.wrong,
            c.absent,
            c.false_detections
        )
    });
    Some(lines.concat())
}

fn map(name: &str, trials: &[MapTrial]) -> String {
    let lines = trials.iter().map(|t| {
        let [rmse, coverage, silent] =
            [t.metrics.tip_rmse_mm, t.metrics.coverage, t.metrics.silent_loss_s].map(number);
        format!(
            "{name},{},{},{},{},{},{},{rmse},{coverage},{silent}\n",
            t.profile, t.fainter_db, t.rate_hz, t.delay_ms, t.seed, t.passed
        )
    });
    lines.collect()
}
