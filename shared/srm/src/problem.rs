//! The normal equations of the joint solve, applied and never formed.

use crate::regularisation::Regularisation;
use crate::rows::{Row, Rows};
use crate::weights::Weights;
use geometry::PanoramaSize;
use rayon::prelude::*;

/// Three channels of one unknown.
pub type Rgb = [f64; 3];

/// Rows are cut into at most this many tiles, and tiles are summed in order: the same bits for any number of
/// threads.
const MOST_TILES: usize = 8;
/// A tile holds a vector of all unknowns; with fewer rows than this share of it, clearing and adding vectors
/// would cost more than the rows.
const LEAST_ROWS_A_TILE: f64 = 0.75;

/// Entries of a vector that one task reduces at a time.
const REDUCE_CHUNK: usize = 4096;

/// Why rows do not make a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SrmError {
    /// A row names a vertex that does not exist.
    #[error("row {row} names vertex {vertex} of {vertex_count}")]
    VertexOutOfRange {
        /// Position of the row.
        row: usize,
        /// Vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertex_count: usize,
    },
    /// A row names a texel that does not exist.
    #[error("row {row} names texel {texel} of {texel_count}")]
    TexelOutOfRange {
        /// Position of the row.
        row: usize,
        /// Texel it names.
        texel: u32,
        /// Number of texels.
        texel_count: usize,
    },
    /// There is nothing to solve from.
    #[error("no pixel sees the object well enough to solve from")]
    NoRows,
}

/// Rows, their unknowns and the neighbourhood of the texels.
///
/// Unknowns are one vector: first the vertices of D, then the texels of S, three channels each.
#[derive(Clone, Debug)]
pub struct Problem {
    rows: Rows,
    vertex_count: usize,
    panorama: PanoramaSize,
    covered: Vec<bool>,
}

impl Problem {
    /// Checks that every row names unknowns that exist.
    pub fn new(rows: Rows, vertex_count: usize, panorama: PanoramaSize) -> Result<Self, SrmError> {
        if rows.is_empty() {
            return Err(SrmError::NoRows);
        }
        let texel_count = panorama.texel_count();
        let mut covered = vec![false; texel_count];
        for (position, row) in rows.iter().enumerate() {
            if let Some(&vertex) = row.vertices.iter().find(|&&v| v as usize >= vertex_count) {
                return Err(SrmError::VertexOutOfRange {
                    row: position,
                    vertex,
                    vertex_count,
                });
            }
            if let Some(&texel) = row.texels.iter().find(|&&t| t as usize >= texel_count) {
                return Err(SrmError::TexelOutOfRange {
                    row: position,
                    texel,
                    texel_count,
                });
            }
            for (&texel, &tap) in row.texels.iter().zip(&row.taps) {
                covered[texel as usize] |= tap > 0.0;
            }
        }
        Ok(Self {
            rows,
            vertex_count,
            panorama,
            covered,
        })
    }

    /// The same unknowns with rows that name no others.
    pub(crate) fn with_rows(&self, rows: Rows) -> Self {
        Self {
            rows,
            covered: self.covered.clone(),
            ..*self
        }
    }

    /// The rows.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// Number of vertices of D.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// The panorama of S.
    pub fn panorama(&self) -> PanoramaSize {
        self.panorama
    }

    /// Number of unknowns a channel.
    pub fn unknown_count(&self) -> usize {
        self.vertex_count + self.panorama.texel_count()
    }

    /// Texels that at least one row reaches with a positive tap (hard-cases H01). Only these are solved.
    pub fn covered(&self) -> &[bool] {
        &self.covered
    }

    /// What the model predicts for a row: Σ b D + Σ a S + known.
    pub fn predict(&self, row: &Row, unknowns: &[Rgb]) -> Rgb {
        let mut sum = self.linear_part(row, unknowns);
        for (value, known) in sum.iter_mut().zip(row.known) {
            *value += f64::from(known);
        }
        sum
    }

    /// Σ b D + Σ a S of a row.
    #[inline]
    fn linear_part(&self, row: &Row, unknowns: &[Rgb]) -> Rgb {
        let mut sum = [0.0; 3];
        for (&vertex, &b) in row.vertices.iter().zip(&row.barycentric) {
            let value = &unknowns[vertex as usize];
            let b = f64::from(b);
            sum[0] += b * value[0];
            sum[1] += b * value[1];
            sum[2] += b * value[2];
        }
        for (&texel, &a) in row.texels.iter().zip(&row.taps) {
            let value = &unknowns[self.vertex_count + texel as usize];
            let a = f64::from(a);
            sum[0] += a * value[0];
            sum[1] += a * value[1];
            sum[2] += a * value[2];
        }
        sum
    }

