use crate::window::Window;

/// A square of grey levels that the tracker looks for, with what the optimiser needs of it.
#[derive(Debug, Clone)]
pub(crate) struct Template {
    pub window: Window,
    /// Grey levels of the padded window.
    pub padded: Vec<f32>,
    /// Gradient along u in the window.
    pub grad_u: Vec<f32>,
    /// Gradient along v in the window.
    pub grad_v: Vec<f32>,
    /// Median of the whole image when the template was taken; `None` when it was dark.
    pub median: Option<f64>,
}

impl Template {
    /// A black one.
    pub fn blank(side: usize) -> Self {
        let window = Window { side };
        Self {
            window,
            padded: vec![0.0; window.padded_len()],
            grad_u: vec![0.0; window.len()],
            grad_v: vec![0.0; window.len()],
            median: None,
        }
    }

    /// From (S + 2)² pixels, row by row.
    pub fn from_pixels(side: usize, pixels: &[f32], median: Option<f64>) -> Self {
        let mut template = Self::blank(side);
        let rows = template.padded.chunks_exact_mut(template.window.padded_stride());
        for (row, pixels) in rows.zip(pixels.chunks_exact(side + 2)) {
            row[..side + 2].copy_from_slice(pixels);
        }
        template.median = median;
        template.differentiate();
        template
    }

    /// Replaces the grey levels by those of a patch.
    pub fn refresh(&mut self, padded: &[f32], median: Option<f64>) {
        self.padded.copy_from_slice(padded);
        self.median = median;
        self.differentiate();
    }

    fn differentiate(&mut self) {
        gradient(&self.padded, self.window, &mut self.grad_u, &mut self.grad_v);
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
pub(crate) fn gradient(padded: &[f32], window: Window, grad_u: &mut [f32], grad_v: &mut [f32]) {
    let (stride, width) = (window.padded_stride(), window.stride());
    for (y, (grad_u, grad_v)) in
        grad_u.chunks_exact_mut(width).zip(grad_v.chunks_exact_mut(width)).enumerate()
    {
        let above = &padded[y * stride + 1..][..width];
        let here = &padded[(y + 1) * stride..][..width + 2];
        let below = &padded[(y + 2) * stride + 1..][..width];
        for x in 0..width {
            grad_u[x] = 0.5 * (here[x + 2] - here[x]);
            grad_v[x] = 0.5 * (below[x] - above[x]);
        }
    }
}
