//! A depth image made ready for fusion: gated, undistorted, with depth bounds per tile.

use geometry::{DVec2, Intrinsics};
use rayon::prelude::*;

use crate::kernels::integrate::{BlockView, DepthView, Z_NEAR};

/// Edge of a tile, pixels.
const TILE: usize = 16;
/// Source of an ideal pixel that the lens does not see.
const NO_SOURCE: u32 = u32::MAX;

/// Depth bounds of one tile.
#[derive(Clone, Copy)]
struct Tile {
    nearest: f32,
    farthest: f32,
    is_full: bool,
}

/// One frame's depth without distortion, 0 = no measurement; buffers are reused between frames.
#[derive(Default)]
pub(super) struct FrameDepth {
    depth: Vec<f32>,
    width: usize,
    height: usize,
    tiles: Vec<Tile>,
    tile_columns: usize,
    undistortion: Option<(Intrinsics, Vec<u32>)>,
}

/// Range of depth that a block's pixels hold.
pub(super) struct DepthBounds {
    /// Smallest measured depth, or −∞ when a pixel is outside the image or unmeasured.
    pub nearest: f32,
    /// Largest measured depth, −∞ without any.
    pub farthest: f32,
    /// Whether all pixels are in the image and all voxels in front of the camera.
    pub is_inside: bool,
}

impl FrameDepth {
    /// Takes `raw` (metres, row-major, one value per pixel of `camera`); depths outside `gate` and
    /// non-finite ones become 0. A distorted image is resampled to the ideal pinhole of the same focal
    /// lengths and centre by nearest pixel: averaging depths would invent surfaces across edges.
    pub(super) fn load(
        &mut self,
        raw: &[f32],
        camera: &Intrinsics,
        gate: std::ops::RangeInclusive<f32>,
    ) {
        self.width = camera.width() as usize;
        self.height = camera.height() as usize;
        self.tile_columns = self.width.div_ceil(TILE);
        self.depth.resize(self.width * self.height, 0.0);
        let tile_count = self.tile_columns * self.height.div_ceil(TILE);
        self.tiles.resize(
            tile_count,
            Tile {
                nearest: 0.0,
                farthest: 0.0,
                is_full: false,
            },
        );
        self.update_undistortion(camera);

        let gated = |depth: f32| if gate.contains(&depth) { depth } else { 0.0 };
        let sources = self
            .undistortion
            .as_ref()
            .map(|(_, sources)| sources.as_slice());
        let width = self.width;
        self.depth
            .par_chunks_mut(width * TILE)
            .zip(self.tiles.par_chunks_mut(self.tile_columns))
            .enumerate()
            .for_each(|(tile_row, (rows, tiles))| {
                let first = tile_row * TILE * width;
                match sources {
                    None => {
                        for (out, &depth) in rows.iter_mut().zip(&raw[first..]) {
                            *out = gated(depth);
                        }
                    }
                    Some(sources) => {
                        for (out, &source) in rows.iter_mut().zip(&sources[first..]) {
                            *out = if source == NO_SOURCE {
                                0.0
                            } else {
                                gated(raw[source as usize])
                            };
                        }
                    }
                }
                bound_tiles(rows, width, tiles);
            });
    }

    /// The frame for the kernel.
    pub(super) fn view(&self) -> DepthView<'_> {
        DepthView {
            depth: &self.depth,
            width: self.width,
            height: self.height,
        }
    }

    /// Bounds of the depths that the 8³ voxels of `view` can project to; `None` when there is no
    /// measurement among them.
    pub(super) fn bounds(&self, view: &BlockView) -> Option<DepthBounds> {
        let unknown = DepthBounds {
            nearest: f32::NEG_INFINITY,
            farthest: f32::INFINITY,
            is_inside: false,
        };
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for corner in 0..8usize {
            let along: [f32; 3] =
                std::array::from_fn(|axis| if corner >> axis & 1 == 1 { 7.0 } else { 0.0 });
            let [u, v, z]: [f32; 3] = std::array::from_fn(|c| {
                view.start[c]
                    + along[0] * view.step[0][c]
                    + along[1] * view.step[1][c]
                    + along[2] * view.step[2][c]
            });
            // The pixels of a block are inside the hull of its corners only when all are in front.
            if z < Z_NEAR || z.is_nan() {
                return Some(unknown);
            }
            for (axis, pixel) in [u / z, v / z].into_iter().enumerate() {
                low[axis] = low[axis].min(pixel);
                high[axis] = high[axis].max(pixel);
            }
        }
        // One pixel of margin for rounding.
        let (width, height) = (self.width as f32, self.height as f32);
        let is_inside =
            low[0] > 0.5 && low[1] > 0.5 && high[0] < width - 1.5 && high[1] < height - 1.5;
        if high[0] < -1.0 || high[1] < -1.0 || low[0] > width || low[1] > height {
            return None;
        }
        let tile = |pixel: f32, size: usize| (pixel.max(0.0) as usize).min(size - 1) / TILE;
        let columns = tile(low[0] - 1.0, self.width)..=tile(high[0] + 1.5, self.width);
        let lines = tile(low[1] - 1.0, self.height)..=tile(high[1] + 1.5, self.height);
        let (mut nearest, mut farthest, mut is_full) =
            (f32::INFINITY, f32::NEG_INFINITY, is_inside);
        for line in lines {
            for tile in &self.tiles[line * self.tile_columns..][columns.clone()] {
                nearest = nearest.min(tile.nearest);
                farthest = farthest.max(tile.farthest);
                is_full &= tile.is_full;
            }
        }
        let nearest = if is_full { nearest } else { f32::NEG_INFINITY };
        (farthest > 0.0).then_some(DepthBounds {
            nearest,
            farthest,
            is_inside,
        })
    }

    fn update_undistortion(&mut self, camera: &Intrinsics) {
        if camera.distortion().is_none() {
            self.undistortion = None;
        } else if self
            .undistortion
            .as_ref()
            .is_none_or(|(known, _)| known != camera)
        {
            self.undistortion = Some((*camera, undistortion_sources(camera)));
        }
    }
}

fn bound_tiles(rows: &[f32], width: usize, tiles: &mut [Tile]) {
    tiles.fill(Tile {
        nearest: f32::INFINITY,
        farthest: f32::NEG_INFINITY,
        is_full: true,
    });
    for row in rows.chunks_exact(width) {
        for (tile, depths) in tiles.iter_mut().zip(row.chunks(TILE)) {
            for &depth in depths {
                let is_measured = depth > 0.0;
                // Plain comparisons: nothing here is NaN.
                if is_measured && depth < tile.nearest {
                    tile.nearest = depth;
                }
                if is_measured && depth > tile.farthest {
                    tile.farthest = depth;
                }
                tile.is_full &= is_measured;
            }
        }
    }
}

/// For each pixel of the ideal pinhole, the index of the real pixel that sees the same ray.
fn undistortion_sources(camera: &Intrinsics) -> Vec<u32> {
    let (width, height) = (camera.width(), camera.height());
    let (focal, center) = (camera.focal(), camera.center());
    let source = |x: u32, y: u32| {
        let ideal = (DVec2::new(f64::from(x), f64::from(y)) - center) / focal;
        let pixel = camera.pixel_from_camera(ideal.extend(1.0))?;
        let (column, line) = camera.contains(pixel)?;
        Some(line * width + column)
    };
    (0..height)
        .flat_map(|y| (0..width).map(move |x| source(x, y).unwrap_or(NO_SOURCE)))
        .collect()
}
