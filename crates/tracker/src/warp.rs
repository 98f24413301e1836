//! Where a template lies in the picture: paper (3) and (4), in centred coordinates.

use sonoloop_types::Warp;

use crate::register::MIN_GRADIENT;

/// Largest change of area that a template may go through: |det A − 1|.
const MAX_AREA_CHANGE: f64 = 0.5;

/// The affine map a from a template's coordinates, centred on the tip and in pixels, to the picture's: c + A·x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    /// c, the tip (u, v).
    pub centre_px: [f64; 2],
    /// A, row by row; the identity for a template that has only been moved.
    pub linear: [[f64; 2]; 2],
}

/// A template that has neither turned nor been stretched.
pub(crate) const UPRIGHT: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

impl Placement {
    /// A template that has only been moved.
    pub fn at(centre_px: [f64; 2]) -> Self {
        Self { centre_px, linear: UPRIGHT }
    }

    pub fn is_translation(&self) -> bool {
        self.linear == UPRIGHT
    }

    /// The picture's coordinates of a template's.
    pub fn map(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [[xx, xy], [yx, yy]] = self.linear;
        [self.centre_px[0] + xx * x + xy * y, self.centre_px[1] + yx * x + yy * y]
    }

    /// a ∘ (I + Δ): a step is taken in the template's coordinates, where the gradients are known.
    pub fn compose(&self, [shift, by_x, by_y]: [[f64; 2]; 3]) -> Self {
        let linear = self.linear.map(|[x, y]| {
            let along = |d: [f64; 2]| x * d[0] + y * d[1];
            [x + along(by_x), y + along(by_y)]
        });
        Self { centre_px: self.map(shift), linear }
    }

    /// Largest distance between the corners of a window of half-side `half_px` at two placements.
    pub fn corner_distance(&self, other: &Self, half_px: f64) -> f64 {
        let corners = [[-half_px, -half_px], [half_px, -half_px], [-half_px, half_px], [half_px, half_px]];
        corners.iter().fold(0.0, |most: f64, corner| {
            let (a, b) = (self.map(*corner), other.map(*corner));
            most.max(libm::hypot(a[0] - b[0], a[1] - b[1]))
        })
    }

    /// Whether the template is still one: finite, and neither blown up nor shrunk by half.
    pub fn is_sane(&self) -> bool {
        let [[xx, xy], [yx, yy]] = self.linear;
        let area = xx * yy - xy * yx;
        // Written so that NaN fails.
        (area - 1.0).abs() <= MAX_AREA_CHANGE && self.centre_px.iter().all(|c| c.is_finite())
    }
}

/// A step of the optimiser as a shift and what it adds to the template's axes: the columns of Δ.
///
/// `parameters` are those of [`normal_equations`], the linear ones per `half_px`. A rigid step is a turn to first order;
/// its sine and cosine make a true turn of it.
pub(crate) fn step(warp: Warp, parameters: &[f64], half_px: f64) -> [[f64; 2]; 3] {
    match (warp, parameters) {
        (Warp::Rigid, &[u, v, turn]) => {
            let (sin, cos) = libm::sincos(turn / half_px);
            [[u, v], [cos - 1.0, sin], [-sin, cos - 1.0]]
        }
        (Warp::Affine, &[u, v, ux, uy, vx, vy]) => {
            [[u, v], [ux / half_px, vx / half_px], [uy / half_px, vy / half_px]]
        }
        _ => [[parameters[0], parameters[1]], [0.0; 2], [0.0; 2]],
    }
}

/// Sums over the window of w·g_i·g_j·φ and w·e·g_i·φ, with g = (g_u, g_v) and φ products of 1, x and y, the centred
/// coordinates over the window's half-side.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Moments {
    /// For [1, x, y, x², xy, y²]: [g_u², g_u·g_v, g_v²].
    pub gradients: [[f64; 3]; 6],
    /// For [1, x, y]: [e·g_u, e·g_v].
    pub residuals: [[f64; 2]; 3],
    /// Σ w and Σ w·e².
    pub weight: f64,
    pub squares: f64,
}

impl Moments {
    /// Whether there is less gradient than one can hold on to.
    pub fn lacks_texture(&self) -> bool {
        let [uu, _, vv] = self.gradients[0];
        // Written so that NaN lacks it.
        let textured = uu + vv > self.weight * MIN_GRADIENT * MIN_GRADIENT;
        !textured
    }
}

