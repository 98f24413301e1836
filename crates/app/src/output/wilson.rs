/// 97.5th percentile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// Wilson's 95 % score interval of a success rate (Wilson 1927; Newcombe 1998, method 3, without
/// continuity correction). (0, 1) for no runs; more successes than runs count as all.
pub fn wilson(successes: u64, runs: u64) -> (f64, f64) {
    if runs == 0 {
        return (0.0, 1.0);
    }
    let n = runs as f64;
    let p = successes.min(runs) as f64 / n;
    let z2 = Z * Z;
    let centre = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = Z * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt() / (1.0 + z2 / n);
    ((centre - half).max(0.0), (centre + half).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Newcombe, Statistics in Medicine 17 (1998) 857–872, table I, method 3.
    #[test]
    fn truth_intervals_agree_with_newcombe_1998() {
        let published = [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0000, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ];
        for (successes, runs, low, high) in published {
            let (found_low, found_high) = wilson(successes, runs);
            assert!((found_low - low).abs() <= 5.1e-5, "{successes}/{runs}: {found_low}");
            assert!((found_high - high).abs() <= 5.1e-5, "{successes}/{runs}: {found_high}");
        }
    }

    #[test]
    fn interval_is_symmetric_and_stays_within_one() {
        let (low, high) = wilson(10, 10);
        let (mirror_low, mirror_high) = wilson(0, 10);
        assert!((low - (1.0 - mirror_high)).abs() < 1e-12, "{low} {mirror_high}");
        assert!((high - (1.0 - mirror_low)).abs() < 1e-12 && high <= 1.0 && mirror_low >= 0.0);
        assert_eq!(wilson(0, 0), (0.0, 1.0));
        assert_eq!(wilson(11, 10), wilson(10, 10));
    }
}
