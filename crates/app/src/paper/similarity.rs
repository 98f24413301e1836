//! Fig. 1: how SSD, SCV and NCC of a template change as it is shifted over the picture that it was cut from, with the needle
//! as it is and with the needle's pixels dimmed nearly to the background.

use sonoloop_types::Image;

/// Side of the template, as in the paper.
pub const SIDE_PX: usize = 61;
/// Farthest shift in each direction, as in the paper.
pub const REACH_PX: i32 = 20;
/// Grey-level bins of the SCV on 61×61 pixels.
const BINS: usize = 32;
/// Spreads over the background's median from which on a pixel is the needle's.
const NEEDLE_FROM: f64 = 3.0;
/// What the dimmed needle keeps of its contrast over the background.
const DIMMED_TO: f64 = 0.1;

/// A measure of likeness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Sum of squared differences, paper (2); least where most alike.
    Ssd,
    /// Sum of conditional variances, paper (11); least where most alike.
    Scv,
    /// Normalised cross-correlation; largest where most alike.
    Ncc,
}

impl Measure {
    /// All three, in the paper's order.
    pub const ALL: [Self; 3] = [Self::Ssd, Self::Scv, Self::Ncc];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ssd => "SSD",
            Self::Scv => "SCV",
            Self::Ncc => "NCC",
        }
    }

    fn of(self, template: &[f64], patch: &[f64]) -> f64 {
        match self {
            Self::Ssd => squares(template, patch),
            Self::Scv => squares(&adapted(template, patch), patch),
            Self::Ncc => ncc(template, patch),
        }
    }
}

/// A measure at every shift: rows of v from −[`REACH_PX`], in them u likewise.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Which measure.
    pub measure: Measure,
    /// One value per shift.
    pub values: Vec<f64>,
}

/// Shifts along one axis.
pub const SHIFTS: usize = 2 * REACH_PX as usize + 1;

impl Surface {
    /// The shift (u, v) at which the measure says "most alike", and the distance from no shift, in pixels.
    pub fn extremum_px(&self) -> ([i32; 2], f64) {
        let sign = if self.measure == Measure::Ncc { -1.0 } else { 1.0 };
        // Of equal ones the nearest to no shift.
        let key = |index: &usize| (sign * self.values[*index], distance(shift(*index)));
        let best = (0..self.values.len())
            .min_by(|a, b| key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)))
            .unwrap_or(0);
        (shift(best), distance(shift(best)))
    }
}

/// The shift that a value of a surface belongs to.
pub fn shift(index: usize) -> [i32; 2] {
    [index % SHIFTS, index / SHIFTS].map(|k| k as i32 - REACH_PX)
}

fn distance([u, v]: [i32; 2]) -> f64 {
    f64::from(u).hypot(f64::from(v))
}

/// Template and surfaces of one picture.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Grey levels of the template, row by row.
    pub template: Vec<f64>,
    /// SSD, SCV and NCC.
    pub surfaces: [Surface; 3],
}

/// The template around `tip_px` as it is, and dimmed; `None` where template and shifts do not fit into the picture.
pub fn figures(image: &Image, tip_px: [f64; 2]) -> Option<[Figure; 2]> {
    let [u, v] = tip_px.map(|x| x.round() as i32);
    let template = patch(image, [u, v])?;
    patch(image, [u - REACH_PX, v - REACH_PX])?;
    patch(image, [u + REACH_PX, v + REACH_PX])?;
    let figure = |template: Vec<f64>| {
        let at = |index: usize| {
            let [du, dv] = shift(index);
            patch(image, [u + du, v + dv]).expect("both corners fit")
        };
        let patches: Vec<_> = (0..SHIFTS * SHIFTS).map(at).collect();
        let surfaces = Measure::ALL.map(|measure| Surface {
            measure,
            values: patches.iter().map(|patch| measure.of(&template, patch)).collect(),
        });
        Figure { template, surfaces }
    };
    Some([figure(template.clone()), figure(dimmed(&template))])
}