    /// Adds `value` times the row's coefficients to `out` (one column of Aᵀ).
    #[inline]
    fn scatter(&self, row: &Row, value: Rgb, out: &mut [Rgb]) {
        for (&vertex, &b) in row.vertices.iter().zip(&row.barycentric) {
            let target = &mut out[vertex as usize];
            let b = f64::from(b);
            target[0] += b * value[0];
            target[1] += b * value[1];
            target[2] += b * value[2];
        }
        for (&texel, &a) in row.texels.iter().zip(&row.taps) {
            let target = &mut out[self.vertex_count + texel as usize];
            let a = f64::from(a);
            target[0] += a * value[0];
            target[1] += a * value[1];
            target[2] += a * value[2];
        }
    }

    /// Tiles of a sum over rows: 2, 4 or 8, by the size of the problem alone.
    fn tile_count(&self) -> usize {
        let tiles = self.rows.len() as f64 / (LEAST_ROWS_A_TILE * self.unknown_count() as f64);
        let mut count = MOST_TILES;
        while count > 2 && count as f64 > tiles {
            count /= 2;
        }
        count
    }

    /// Sums `contribution(row index, row, buffer)` over all rows in fixed tiles into one vector.
    fn accumulate<F>(&self, contribution: F) -> Vec<Rgb>
    where
        F: Fn(usize, &Row, &mut [Rgb]) + Sync,
    {
        let rows = self.rows.as_slice();
        let tile_length = rows.len().div_ceil(self.tile_count()).max(1);
        let tiles: Vec<Vec<Rgb>> = rows
            .par_chunks(tile_length)
            .enumerate()
            .map(|(tile, chunk)| {
                let mut buffer = vec![[0.0; 3]; self.unknown_count()];
                for (offset, row) in chunk.iter().enumerate() {
                    contribution(tile * tile_length + offset, row, &mut buffer);
                }
                buffer
            })
            .collect();
        let mut total = vec![[0.0; 3]; self.unknown_count()];
        total
            .par_chunks_mut(REDUCE_CHUNK)
            .enumerate()
            .for_each(|(chunk, values)| {
                let start = chunk * REDUCE_CHUNK;
                for tile in &tiles {
                    for (value, part) in values.iter_mut().zip(&tile[start..]) {
                        value[0] += part[0];
                        value[1] += part[1];
                        value[2] += part[2];
                    }
                }
            });
        total
    }

    /// AᵀW A x plus the regularisers' H x.
    pub fn apply(&self, weights: &Weights, regularisation: &Regularisation, x: &[Rgb]) -> Vec<Rgb> {
        let mut result = self.accumulate(|index, row, buffer| {
            let mut value = self.linear_part(row, x);
            let weight = weights.rows[index];
            for c in 0..3 {
                value[c] *= f64::from(weight[c]);
            }
            self.scatter(row, value, buffer);
        });
        self.add_regularisation(regularisation, &weights.edges, x, &mut result);
        result
    }

    /// AᵀW (observed − known): the data side of the normal equations.
    pub fn right_side(&self, weights: &Weights) -> Vec<Rgb> {
        self.accumulate(|index, row, buffer| {
            let weight = weights.rows[index];
            let mut value = [0.0; 3];
            for c in 0..3 {
                value[c] =
                    f64::from(weight[c]) * (f64::from(row.observed[c]) - f64::from(row.known[c]));
            }
            self.scatter(row, value, buffer);
        })
    }

    /// Diagonal of AᵀWA alone: the Fisher information of each unknown at unit noise.
    pub fn information(&self, weights: &Weights) -> Vec<Rgb> {
        self.accumulate(|index, row, buffer| {
            let weight = weights.rows[index].map(f64::from);
            for (&vertex, &b) in row.vertices.iter().zip(&row.barycentric) {
                let square = f64::from(b) * f64::from(b);
                for (target, w) in buffer[vertex as usize].iter_mut().zip(weight) {
                    *target += square * w;
                }
            }
            for (&texel, &a) in row.texels.iter().zip(&row.taps) {
                let square = f64::from(a) * f64::from(a);
                for (target, w) in buffer[self.vertex_count + texel as usize]
                    .iter_mut()
                    .zip(weight)
                {
                    *target += square * w;
                }
            }
        })
    }

    /// One value for each row, in order.
    pub fn map_rows<T: Send>(&self, value: impl Fn(usize, &Row) -> T + Sync + Send) -> Vec<T> {
        self.rows
            .as_slice()
            .par_iter()
            .enumerate()
            .map(|(index, row)| value(index, row))
            .collect()
    }
}
