//! Wider instructions where the CPU has them.
//!
//! The shipped program runs on any x86-64, and on other machines; the loops that take most of the time are compiled
//! once more for wider vectors, and the CPU decides at run time; [`transpose`] alone is written for them by hand. Vectors only do
//! several lanes at once: no sum changes its order and nothing is fused, so every version gives the same bits.

mod transpose;

pub use transpose::transpose;

/// Instructions that this CPU has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instructions(Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Set {
    Plain,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Instructions {
    /// What every CPU of the architecture has.
    pub const PLAIN: Self = Self(Set::Plain);

    /// All sets that this CPU has versions of the loops for, the widest last.
    pub fn available() -> Vec<Self> {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return vec![Self::PLAIN, Self(Set::Avx2)];
        }
        vec![Self::PLAIN]
    }

    /// The widest set.
    pub fn widest() -> Self {
        Self::available().pop().unwrap_or(Self::PLAIN)
    }

    /// Whether the loops compiled for AVX2 may run.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn has_avx2(self) -> bool {
        self.0 == Set::Avx2
    }
}

/// Compiles a function for every set of instructions; callers name the set first. What it calls is part of it only
/// where it is inlined.
///
/// ```
/// use sonoloop_simd::{Instructions, wide};
///
/// wide! {
///     fn sum(values: &[f32; 8]) -> f32 {
///         values.iter().sum()
///     }
/// }
/// assert_eq!(sum(Instructions::widest(), &[0.5; 8]), 4.0);
/// ```
#[macro_export]
macro_rules! wide {
    ($(#[$attribute:meta])* $visibility:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $(-> $answer:ty)? $body:block) => {
        $(#[$attribute])*
        $visibility fn $name(instructions: $crate::Instructions, $($argument: $type),*) $(-> $answer)? {
            #[inline(always)]
            #[allow(clippy::too_many_arguments, reason = "the outer function says why")]
            fn plain($($argument: $type),*) $(-> $answer)? $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            #[allow(clippy::too_many_arguments, reason = "the outer function says why")]
            fn avx2($($argument: $type),*) $(-> $answer)? {
                plain($($argument),*)
            }
            #[cfg(not(target_arch = "x86_64"))]
            let _ = instructions;
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "a call of a function for instructions that may be missing")]
            if instructions.has_avx2() {
                // SAFETY: such a set exists only where the CPU was seen to have these instructions.
                return unsafe { avx2($($argument),*) };
            }
            plain($($argument),*)
        }
    };
}

/// Tells the CPU that the values from a place on will be read soon; it may ignore that.
#[inline(always)]
pub fn prefetch(values: &[u32], at: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address = values.as_ptr().wrapping_add(at);
        #[expect(unsafe_code, reason = "the instruction takes a bare address")]
        // SAFETY: it reads nothing that the program sees, and never fails, whatever the address.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(address.cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, at);
}

/// Whole number next to `v`, for |v| below 2²²; a tie goes to the even one. Rounding by a cast does not vectorise.
#[inline(always)]
pub fn nearest_f32(v: f32) -> i32 {
    // Adding 1.5·2²³ rounds, and leaves the number in the low bits.
    const WHOLE: f32 = 12_582_912.0;
    (v + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32
}

#[cfg(test)]
mod tests {
    use super::nearest_f32;

    #[test]
    fn whole_numbers_are_those_of_the_standard_library() {
        for i in -4000..4000 {
            let v = i as f32 * 0.37;
            assert_eq!(nearest_f32(v), v.round_ties_even() as i32, "{v}");
        }
    }
}