/// H and b of a warp's parameters: (u, v) for a translation; then a turn, or g_u·x, g_u·y, g_v·x, g_v·y.
pub(crate) fn normal_equations(warp: Warp, sums: &Moments) -> (usize, [[f64; 6]; 6], [f64; 6]) {
    // Which gradient and which coordinate each affine parameter goes with.
    const AFFINE: [(usize, usize); 6] = [(0, 0), (1, 0), (0, 1), (0, 2), (1, 1), (1, 2)];
    const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let of = |(g, p): (usize, usize), (h, q): (usize, usize)| sums.gradients[PRODUCT[p][q]][g + h];
    let mut matrix = [[0.0; 6]; 6];
    let mut vector = [0.0; 6];
    for (i, &a) in AFFINE.iter().enumerate() {
        vector[i] = sums.residuals[a.1][a.0];
        for (j, &b) in AFFINE.iter().enumerate() {
            matrix[i][j] = of(a, b);
        }
    }
    match warp {
        Warp::Translation => (2, matrix, vector),
        Warp::Affine => (6, matrix, vector),
        Warp::Rigid => {
            // A turn moves (x, y) by (−y, x): its gradient is g_v·x − g_u·y, parameters 4 and 3 of the affine ones.
            let row: [f64; 6] = core::array::from_fn(|j| matrix[4][j] - matrix[3][j]);
            let turn = [row[0], row[1], row[4] - row[3]];
            for i in 0..3 {
                (matrix[2][i], matrix[i][2]) = (turn[i], turn[i]);
            }
            vector[2] = vector[4] - vector[3];
            (3, matrix, vector)
        }
    }
}

/// Δ = −(H + λ·diag H)⁻¹·b by Cholesky; `None` when a pivot is too small against the largest diagonal element, or nothing
/// is a number.
pub(crate) fn solve(
    count: usize,
    matrix: &[[f64; 6]; 6],
    vector: &[f64; 6],
    damping: f64,
) -> Option<[f64; 6]> {
    const LEAST_PIVOT: f64 = 1e-9;
    let largest = (0..count).map(|i| matrix[i][i]).fold(0.0, f64::max);
    let mut lower = [[0.0; 6]; 6];
    for i in 0..count {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - known;
            if i == j {
                let pivot = rest + damping * matrix[i][i];
                // Written so that NaN fails.
                let large_enough = pivot > LEAST_PIVOT * largest;
                if !large_enough {
                    return None;
                }
                lower[i][i] = pivot.sqrt();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    let mut solution = [0.0; 6];
    for i in 0..count {
        let known: f64 = (0..i).map(|k| lower[i][k] * solution[k]).sum();
        solution[i] = (-vector[i] - known) / lower[i][i];
    }
    for i in (0..count).rev() {
        let known: f64 = (i + 1..count).map(|k| lower[k][i] * solution[k]).sum();
        solution[i] = (solution[i] - known) / lower[i][i];
    }
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(turn_rad: f64, centre_px: [f64; 2]) -> Placement {
        let (sin, cos) = libm::sincos(turn_rad);
        Placement { centre_px, linear: [[cos, -sin], [sin, cos]] }
    }

    #[test]
    fn truth_a_rigid_step_turns_and_keeps_lengths() {
        let before = turned(0.4, [10.0, 20.0]);
        let after = before.compose(step(Warp::Rigid, &[1.0, 0.0, 0.3 * 9.5], 9.5));
        let expected = turned(0.7, [10.0 + libm::cos(0.4), 20.0 + libm::sin(0.4)]);
        assert!(after.corner_distance(&expected, 9.5) < 1e-12, "{after:?}");
    }

    #[test]
    fn truth_composition_is_the_product_of_matrices() {
        let before = Placement { centre_px: [3.0, -1.0], linear: [[1.1, 0.2], [-0.1, 0.9]] };
        let delta = [[0.5, -0.25], [0.02, 0.03], [-0.04, 0.05]];
        let after = before.compose(delta);
        // a(x + Δ(x)) for a few points.
        for [x, y] in [[0.0, 0.0], [4.0, -7.0], [9.5, 9.5]] {
            let moved = [
                x + delta[0][0] + delta[1][0] * x + delta[2][0] * y,
                y + delta[0][1] + delta[1][1] * x + delta[2][1] * y,
            ];
            let (got, expected) = (after.map([x, y]), before.map(moved));
            assert!(libm::hypot(got[0] - expected[0], got[1] - expected[1]) < 1e-12);
        }
    }

    #[test]
    fn truth_the_solution_satisfies_the_equations() {
        // A positive definite matrix from its factor.
        let factor = |i: usize, k: usize| ((i * 5 + k) % 7) as f64;
        let entry = |i: usize, j: usize| {
            (0..6).map(|k| factor(i, k) * factor(j, k)).sum::<f64>() + if i == j { 3.0 } else { 0.0 }
        };
        let matrix: [[f64; 6]; 6] = core::array::from_fn(|i| core::array::from_fn(|j| entry(i, j)));
        let vector = [1.0, -2.0, 0.5, 3.0, -1.0, 2.0];
        let solution = solve(6, &matrix, &vector, 0.0).expect("a solution");
        for (row, v) in matrix.iter().zip(vector) {
            let left: f64 = row.iter().zip(solution).map(|(m, s)| m * s).sum();
            assert!((left + v).abs() < 1e-9, "{left} for {}", -v);
        }
        assert!(solve(6, &[[1.0; 6]; 6], &vector, 0.0).is_none(), "a singular matrix has none");
        assert!(solve(2, &[[f64::NAN; 6]; 6], &vector, 0.0).is_none());
    }
}
