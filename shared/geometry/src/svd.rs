//! Singular values of 3x3 matrices.

use crate::direction::unit;
use glam::{DMat3, DVec3};

/// `matrix = left · diag(values) · rightᵀ` with two rotations.
///
/// The values descend in absolute value; the first two are not negative, the third carries the sign of the
/// determinant, because a rotation cannot. `left · rightᵀ` is therefore the rotation nearest to `matrix`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignedSvd {
    /// A rotation whose columns are the left singular vectors.
    pub left: DMat3,
    /// Signed singular values, in the unit of the matrix.
    pub values: DVec3,
    /// A rotation whose columns are the right singular vectors.
    pub right: DMat3,
}

/// Sweeps after which three columns are orthogonal to rounding; convergence is quadratic, 6 are usual.
const SWEEPS: usize = 30;

/// The signed singular value decomposition of a finite matrix, by one-sided Jacobi rotations (Hestenes 1958).
///
/// One-sided, because the eigenvalues of `MᵀM` would lose the small singular values below 1e-8 of the largest.
pub fn signed_svd(matrix: DMat3) -> SignedSvd {
    let largest = matrix
        .to_cols_array()
        .into_iter()
        .map(f64::abs)
        .fold(0.0, f64::max);
    if largest == 0.0 {
        return SignedSvd {
            left: DMat3::IDENTITY,
            values: DVec3::ZERO,
            right: DMat3::IDENTITY,
        };
    }
    // Squares of entries near 1 neither overflow nor vanish.
    let mut columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|column| column / largest);
    let mut right = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..SWEEPS {
        let rotated =
            [(0, 1), (0, 2), (1, 2)].map(|(p, q)| rotate_pair(&mut columns, &mut right, p, q));
        if rotated == [false; 3] {
            break;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| columns[b].length().total_cmp(&columns[a].length()));
    let [first, second, third] = order;

    let left_first = unit(columns[first]).unwrap_or(DVec3::X);
    let across = columns[second] - left_first * left_first.dot(columns[second]);
    let left_second = unit(across).unwrap_or_else(|| left_first.any_orthonormal_vector());
    // A tiny second column may have lost its direction to the projection: once more.
    let left_second = (left_second - left_first * left_first.dot(left_second)).normalize();
    let left_third = left_first.cross(left_second);
    let right_third = right[first].cross(right[second]);
    // The last column is matrix · right[third]; its sign against both completions is the determinant's.
    let sign = (left_third.dot(columns[third]) * right_third.dot(right[third])).signum();
    let values = DVec3::new(
        columns[first].length(),
        columns[second].length(),
        columns[third].length() * sign,
    );
    SignedSvd {
        left: DMat3::from_cols(left_first, left_second, left_third),
        values: values * largest,
        right: DMat3::from_cols(right[first], right[second], right_third),
    }
}

/// Makes columns `p` and `q` orthogonal by a rotation in their plane, applied to `right` too; false where
/// they already are, to rounding.
fn rotate_pair(columns: &mut [DVec3; 3], right: &mut [DVec3; 3], p: usize, q: usize) -> bool {
    let (alpha, beta) = (columns[p].length_squared(), columns[q].length_squared());
    let gamma = columns[p].dot(columns[q]);
    if gamma.abs() <= f64::EPSILON * (alpha * beta).sqrt() {
        return false;
    }
    let zeta = (beta - alpha) / (2.0 * gamma);
    let tangent = 1.0_f64.copysign(zeta) / (zeta.abs() + zeta.hypot(1.0));
    let cosine = 1.0 / tangent.hypot(1.0);
    let sine = cosine * tangent;
    for vectors in [columns, right] {
        let (a, b) = (vectors[p], vectors[q]);
        vectors[p] = a * cosine - b * sine;
        vectors[q] = a * sine + b * cosine;
    }
    true
}
