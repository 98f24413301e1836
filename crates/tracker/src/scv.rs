//! The adapted template of the sum of conditional variances, paper (9)–(11).

use sonoloop_simd::{Instructions, nearest_f32, wide};

use crate::window::{LANES, Part, Window};

/// Most bins a setting may ask for.
const MAX_BINS: usize = 256;
/// Neighbouring pixels often fall into one bin; they are counted in turns in as many tables, so that none waits for another.
const TABLES: usize = 4;

/// Weight, weighted grey level of T and of P; the fourth is there to make a vector of it.
type Bin = [f32; 4];

/// Scratch of the conditional means.
#[derive(Debug, Clone)]
pub(crate) struct Conditional {
    bins: usize,
    /// Bin of each of the template's pixels, padded.
    bin_of: Vec<u8>,
    tables: [[Bin; MAX_BINS]; TABLES],
    /// Which knot a bin went into.
    knot_of: [u8; MAX_BINS],
    /// Mean grey level of T at each knot.
    knots: [f32; MAX_BINS],
    /// T̂ between a knot and the next: level at T = 0, and slope.
    lines: [[f32; 2]; MAX_BINS],
}

impl Conditional {
    pub fn new(bins: u32, window: Window) -> Self {
        Self {
            bins: bins as usize,
            bin_of: vec![0; window.padded_len()],
            tables: [[[0.0; 4]; MAX_BINS]; TABLES],
            knot_of: [0; MAX_BINS],
            knots: [0.0; MAX_BINS],
            lines: [[0.0; 2]; MAX_BINS],
        }
    }

    /// T̂ = E[P | T]: what the template's grey levels have become in the image's patch `image`.
    ///
    /// The mean of P is taken over each bin of T under the window's weights. Between the bins' mean grey levels T̂
    /// is interpolated, so that it is as smooth as T and its gradient is one: a staircase would leave half a bin
    /// of quantisation in every residual. A bin that holds less than its share of the weight is merged with its
    /// neighbour, since the mean of two or three pixels would just copy the image.
    #[expect(clippy::too_many_arguments, reason = "plain buffers")]
    pub fn adapt(
        &mut self,
        instructions: Instructions,
        weights: &[f32],
        window: Window,
        part: Part,
        template: &[f32],
        image: &[f32],
        adapted: &mut [f32],
    ) {
        let row = |y: usize| {
            let start = y * window.padded_stride();
            start + part.first..start + part.end + 2
        };
        let rows = part.first..part.end + 2;
        let ends = rows.clone().map(|y| range(instructions, &template[row(y)]));
        let [low, high] = ends.fold([f32::MAX, f32::MIN], |[l, h], [low, high]| [l.min(low), h.max(high)]);
        let per_grey = self.bins as f32 / (high - low).max(1e-3);
        for y in rows.clone() {
            let last = (self.bins - 1) as f32;
            bins(instructions, &template[row(y)], low, per_grey, last, &mut self.bin_of[row(y)]);
        }
        for table in &mut self.tables {
            table[..self.bins].fill([0.0; 4]);
        }
        for y in part.first..part.end {
            let weights = &weights[y * window.stride()..][part.first..part.end];
            let padded = row(y + 1);
            let inner = padded.start + 1..padded.end - 1;
            let (bins, template, image) =
                (&self.bin_of[inner.clone()], &template[inner.clone()], &image[inner]);
            let pixels = weights.iter().zip(bins).zip(template).zip(image);
            for (k, (((weight, bin), t), p)) in pixels.enumerate() {
                let bin = &mut self.tables[k % TABLES][usize::from(*bin)];
                for (sum, term) in bin.iter_mut().zip([*weight, weight * t, weight * p, 0.0]) {
                    *sum += term;
                }
            }
        }
        let knots = self.join();
        for y in rows {
            let levels = template[row(y)].iter().zip(&self.bin_of[row(y)]);
            for (out, (t, bin)) in adapted[row(y)].iter_mut().zip(levels) {
                let knot = usize::from(self.knot_of[usize::from(*bin)]);
                // Left of its knot a grey level belongs to the line before; beyond the outer knots the lines go on.
                let left = knot - usize::from(*t < self.knots[knot] && knot > 0);
                let [level, slope] = self.lines[left.min(knots.saturating_sub(2))];
                *out = level + slope * t;
            }
        }
    }

