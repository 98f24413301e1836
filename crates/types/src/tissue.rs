use std::sync::Arc;

use serde::{Deserialize, Serialize};

/// What sound meets in one material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Acoustics {
    /// Sound speed.
    pub sound_speed_m_s: f64,
    /// Attenuation at 1 MHz, one way.
    pub attenuation_db_cm_mhz: f64,
    /// Exponent of the frequency in the attenuation (1: proportional).
    pub attenuation_exponent: f64,
    /// Density.
    pub density_kg_m3: f64,
    /// Scatter power relative to unit backscatter; `None` where nothing scatters (clear liquid).
    pub backscatter_db: Option<f64>,
}

/// A stretch of one material along a vertical line through the phantom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnSegment {
    /// Upper end, z in the phantom frame.
    pub top_z_m: f64,
    /// Lower end, z in the phantom frame, below `top_z_m`.
    pub bottom_z_m: f64,
    /// Index into [`Tissue::materials`].
    pub material: u16,
}

type ColumnFn = dyn Fn(f64, f64, &mut Vec<ColumnSegment>) + Send + Sync;

/// The undeformed phantom as sound sees it: materials, and which one lies where.
///
/// The phantom frame has its origin at the centre of the top face, z up; the phantom fills
/// `|x| ≤ size/2, |y| ≤ size/2, −size_z ≤ z ≤ 0`.
#[derive(Clone)]
pub struct Tissue {
    size_m: [f64; 3],
    materials: Vec<Acoustics>,
    column: Arc<ColumnFn>,
}

impl Tissue {
    /// `column(x_m, y_m, out)` fills `out` with the segments of the vertical line through (x, y), from the
    /// top down, without gaps, over the whole thickness; it leaves `out` empty outside the phantom.
    pub fn new(
        size_m: [f64; 3],
        materials: Vec<Acoustics>,
        column: impl Fn(f64, f64, &mut Vec<ColumnSegment>) + Send + Sync + 'static,
    ) -> Self {
        Self { size_m, materials, column: Arc::new(column) }
    }

    /// A block of one material.
    pub fn homogeneous(size_m: [f64; 3], acoustics: Acoustics) -> Self {
        Self::new(size_m, vec![acoustics], move |x, y, out| {
            out.clear();
            if x.abs() <= size_m[0] / 2.0 && y.abs() <= size_m[1] / 2.0 {
                out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: -size_m[2], material: 0 });
            }
        })
    }

    /// Extent along x, y and z of the phantom frame.
    pub fn size_m(&self) -> [f64; 3] {
        self.size_m
    }

    /// The materials that [`ColumnSegment::material`] counts.
    pub fn materials(&self) -> &[Acoustics] {
        &self.materials
    }

    /// Replaces `out` by the segments of the vertical line through (x, y), from the top down.
    pub fn column(&self, x_m: f64, y_m: f64, out: &mut Vec<ColumnSegment>) {
        out.clear();
        (self.column)(x_m, y_m, out);
    }
}
