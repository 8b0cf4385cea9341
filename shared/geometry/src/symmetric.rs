//! Eigenvalues of small symmetric matrices.

/// Sweeps after which an N×N matrix is diagonal to rounding; convergence is quadratic, 5 to 8 are usual.
const SWEEPS: usize = 40;

/// `matrix = Σ valuesᵢ · vectorsᵢ vectorsᵢᵀ` with orthonormal vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SymmetricEigen<const N: usize> {
    /// Eigenvalues, largest first, in the unit of the matrix.
    pub values: [f64; N],
    /// Unit eigenvectors, one for each value.
    pub vectors: [[f64; N]; N],
}

/// Eigenvalues and eigenvectors of a finite symmetric matrix, by cyclic Jacobi rotations (Golub and Van Loan
/// 8.5). Only the upper triangle is read. Small eigenvalues are right relative to the largest one, not to
/// themselves; a matrix that is not finite gives values that are not finite.
pub fn symmetric_eigen<const N: usize>(matrix: &[[f64; N]; N]) -> SymmetricEigen<N> {
    let mut a: [[f64; N]; N] = std::array::from_fn(|row| {
        std::array::from_fn(|column| matrix[row.min(column)][row.max(column)])
    });
    let mut vectors: [[f64; N]; N] =
        std::array::from_fn(|row| std::array::from_fn(|column| f64::from(u8::from(row == column))));
    for _ in 0..SWEEPS {
        let mut largest_turn = 0.0_f64;
        for p in 0..N {
            for q in p + 1..N {
                largest_turn = largest_turn.max(annihilate(&mut a, &mut vectors, p, q));
            }
        }
        if largest_turn == 0.0 {
            break;
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|index| index);
    order.sort_by(|&one, &other| a[other][other].total_cmp(&a[one][one]));
    SymmetricEigen {
        values: order.map(|index| a[index][index]),
        vectors: order.map(|index| vectors[index]),
    }
}

/// Turns axes p and q so that the entry between them vanishes; the sine of the turn, 0 when nothing was to be
/// done. Rows of `vectors` are the axes so far.
fn annihilate<const N: usize>(
    a: &mut [[f64; N]; N],
    vectors: &mut [[f64; N]; N],
    p: usize,
    q: usize,
) -> f64 {
    let off = a[p][q];
    if off.abs() <= f64::EPSILON * 0.1 * (a[p][p] * a[q][q]).abs().sqrt() || off == 0.0 {
        return 0.0;
    }
    // The smaller root of t² + 2θt − 1 = 0: a turn of at most 45°.
    let theta = (a[q][q] - a[p][p]) / (2.0 * off);
    let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
    if !tangent.is_finite() {
        return 0.0;
    }
    let cosine = 1.0 / tangent.hypot(1.0);
    let sine = tangent * cosine;
    for row in a.iter_mut() {
        let (at_p, at_q) = (row[p], row[q]);
        row[p] = cosine * at_p - sine * at_q;
        row[q] = sine * at_p + cosine * at_q;
    }
    for column in 0..N {
        let (at_p, at_q) = (a[p][column], a[q][column]);
        a[p][column] = cosine * at_p - sine * at_q;
        a[q][column] = sine * at_p + cosine * at_q;
        let (of_p, of_q) = (vectors[p][column], vectors[q][column]);
        vectors[p][column] = cosine * of_p - sine * of_q;
        vectors[q][column] = sine * of_p + cosine * of_q;
    }
    (a[p][q], a[q][p]) = (0.0, 0.0);
    sine.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matrix with the given eigenvalues, turned by fixed plane rotations.
    fn turned<const N: usize>(values: [f64; N]) -> [[f64; N]; N] {
        let mut axes: [[f64; N]; N] =
            std::array::from_fn(|row| std::array::from_fn(|c| f64::from(u8::from(row == c))));
        for turn in 0..3 * N {
            let (p, q) = (turn % N, (turn * 2 + 1) % N);
            if p == q {
                continue;
            }
            let (sine, cosine) = (0.3 + turn as f64).sin_cos();
            let (a, b) = (axes[p], axes[q]);
            axes[p] = std::array::from_fn(|c| cosine * a[c] - sine * b[c]);
            axes[q] = std::array::from_fn(|c| sine * a[c] + cosine * b[c]);
        }
        std::array::from_fn(|r| {
            std::array::from_fn(|c| (0..N).map(|k| values[k] * axes[k][r] * axes[k][c]).sum())
        })
    }

    #[test]
    fn known_eigenvalues_come_back_in_order() {
        let found = symmetric_eigen(&turned([0.0, 3.0, 1e-4, 2.0, 7.0, 1.0]));
        for (value, expected) in found
            .values
            .into_iter()
            .zip([7.0, 3.0, 2.0, 1.0, 1e-4, 0.0])
        {
            assert!((value - expected).abs() < 1e-14, "{value} for {expected}");
        }
    }

    #[test]
    fn vectors_are_orthonormal_and_rebuild_the_matrix() {
        let matrix = turned([5.0, 5.0, 1.0, 1e-9, 0.2, 30.0]);
        let found = symmetric_eigen(&matrix);
        for (r, row) in matrix.iter().enumerate() {
            for (c, expected) in row.iter().enumerate() {
                let dot: f64 = (0..6)
                    .map(|k| found.vectors[r][k] * found.vectors[c][k])
                    .sum();
                assert!((dot - f64::from(u8::from(r == c))).abs() < 1e-14);
                let entry: f64 = (0..6)
                    .map(|k| found.values[k] * found.vectors[k][r] * found.vectors[k][c])
                    .sum();
                assert!((entry - expected).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn a_diagonal_and_a_zero_matrix_are_done_at_once() {
        assert_eq!(
            symmetric_eigen(&[[1.0, 0.0], [0.0, 4.0]]).values,
            [4.0, 1.0]
        );
        assert_eq!(symmetric_eigen(&[[0.0; 3]; 3]).values, [0.0; 3]);
    }
}