/// The needle's pixels at a tenth of their contrast over the background: those that stand out from its median by more than
/// three times the spread below the median, where there is no needle.
fn dimmed(template: &[f64]) -> Vec<f64> {
    let mut sorted = template.to_vec();
    sorted.sort_by(f64::total_cmp);
    let darker = &sorted[..=sorted.len() / 2];
    let median = darker[darker.len() - 1];
    let spread =
        (darker.iter().map(|level| (median - level).powi(2)).sum::<f64>() / darker.len() as f64).sqrt();
    let threshold = median + NEEDLE_FROM * spread;
    let dim = |level: &f64| {
        if *level > threshold { median + DIMMED_TO * (level - median) } else { *level }
    };
    template.iter().map(dim).collect()
}

fn patch(image: &Image, [u, v]: [i32; 2]) -> Option<Vec<f64>> {
    let half = SIDE_PX as i32 / 2;
    let (width, height) = (image.width_px as i32, image.height_px as i32);
    if u < half || v < half || u + half >= width || v + half >= height {
        return None;
    }
    let rows = (v - half..=v + half)
        .flat_map(|row| (u - half..=u + half).map(move |column| (row * width + column) as usize));
    Some(rows.map(|index| f64::from(image.pixels[index])).collect())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn squares(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// T̂(x) = E[I | T(x)], paper (9) and (10), over bins of the template's grey levels.
fn adapted(template: &[f64], patch: &[f64]) -> Vec<f64> {
    let low = template.iter().copied().fold(f64::MAX, f64::min);
    let high = template.iter().copied().fold(f64::MIN, f64::max);
    let bin = |level: f64| (((level - low) / (high - low).max(1e-9) * BINS as f64) as usize).min(BINS - 1);
    let mut sums = [(0.0, 0.0); BINS];
    for (t, i) in template.iter().zip(patch) {
        let (count, sum) = &mut sums[bin(*t)];
        *count += 1.0;
        *sum += i;
    }
    template.iter().map(|t| sums[bin(*t)]).map(|(count, sum)| sum / count).collect()
}

fn ncc(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let [mut ab, mut aa, mut bb] = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::ImageStore;
    use crate::scenarios::prepare;

    /// First picture of a sequence, and the tip in it.
    fn first(name: &str) -> (Image, [f64; 2]) {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../scenarios/paper/{name}.yaml"));
        // Deep enough for template and shifts.
        let set = ["insertion.start_depth_mm=30".to_owned(), "images=1".to_owned()];
        let (scenario, session) = prepare(&file, None, &set).unwrap();
        let mut peer = crate::peer::InProcess::new(crate::controller::ControllerKind::Tracker, false);
        let pixels = Some(ImageStore::new().unwrap());
        let (recording, error) = session.run(1, &mut peer, &mut crate::session::Nobody, pixels);
        assert!(error.is_none() && scenario.images == Some(1));
        (recording.pixels.unwrap().get(0).unwrap(), recording.images[0].truth.reference_px)
    }

    #[test]
    fn in_water_a_dimmed_needle_moves_the_least_ssd_and_neither_scv_nor_ncc() {
        let (image, tip_px) = first("lateral_14");
        let [whole, dimmed] = figures(&image, tip_px).unwrap();
        for surface in &whole.surfaces {
            assert_eq!(surface.extremum_px().0, [0, 0], "{:?}", surface.measure);
        }
        let [ssd, scv, ncc] = dimmed.surfaces.each_ref().map(Surface::extremum_px);
        // Half the template's side is far beyond what a registration comes back from.
        assert!(ssd.1 > 10.0, "{ssd:?}");
        assert_eq!((scv.0, ncc.0), ([0, 0], [0, 0]));
    }

    #[test]
    fn truth_scv_forgives_any_map_of_grey_levels_and_ncc_a_straight_one() {
        let template: Vec<f64> = (0..3721).map(|k| f64::from((k * 37) % 8)).collect();
        let mapped: Vec<f64> = template.iter().map(|t| (t - 3.0).powi(2)).collect();
        let straight: Vec<f64> = template.iter().map(|t| 20.0 + 5.0 * t).collect();
        assert!(Measure::Scv.of(&template, &mapped) < 1e-9);
        assert!(Measure::Ssd.of(&template, &mapped) > 1000.0);
        assert!((Measure::Ncc.of(&template, &straight) - 1.0).abs() < 1e-12);
        assert!(
            (Measure::Ncc.of(&template, &template.iter().map(|t| -t).collect::<Vec<_>>()) + 1.0).abs()
                < 1e-12
        );
    }
}
