//! Cholesky of a symmetric matrix of 6x6 blocks, kept from the first entry of each row to the diagonal.
//!
//! Along a path most nodes meet near ones only, so rows are short; fill stays within them. Sums in f64 in a fixed
//! order.

/// Side of a block.
const BLOCK: usize = 6;

/// The lower triangle by rows.
pub(super) struct Envelope {
    /// First column of each row.
    first: Vec<usize>,
    rows: Vec<Vec<f64>>,
}

impl Envelope {
    /// Zero, for `count` nodes of which `pairs` meet; every node meets itself.
    pub(super) fn new(count: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let mut node_first: Vec<usize> = (0..count).collect();
        for (one, other) in pairs {
            let (low, high) = (one.min(other), one.max(other));
            node_first[high] = node_first[high].min(low);
        }
        let first: Vec<usize> = (0..BLOCK * count)
            .map(|row| BLOCK * node_first[row / BLOCK])
            .collect();
        let rows = first
            .iter()
            .enumerate()
            .map(|(row, first)| vec![0.0; row + 1 - first])
            .collect();
        Self { first, rows }
    }

    /// Adds a block at nodes (row, column), or its transpose at (column, row); of a diagonal block the lower half.
    pub(super) fn add(&mut self, row: usize, column: usize, block: &[[f64; BLOCK]; BLOCK]) {
        for (i, values) in block.iter().enumerate() {
            for (j, value) in values.iter().enumerate() {
                let (i, j) = (BLOCK * row + i, BLOCK * column + j);
                let (high, low) = (i.max(j), i.min(j));
                if row != column || j <= i {
                    self.rows[high][low - self.first[high]] += value;
                }
            }
        }
    }

    /// The solution for a right side; `None` unless the matrix is positive definite.
    pub(super) fn solve(mut self, mut right: Vec<f64>) -> Option<Vec<f64>> {
        let count = self.rows.len();
        for row in 0..count {
            let (done, rest) = self.rows.split_at_mut(row);
            let current = rest.first_mut()?;
            let first = self.first[row];
            for column in first..row {
                let other = &done[column];
                let start = first.max(self.first[column]);
                let sum = dot(
                    &current[start - first..column - first],
                    &other[start - self.first[column]..column - self.first[column]],
                );
                let diagonal = other[column - self.first[column]];
                current[column - first] = (current[column - first] - sum) / diagonal;
            }
            let whole = current[row - first];
            let left = whole - dot(&current[..row - first], &current[..row - first]);
            // NaN fails. What rounding leaves of a direction that nothing determines is no pivot.
            if !(left > 1e-13 * whole) {
                return None;
            }
            current[row - first] = left.sqrt();
        }
        for row in 0..count {
            let first = self.first[row];
            let sum = dot(&self.rows[row][..row - first], &right[first..row]);
            right[row] = (right[row] - sum) / self.rows[row][row - first];
        }
        for row in (0..count).rev() {
            let first = self.first[row];
            let value = right[row] / self.rows[row][row - first];
            right[row] = value;
            for (entry, above) in self.rows[row].iter().zip(&mut right[first..row]) {
                *above -= entry * value;
            }
        }
        Some(right)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_of_blocks_solves_to_rounding() {
        let count = 9;
        let pairs = || (0..count).map(|node| (node, (node + 1) % count));
        let mut matrix = Envelope::new(count, pairs());
        let mut dense = vec![vec![0.0; BLOCK * count]; BLOCK * count];
        let value =
            |i: usize, j: usize, k: usize| (((7 * i + 11 * j + 5 * k) % 13) as f64 - 6.0) / 13.0;
        for node in 0..count {
            let block: [[f64; BLOCK]; BLOCK] = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let off = value(i.min(j), i.max(j), node);
                    off + if i == j { 12.0 } else { 0.0 }
                })
            });
            matrix.add(node, node, &block);
            for i in 0..BLOCK {
                for j in 0..BLOCK {
                    dense[BLOCK * node + i][BLOCK * node + j] += block[i][j];
                }
            }
        }
        for (one, other) in pairs() {
            let block: [[f64; BLOCK]; BLOCK] =
                std::array::from_fn(|i| std::array::from_fn(|j| value(i, j, one)));
            matrix.add(one, other, &block);
            for i in 0..BLOCK {
                for j in 0..BLOCK {
                    dense[BLOCK * one + i][BLOCK * other + j] += block[i][j];
                    dense[BLOCK * other + j][BLOCK * one + i] += block[i][j];
                }
            }
        }
        let truth: Vec<f64> = (0..BLOCK * count)
            .map(|i| (i as f64 * 0.37).sin())
            .collect();
        let right: Vec<f64> = dense.iter().map(|row| dot(row, &truth)).collect();
        let found = matrix.solve(right).unwrap();
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found - truth).abs() < 1e-12, "{found} {truth}");
        }
    }

    #[test]
    fn what_nothing_determines_is_said() {
        assert!(
            Envelope::new(2, std::iter::once((0, 1)))
                .solve(vec![0.0; 12])
                .is_none()
        );
        assert_eq!(
            Envelope::new(0, std::iter::empty()).solve(Vec::new()),
            Some(Vec::new())
        );
    }
}
