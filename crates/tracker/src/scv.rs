//! The adapted template of the sum of conditional variances, paper (9)–(11).

use crate::region::Inside;
use crate::template::{plain_row, window_row};

/// Most bins a setting may ask for.
const MAX_BINS: usize = 256;

/// Scratch of the conditional means.
#[derive(Debug, Clone)]
pub(crate) struct Conditional {
    bins: usize,
    weight: [f64; MAX_BINS],
    template: [f64; MAX_BINS],
    image: [f64; MAX_BINS],
}

impl Conditional {
    pub fn new(bins: u32) -> Self {
        Self {
            bins: bins as usize,
            weight: [0.0; MAX_BINS],
            template: [0.0; MAX_BINS],
            image: [0.0; MAX_BINS],
        }
    }

    /// T̂ = E[P | T]: what the template's grey levels have become in the image's patch `image`.
    ///
    /// The mean of P is taken over each bin of T under the window's weights. Between the bins' mean grey levels T̂
    /// is interpolated, so that it is as smooth as T and its gradient is one: a staircase would leave half a bin
    /// of quantisation in every residual. A bin that holds less than its share of the weight is merged with its
    /// neighbour, since the mean of two or three pixels would just copy the image.
    pub fn adapt(
        &mut self,
        weights: &[f32],
        side: usize,
        inside: Inside,
        template: &[f32],
        image: &[f32],
        adapted: &mut [f32],
    ) {
        let (low, high) = template.iter().fold((f32::MAX, f32::MIN), |(l, h), g| (l.min(*g), h.max(*g)));
        let per_grey = self.bins as f32 / (high - low).max(1e-3);
        for sums in [&mut self.weight, &mut self.template, &mut self.image] {
            sums[..self.bins].fill(0.0);
        }
        for y in inside.y[0]..inside.y[1] {
            let patches =
                window_row(template, side, y, inside).iter().zip(window_row(image, side, y, inside));
            for (weight, (t, p)) in plain_row(weights, side, y, inside).iter().zip(patches) {
                let bin = (((t - low) * per_grey) as usize).min(self.bins - 1);
                self.weight[bin] += f64::from(*weight);
                self.template[bin] += f64::from(weight * t);
                self.image[bin] += f64::from(weight * p);
            }
        }
        let knots = self.merge();
        for (out, t) in adapted.iter_mut().zip(template) {
            *out = self.interpolate(knots, *t);
        }
    }

    /// Merges poor bins, turns sums into means, returns the number of bins left (at least one).
    fn merge(&mut self) -> usize {
        let total: f64 = self.weight[..self.bins].iter().sum();
        let enough = 0.5 * total / self.bins as f64;
        let mut knots = 0;
        let [mut weight, mut template, mut image] = [0.0; 3];
        for bin in 0..self.bins {
            weight += self.weight[bin];
            template += self.template[bin];
            image += self.image[bin];
            if weight >= enough {
                (self.weight[knots], self.template[knots], self.image[knots]) = (weight, template, image);
                knots += 1;
                [weight, template, image] = [0.0; 3];
            }
        }
        if knots == 0 {
            knots = 1;
            (self.weight[0], self.template[0], self.image[0]) = (weight, template, image);
        } else {
            // What is left at the bright end joins the last rich bin.
            self.weight[knots - 1] += weight;
            self.template[knots - 1] += template;
            self.image[knots - 1] += image;
        }
        for knot in 0..knots {
            let weight = self.weight[knot].max(1e-12);
            self.template[knot] /= weight;
            self.image[knot] /= weight;
        }
        knots
    }

    fn interpolate(&self, knots: usize, grey: f32) -> f32 {
        if knots == 1 {
            return self.image[0] as f32;
        }
        let grey = f64::from(grey);
        let inner = &self.template[1..knots - 1];
        let left = inner.iter().take_while(|knot| **knot <= grey).count();
        let span = self.template[left + 1] - self.template[left];
        let slope = if span > 1e-9 { (self.image[left + 1] - self.image[left]) / span } else { 0.0 };
        // Beyond the outer bins' means the line goes on.
        (self.image[left] + slope * (grey - self.template[left])) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::window_weights;

    #[test]
    fn truth_a_linear_grey_change_is_absorbed_whole() {
        let side = 20;
        let template: Vec<f32> = (0..22 * 22).map(|k| ((k * 37) % 200) as f32).collect();
        let image: Vec<f32> = template.iter().map(|t| 230.0 - 0.6 * t).collect();
        let mut adapted = vec![0.0; template.len()];
        Conditional::new(16).adapt(
            &window_weights(side, 3.0),
            side,
            Inside::all(side),
            &template,
            &image,
            &mut adapted,
        );
        for (a, i) in adapted.iter().zip(&image) {
            assert!((a - i).abs() < 1e-2, "{a} {i}");
        }
    }

    #[test]
    fn a_flat_template_gives_the_mean_of_the_image() {
        let side = 8;
        let image: Vec<f32> = (0..100).map(|k| (k % 7) as f32).collect();
        let mut adapted = vec![0.0; 100];
        let mut conditional = Conditional::new(16);
        conditional.adapt(
            &window_weights(side, 0.0),
            side,
            Inside::all(side),
            &[5.0; 100],
            &image,
            &mut adapted,
        );
        assert!(adapted.iter().all(|a| (a - adapted[0]).abs() < 1e-6 && *a > 2.0 && *a < 4.0));
    }
}