    /// Merges poor bins into knots and draws the lines between these; returns their number (at least one).
    fn join(&mut self) -> usize {
        let [first, others @ ..] = &mut self.tables;
        for table in others {
            for (bin, more) in first[..self.bins].iter_mut().zip(table) {
                for (sum, term) in bin.iter_mut().zip(more) {
                    *sum += *term;
                }
            }
        }
        let bins = &first[..self.bins];
        let total: f32 = bins.iter().map(|[weight, ..]| weight).sum();
        let enough = 0.5 * total / self.bins as f32;
        // Sums of each knot, over the bins' own places: there are never more knots than bins looked at.
        let mut sums = [[0.0_f32; 3]; MAX_BINS];
        let mut knots = 0;
        for (bin, [weight, template, image, _]) in bins.iter().enumerate() {
            for (sum, term) in sums[knots].iter_mut().zip([weight, template, image]) {
                *sum += term;
            }
            self.knot_of[bin] = knots as u8;
            if sums[knots][0] >= enough && sums[knots][0] > 0.0 {
                knots += 1;
            }
        }
        if knots == 0 {
            knots = 1;
        } else if knots < self.bins {
            // What is left at the bright end joins the last rich bin.
            let rest = sums[knots];
            for (sum, term) in sums[knots - 1].iter_mut().zip(rest) {
                *sum += term;
            }
        }
        let last = (knots - 1) as u8;
        self.knot_of[..self.bins].iter_mut().for_each(|knot| *knot = (*knot).min(last));
        let mean = |[weight, template, image]: [f32; 3]| {
            let weight = weight.max(1e-12);
            [template / weight, image / weight]
        };
        for (knot, sums) in self.knots.iter_mut().zip(&sums[..knots]) {
            *knot = mean(*sums)[0];
        }
        self.lines[0] = [mean(sums[0])[1], 0.0];
        for (line, pair) in self.lines.iter_mut().zip(sums[..knots].windows(2)) {
            let [[t, p], [next_t, next_p]] = [mean(pair[0]), mean(pair[1])];
            let slope = if next_t - t > 1e-6 { (next_p - p) / (next_t - t) } else { 0.0 };
            *line = [p - slope * t, slope];
        }
        knots
    }
}

wide! {
    /// The lowest and the highest of some grey levels.
    fn range(levels: &[f32]) -> [f32; 2] {
        let lower = |a: f32, b: f32| if b < a { b } else { a };
        let higher = |a: f32, b: f32| if b > a { b } else { a };
        let (vectors, rest) = levels.as_chunks::<LANES>();
        let [mut low, mut high] = [[f32::MAX; LANES], [f32::MIN; LANES]];
        for vector in vectors {
            for k in 0..LANES {
                low[k] = lower(low[k], vector[k]);
                high[k] = higher(high[k], vector[k]);
            }
        }
        let all = |lanes: [f32; LANES], pick: fn(f32, f32) -> f32| {
            lanes.into_iter().chain(rest.iter().copied()).reduce(pick).unwrap_or_default()
        };
        [all(low, lower), all(high, higher)]
    }
}

wide! {
    /// The bins that grey levels fall into; none is below `low`.
    fn bins(levels: &[f32], low: f32, per_grey: f32, last: f32, bins: &mut [u8]) {
        for (bin, level) in bins.iter_mut().zip(levels) {
            let place = (level - low) * per_grey - 0.5;
            let place = if place > 0.0 { place } else { 0.0 };
            let place = if place < last { place } else { last };
            *bin = nearest_f32(place) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::Weights;
    use crate::template::Template;

    fn adapted(side: usize, sigma_px: f64, template: &[f32], image: &[f32]) -> Vec<f32> {
        let weights = Weights::new(side, sigma_px);
        let [template, image] = [template, image].map(|p| Template::from_pixels(side, p, None).padded);
        let mut adapted = vec![0.0; template.len()];
        let (window, part) = (weights.window, weights.part);
        Conditional::new(16, window).adapt(
            Instructions::widest(),
            weights.values(),
            window,
            part,
            &template,
            &image,
            &mut adapted,
        );
        window.pixels(&adapted).collect()
    }

    #[test]
    fn truth_a_linear_grey_change_is_absorbed_whole() {
        let template: Vec<f32> = (0..22 * 22).map(|k| ((k * 37) % 200) as f32).collect();
        let image: Vec<f32> = template.iter().map(|t| 230.0 - 0.6 * t).collect();
        for sigma_px in [0.0, 3.0] {
            for (a, i) in adapted(20, sigma_px, &template, &image).iter().zip(&image) {
                assert!((a - i).abs() < 1e-2, "{a} {i}");
            }
        }
    }

    #[test]
    fn truth_two_grey_levels_become_their_means() {
        // 10 where the template is dark, 90 where it is bright, and noise about both that averages out.
        let template: Vec<f32> = (0..22 * 22).map(|k| if k % 3 == 0 { 200.0 } else { 50.0 }).collect();
        let noise = |k: usize| [4.0, -4.0][k / 3 % 2];
        let image: Vec<f32> = template
            .iter()
            .enumerate()
            .map(|(k, t)| if *t > 100.0 { 90.0 } else { 10.0 } + noise(k))
            .collect();
        let inner = |k: usize| (1..21).contains(&(k % 22)) && (1..21).contains(&(k / 22));
        let mean = |bright: bool| {
            let of = |k: &usize| inner(*k) && (template[*k] > 100.0) == bright;
            let (sum, count) = (0..22 * 22).filter(of).fold((0.0, 0.0), |(s, n), k| (s + image[k], n + 1.0));
            sum / count
        };
        for (a, t) in adapted(20, 0.0, &template, &image).iter().zip(&template) {
            assert!((a - mean(*t > 100.0)).abs() < 1e-2, "{a}");
        }
    }

    #[test]
    fn a_flat_template_gives_the_mean_of_the_image() {
        let image: Vec<f32> = (0..100).map(|k| (k % 7) as f32).collect();
        let adapted = adapted(8, 0.0, &[5.0; 100], &image);
        assert!(adapted.iter().all(|a| (a - adapted[0]).abs() < 1e-6 && *a > 2.0 && *a < 4.0));
    }
}
