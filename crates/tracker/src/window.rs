//! How squares of pixels are stored: in rows of whole vectors, so that no loop has a remainder.

/// Pixels that are worked on side by side, and the lanes of every sum. No CPU changes it.
pub(crate) const LANES: usize = 8;
/// Eight neighbouring values.
pub(crate) type Lanes = [f32; LANES];

/// A square of `side` pixels about the tip, and the padded one with one more pixel all around for its gradient.
///
/// Rows of both begin a stride apart. What lies between a row's end and the next one's beginning is anything finite; its
/// weight is zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    /// Pixels along one side, S.
    pub side: usize,
}

impl Window {
    /// From row to row of the window.
    pub const fn stride(self) -> usize {
        self.side.next_multiple_of(LANES)
    }

    /// Values of the window.
    pub const fn len(self) -> usize {
        self.side * self.stride()
    }

    /// From row to row of the padded window.
    pub const fn padded_stride(self) -> usize {
        (self.side + 2).next_multiple_of(LANES)
    }

    /// Values of the padded window. A vector that begins with a row's last pixels ends beyond it, hence some more.
    pub const fn padded_len(self) -> usize {
        (self.side + 2) * self.padded_stride() + LANES
    }

    /// Coordinates of the outermost pixels, in pixels from the middle.
    pub const fn half_px(self) -> f64 {
        (self.side as f64 - 1.0) / 2.0
    }

    /// The pixels of the padded window row by row, without what lies between the rows.
    pub fn pixels(self, padded: &[f32]) -> impl Iterator<Item = f32> + '_ {
        let rows = padded.chunks_exact(self.padded_stride()).take(self.side + 2);
        rows.flat_map(move |row| row[..self.side + 2].iter().copied())
    }
}

/// The rows and columns of a window that take part: where weights are not next to nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    /// First row and column.
    pub first: usize,
    /// One beyond the last.
    pub end: usize,
}

impl Part {
    /// First column of the first vector that has a column of this part.
    pub const fn first_vector(self) -> usize {
        self.first - self.first % LANES
    }

    /// Half-side of what a patch of it touches: half the part, the rest of its first vector, its border and a tap.
    pub const fn reach(self) -> usize {
        (self.end - self.first).div_ceil(2) + self.first % LANES + 3
    }

    /// First columns of the vectors that this part's columns lie in.
    pub fn vectors(self) -> impl Iterator<Item = usize> {
        (self.first_vector()..self.end).step_by(LANES)
    }
}

/// Eight values from `at` on.
#[inline(always)]
pub(crate) fn lanes(values: &[f32], at: usize) -> &Lanes {
    match values[at..].first_chunk() {
        Some(lanes) => lanes,
        // Buffers are as long as `Window` says; the slice above panics for anything else anyhow.
        None => unreachable!("a vector beyond the window's buffer"),
    }
}

/// The sum of the lanes, in double precision.
pub(crate) fn total(lanes: &Lanes) -> f64 {
    lanes.iter().map(|lane| f64::from(*lane)).sum()
}
