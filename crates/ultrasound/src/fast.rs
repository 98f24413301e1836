//! Exponential, logarithm and rounding of plain products and sums: loops over them vectorise, and every CPU gives the same bits.

/// exp(−x) for 0 ≤ x ≤ 8.5 to 1e-4 of its value, and 2e-4 beyond: a polynomial of x/16 (least maximum error, fitted),
/// four times squared. Plain products and sums, so loops over it vectorise and every CPU gives the same bits.
#[inline(always)]
pub fn exp_minus(x: f32) -> f32 {
    // A comparison, as `min` also looks for what is no number.
    let y = if x < 8.5 { x } else { 8.5 } * (1.0 / 16.0);
    let root = 1.0 - y * (0.999_957_26 - y * (0.499_250_6 - y * (0.162_470_66 - y * 0.032_081_59)));
    let squared = root * root;
    let fourth = squared * squared;
    let eighth = fourth * fourth;
    eighth * eighth
}

/// ln of a value over [`power_db`] of it.
pub const NEPER_PER_POWER_DB: f32 = core::f32::consts::LN_10 / 10.0;

/// 10·log10 of a power to 2e-4 dB: exponent bits, and a polynomial for the logarithm
/// of the mantissa (least maximum error, fitted) that is exact at both its ends. The floor of −300 dB keeps zero finite.
#[inline(always)]
pub fn power_db(power: f32) -> f32 {
    const DB_PER_OCTAVE: f32 = 3.010_3;
    let bits = power.max(1e-30).to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let m = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000) - 1.0;
    let log2 = m + m * (1.0 - m) * (0.441_917 + m * (-0.267_179_3 + m * (0.148_426_5 - m * 0.045_148_93)));
    DB_PER_OCTAVE * (exponent as f32 + log2)
}

/// Cosine and sine of 2π·`turns`, for |turns| below 2²², to 2e-6 of a full swing: polynomials (least maximum error, fitted)
/// of the half of the angle that is left after whole turns, doubled.
#[inline(always)]
pub fn turn(turns: f32) -> [f32; 2] {
    // Adding 1.5·2²³ rounds to the nearest whole number.
    const WHOLE: f32 = 12_582_912.0;
    let half = core::f32::consts::PI * (turns - ((turns + WHOLE) - WHOLE));
    let y = half * half;
    let sin = half
        * (1.0 - y * (0.166_666_48 - y * (0.008_332_9 - y * (0.000_198_008_98 - y * 0.000_002_590_488_4))));
    let cos = 1.0 - y * (0.499_999_3 - y * (0.041_663_99 - y * (0.001_385_592_7 - y * 0.000_023_194_385)));
    [1.0 - 2.0 * sin * sin, 2.0 * sin * cos]
}

/// Largest whole number at or below `v`, for |v| below 2⁴⁰; within 2⁻¹³ of the next one it may be that. SSE2 has no rounding, and a
/// call per column tells.
#[inline(always)]
pub fn floor(v: f64) -> i64 {
    const OFFSET: i64 = 1 << 40;
    (v + OFFSET as f64) as i64 - OFFSET
}

/// Whole number next to `v`, for |v| below 2⁵¹; a tie goes to the even one.
#[inline(always)]
pub fn nearest(v: f64) -> i64 {
    // Adding 1.5·2⁵² rounds, and leaves the number in the low bits.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    (v + WHOLE).to_bits() as i64 - WHOLE.to_bits() as i64
}

/// The same as a number: loops over it vectorise.
#[inline(always)]
pub fn whole(v: f64) -> f64 {
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    (v + WHOLE) - WHOLE
}

/// Largest whole number at or below `v`, for |v| below 2⁵¹: exact, and loops over it vectorise; by itself it takes twice [`floor`]'s
/// instructions.
#[inline(always)]
pub fn floor_side_by_side(v: f64) -> i64 {
    let near = whole(v);
    nearest(if near > v { near - 1.0 } else { near })
}

#[cfg(test)]
mod tests {
    use super::{exp_minus, floor, floor_side_by_side, nearest, power_db, turn};

    #[test]
    fn whole_numbers_are_those_of_the_standard_library() {
        for i in -4000..4000 {
            for v in [f64::from(i) * 0.37, f64::from(i) * 1.0e6 + 0.3, f64::from(i)] {
                assert_eq!(floor(v), v.floor() as i64, "{v}");
                assert_eq!(floor_side_by_side(v), v.floor() as i64, "{v}");
                assert_eq!(nearest(v), v.round_ties_even() as i64, "{v}");
            }
        }
    }

    #[test]
    fn truth_fast_exponential_follows_libm() {
        for i in 0..=850 {
            let x = i as f32 * 0.01;
            let exact = libm::exp(-f64::from(x));
            assert!((f64::from(exp_minus(x)) / exact - 1.0).abs() < 1e-4, "at {x}");
        }
    }

    #[test]
    fn truth_fast_turns_follow_libm() {
        for i in -3000..3000 {
            let turns = i as f32 * 0.003;
            let (sin, cos) = libm::sincos(core::f64::consts::TAU * f64::from(turns));
            let [fast_cos, fast_sin] = turn(turns).map(f64::from);
            assert!((fast_cos - cos).abs() < 2e-6 && (fast_sin - sin).abs() < 2e-6, "at {turns}");
        }
    }

    #[test]
    fn truth_fast_decibels_follow_libm() {
        for i in -2000..2000 {
            let power = libm::exp(f64::from(i) * 0.03) as f32;
            let exact = 10.0 * libm::log10(f64::from(power.max(1e-30)));
            assert!((f64::from(power_db(power)) - exact).abs() < 2e-4, "at {power}");
        }
        assert!(power_db(0.0) < -290.0);
    }
}
