//! Automatic threshold of the filter's responses.
//!
//! Otsu's threshold parts two classes of similar size well, but a needle fills about one per cent of a picture, and
//! then it lands inside the speckle. So the larger of Otsu's and mean + 3 standard deviations is taken. The latter
//! also bounds what can pass: by Cantelli's inequality no distribution has more than 1/(1 + 3²) = 10 % of its values
//! beyond it, whatever the picture shows.

/// Bins between zero and the largest response.
const BINS: usize = 256;
/// Standard deviations above the mean.
const DEVIATIONS: f64 = 3.0;
/// Largest responses below this many grey levels are rounding of the picture, not ridges.
const LEAST_RESPONSE: f32 = 4.0;

/// The response above which a pixel counts as needle; `None` when there is no ridge at all.
pub(crate) fn threshold<'a>(responses: impl Iterator<Item = &'a f32> + Clone) -> Option<f32> {
    let positive = responses.filter(|r| **r > 0.0);
    let (mut count, mut sum, mut squares, mut largest) = (0_u32, 0.0_f64, 0.0_f64, 0.0_f32);
    for response in positive.clone() {
        count += 1;
        sum += f64::from(*response);
        squares += f64::from(*response) * f64::from(*response);
        largest = largest.max(*response);
    }
    if largest < LEAST_RESPONSE {
        return None;
    }
    let mut histogram = [0_u32; BINS];
    let bins_per_level = BINS as f32 / largest;
    for response in positive {
        histogram[((response * bins_per_level) as usize).min(BINS - 1)] += 1;
    }
    let parted = otsu(&histogram) as f32 / bins_per_level;
    let mean = sum / f64::from(count);
    let deviation = (squares / f64::from(count) - mean * mean).max(0.0).sqrt();
    Some(parted.max((mean + DEVIATIONS * deviation) as f32))
}

/// First bin of the upper class: the split that maximises the variance between the classes (Otsu 1979, eq. 18).
fn otsu(histogram: &[u32]) -> usize {
    let moment = |(bin, count): (usize, &u32)| bin as f64 * f64::from(*count);
    let total: f64 = histogram.iter().map(|count| f64::from(*count)).sum();
    let whole: f64 = histogram.iter().enumerate().map(moment).sum();
    let (mut below, mut sum, mut best, mut split) = (0.0, 0.0, 0.0, 0);
    for (bin, count) in histogram.iter().enumerate() {
        below += f64::from(*count);
        sum += moment((bin, count));
        let above = total - below;
        if below > 0.0 && above > 0.0 {
            let apart = sum / below - (whole - sum) / above;
            let between = below * above * apart * apart;
            if between > best {
                (best, split) = (between, bin + 1);
            }
        }
    }
    split
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn truth_otsu_on_a_histogram_computed_by_hand() {
        // Splits after bins 0, 1, 2, 3 and 4 give n0·n1·(μ0 − μ1)² of
        // 4·12·(0 − 3.5)² = 588, 8·8·(0.5 − 4.75)² = 1156, 10·6·(0.8 − 5.667)² = 1421, twice the same (empty bins),
        // and after bin 5 12·4·(1.5 − 6)² = 972: the best, and the first of equals, is after bin 2.
        let histogram = [4, 4, 2, 0, 0, 2, 4];
        assert_eq!(otsu(&histogram), 3);
        assert_eq!(otsu(&[0, 9, 0]), 0, "one class cannot be parted");
    }

    #[test]
    fn noise_passes_in_a_bounded_share_and_a_constant_not_at_all() {
        assert_eq!(threshold([0.0_f32; 50].iter()), None);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let noise: Vec<f32> = (0..10_000).map(|_| rng.random_range(-1.0_f32..1.0).powi(5) * 100.0).collect();
        let limit = threshold(noise.iter()).unwrap();
        let share = noise.iter().filter(|r| **r > limit).count() as f64 / noise.len() as f64;
        assert!(share <= 0.1, "{share}");
    }

    #[test]
    fn a_rare_class_stands_out() {
        let responses: Vec<f32> =
            (0..2000).map(|k| if k % 100 == 0 { 90.0 } else { 1.0 + (k % 13) as f32 }).collect();
        let limit = threshold(responses.iter()).unwrap();
        assert!(limit > 13.0 && limit < 90.0, "{limit}");
    }
}
