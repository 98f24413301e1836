//! Lines to rows. Compilers move one value at a time.

use crate::Instructions;

/// Side of the square that is turned at once.
const SIDE: usize = 8;

/// Turns lines of `rows` values, `stride` apart in `source`, into rows of as many values as there are `lines`, `pitch` apart in
/// `out`. Lines and rows come by eights.
///
/// # Panics
/// When they do not come by eights, when a row is longer than `pitch`, or when `source` or `out` is too short.
pub fn transpose(
    instructions: Instructions,
    [lines, rows]: [usize; 2],
    source: &[f32],
    stride: usize,
    out: &mut [f32],
    pitch: usize,
) {
    assert!(lines.is_multiple_of(SIDE) && rows.is_multiple_of(SIDE), "{lines} lines of {rows}");
    assert!(lines <= pitch, "rows of {lines}, {pitch} apart");
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "a call of a function for instructions that may be missing")]
    if instructions.has_avx2() {
        // SAFETY: such a set exists only where the CPU was seen to have these instructions.
        return unsafe { avx2::transpose([lines, rows], source, stride, out, pitch) };
    }
    let _ = instructions;
    for line in (0..lines).step_by(4) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| &source[(line + i) * stride..][..rows]);
        for row in 0..rows {
            out[row * pitch + line..][..4].copy_from_slice(&[a[row], b[row], c[row], d[row]]);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use core::arch::x86_64::{
        __m256, _mm256_loadu_ps, _mm256_permute2f128_ps, _mm256_shuffle_ps, _mm256_storeu_ps,
        _mm256_unpackhi_ps, _mm256_unpacklo_ps,
    };

    use super::SIDE;

    #[target_feature(enable = "avx2")]
    pub(super) fn transpose(
        [lines, rows]: [usize; 2],
        source: &[f32],
        stride: usize,
        out: &mut [f32],
        pitch: usize,
    ) {
        for line in (0..lines).step_by(SIDE) {
            let from: [&[[f32; SIDE]]; SIDE] =
                core::array::from_fn(|i| source[(line + i) * stride..][..rows].as_chunks().0);
            for square in 0..rows / SIDE {
                let columns = turn([0, 1, 2, 3, 4, 5, 6, 7].map(|i| load(&from[i][square])));
                for (row, values) in columns.into_iter().enumerate() {
                    let out = &mut out[(square * SIDE + row) * pitch + line..];
                    store(out.first_chunk_mut().expect("room for a row"), values);
                }
            }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn load(values: &[f32; SIDE]) -> __m256 {
        #[expect(unsafe_code, reason = "the instruction takes a bare address")]
        // SAFETY: it reads the eight values, at any alignment.
        unsafe {
            _mm256_loadu_ps(values.as_ptr())
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn store(out: &mut [f32; SIDE], values: __m256) {
        #[expect(unsafe_code, reason = "the instruction takes a bare address")]
        // SAFETY: it writes the eight values, at any alignment.
        unsafe {
            _mm256_storeu_ps(out.as_mut_ptr(), values);
        }
    }

    /// Turns a square: by pairs, by fours, by halves.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn turn([a, b, c, d, e, f, g, h]: [__m256; SIDE]) -> [__m256; SIDE] {
        let pairs = [[a, b], [c, d], [e, f], [g, h]]
            .map(|[above, below]| [_mm256_unpacklo_ps(above, below), _mm256_unpackhi_ps(above, below)]);
        let fours = |[ab, cd]: [[__m256; 2]; 2]| {
            [
                _mm256_shuffle_ps::<0x44>(ab[0], cd[0]),
                _mm256_shuffle_ps::<0xEE>(ab[0], cd[0]),
                _mm256_shuffle_ps::<0x44>(ab[1], cd[1]),
                _mm256_shuffle_ps::<0xEE>(ab[1], cd[1]),
            ]
        };
        let (upper, lower) = (fours([pairs[0], pairs[1]]), fours([pairs[2], pairs[3]]));
        core::array::from_fn(|row| {
            let (upper, lower) = (upper[row % 4], lower[row % 4]);
            if row < 4 {
                _mm256_permute2f128_ps::<0x20>(upper, lower)
            } else {
                _mm256_permute2f128_ps::<0x31>(upper, lower)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_every_value_goes_where_it_belongs_and_no_other_is_touched() {
        for instructions in Instructions::available() {
            for (lines, rows, stride, pitch) in [(8, 8, 8, 8), (16, 24, 31, 32), (16, 8, 9, 21), (8, 0, 5, 8)]
            {
                let source: Vec<f32> = (0..lines * stride + rows).map(|i| i as f32).collect();
                let mut out = vec![-1.0; rows * pitch + lines];
                transpose(instructions, [lines, rows], &source, stride, &mut out, pitch);
                for (at, &value) in out.iter().enumerate() {
                    let (row, line) = (at / pitch, at % pitch);
                    let turned = row < rows && line < lines;
                    let expected = if turned { source[line * stride + row] } else { -1.0 };
                    assert_eq!(value, expected, "{instructions:?}: row {row}, line {line}");
                }
            }
        }
    }
}
