use crate::region::Inside;

/// A square of grey levels that the tracker looks for, with what the optimiser needs of it.
#[derive(Debug, Clone)]
pub(crate) struct Template {
    /// Side S of the window.
    pub side: usize,
    /// (S + 2)² grey levels, row by row: the window and one more pixel all around.
    pub padded: Vec<f32>,
    /// Gradient along u in the window, S² values.
    pub grad_u: Vec<f32>,
    /// Gradient along v in the window, S² values.
    pub grad_v: Vec<f32>,
    /// Median of the whole image when the template was taken; `None` when it was dark.
    pub median: Option<f64>,
}

impl Template {
    /// Takes over a padded patch.
    pub fn new(side: usize, padded: Vec<f32>, median: Option<f64>) -> Self {
        let mut template =
            Self { side, padded, grad_u: vec![0.0; side * side], grad_v: vec![0.0; side * side], median };
        template.differentiate();
        template
    }

    /// Replaces the grey levels.
    pub fn refresh(&mut self, padded: &[f32], median: Option<f64>) {
        self.padded.copy_from_slice(padded);
        self.median = median;
        self.differentiate();
    }

    fn differentiate(&mut self) {
        gradient(&self.padded, self.side, &mut self.grad_u, &mut self.grad_v);
    }

    /// Δ: how much brighter the whole image has become since the template was taken.
    pub fn change_to(&self, median: Option<f64>) -> f32 {
        match (self.median, median) {
            (Some(then), Some(now)) => (now - then) as f32,
            _ => 0.0,
        }
    }
}

/// Central differences of a padded patch.
pub(crate) fn gradient(padded: &[f32], side: usize, grad_u: &mut [f32], grad_v: &mut [f32]) {
    let width = side + 2;
    for y in 0..side {
        let above = &padded[y * width + 1..][..side];
        let here = &padded[(y + 1) * width..][..width];
        let below = &padded[(y + 2) * width + 1..][..side];
        for x in 0..side {
            grad_u[y * side + x] = 0.5 * (here[x + 2] - here[x]);
            grad_v[y * side + x] = 0.5 * (below[x] - above[x]);
        }
    }
}

/// One row of the window inside a padded patch, cut to the columns inside the picture.
pub(crate) fn window_row(padded: &[f32], side: usize, y: usize, inside: Inside) -> &[f32] {
    &padded[(y + 1) * (side + 2) + 1..][..side][inside.x[0]..inside.x[1]]
}

/// The same row of an array over the window alone.
pub(crate) fn plain_row(window: &[f32], side: usize, y: usize, inside: Inside) -> &[f32] {
    &window[y * side..][..side][inside.x[0]..inside.x[1]]
}
