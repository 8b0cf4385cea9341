//! A depth image made ready for fusion: gated, undistorted, with depth bounds per tile.

use geometry::Intrinsics;
use imaging::{LinearPixel, Undistortion};
use rayon::prelude::*;

use crate::kernels::integrate::{BlockView, DepthView, Z_NEAR};

/// Edge of a tile, pixels.
const TILE: usize = 8;

/// Depth bounds of one tile.
#[derive(Clone, Copy)]
struct Tile {
    nearest: f32,
    farthest: f32,
    is_full: bool,
}

impl Tile {
    const UNKNOWN: Self = Self {
        nearest: f32::INFINITY,
        farthest: f32::NEG_INFINITY,
        is_full: true,
    };
}

/// One frame's depth without distortion, 0 = no measurement; buffers are reused between frames.
#[derive(Default)]
pub(super) struct FrameDepth {
    depth: Vec<f32>,
    /// Colour without distortion; not used while the camera has none.
    color: Vec<LinearPixel>,
    width: usize,
    height: usize,
    tiles: Vec<Tile>,
    tile_columns: usize,
    /// `None` while the camera has no distortion.
    undistortion: Option<Undistortion>,
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
    /// lengths and centre by nearest pixel: averaging depths would invent surfaces across edges. `color`, one
    /// per depth, goes the same way.
    pub(super) fn load(
        &mut self,
        raw: &[f32],
        color: Option<&[LinearPixel]>,
        camera: &Intrinsics,
        gate: std::ops::RangeInclusive<f32>,
    ) {
        self.width = camera.width() as usize;
        self.height = camera.height() as usize;
        self.tile_columns = self.width.div_ceil(TILE);
        self.depth.resize(self.width * self.height, 0.0);
        let tile_count = self.tile_columns * self.height.div_ceil(TILE);
        self.tiles.resize(tile_count, Tile::UNKNOWN);
        self.update_undistortion(camera);

        let gated = |depth: f32| if gate.contains(&depth) { depth } else { 0.0 };
        let sources = self.undistortion.as_ref().map(Undistortion::sources);
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
                            // A source beyond the image is a ray that the lens does not see.
                            *out = raw.get(source as usize).map_or(0.0, |depth| gated(*depth));
                        }
                    }
                }
                bound_tiles(rows, width, tiles);
            });
        if let (Some(sources), Some(color)) = (sources, color) {
            self.color.resize(color.len(), LinearPixel::INVALID);
            self.color
                .par_chunks_mut(width * TILE)
                .zip(sources.par_chunks(width * TILE))
                .for_each(|(out, sources)| {
                    for (out, &source) in out.iter_mut().zip(sources) {
                        *out = color
                            .get(source as usize)
                            .copied()
                            .unwrap_or(LinearPixel::INVALID);
                    }
                });
        }
    }

    /// The colour image that lies on the depth of [`FrameDepth::view`]: `color`, or what `load` made of it.
    pub(super) fn color_view<'a>(&'a self, color: &'a [LinearPixel]) -> &'a [LinearPixel] {
        if self.undistortion.is_some() {
            &self.color
        } else {
            color
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let sources = self.undistortion.as_ref().map_or(0, Undistortion::bytes);
        self.depth.capacity() * size_of::<f32>()
            + self.color.capacity() * size_of::<LinearPixel>()
            + self.tiles.capacity() * size_of::<Tile>()
            + sources
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
        let corners: [[f32; 8]; 3] = std::array::from_fn(|c| {
            let [x, y, z] = [0, 1, 2].map(|axis| 7.0 * view.step[axis][c]);
            std::array::from_fn(|corner| {
                let bit = |axis: usize| (corner >> axis & 1) as f32;
                view.start[c] + bit(0) * x + bit(1) * y + bit(2) * z
            })
        });
        // The pixels of a block are inside the hull of its corners only when all are in front.
        let z = &corners[2];
        if !z.iter().fold(true, |all, &z| all & (z >= Z_NEAR)) {
            return Some(unknown);
        }
        let ranges = [0, 1].map(|c| pixel_range(&corners[c], z));
        let (low, high) = (ranges.map(|range| range.0), ranges.map(|range| range.1));
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
            .is_none_or(|known| known.camera() != camera)
        {
            self.undistortion = Some(Undistortion::new(camera));
        }
    }
}

/// Least and greatest of `homogeneous / z`.
#[inline]
fn pixel_range(homogeneous: &[f32; 8], z: &[f32; 8]) -> (f32, f32) {
    let pixel: [f32; 8] = std::array::from_fn(|corner| homogeneous[corner] / z[corner]);
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let most = |a: f32, b: f32| if a > b { a } else { b };
    (
        pixel.into_iter().fold(f32::INFINITY, least),
        pixel.into_iter().fold(f32::NEG_INFINITY, most),
    )
}

fn bound_tiles(rows: &[f32], width: usize, tiles: &mut [Tile]) {
    for (column, tile) in tiles.iter_mut().enumerate() {
        let from = column * TILE;
        let to = (from + TILE).min(width);
        *tile = if to - from == TILE {
            bound_full_tile(rows, width, from)
        } else {
            bound_tile(rows.chunks_exact(width).flat_map(|row| &row[from..to]))
        };
    }
}

fn bound_tile<'a>(depths: impl Iterator<Item = &'a f32>) -> Tile {
    let mut tile = Tile::UNKNOWN;
    for &depth in depths {
        // 0 = no measurement; nothing here is NaN.
        if depth > 0.0 {
            tile.nearest = tile.nearest.min(depth);
            tile.farthest = tile.farthest.max(depth);
        }
        tile.is_full &= depth > 0.0;
    }
    tile
}

/// As [`bound_tile`], a row at a time: plain comparisons, which a vector unit has.
fn bound_full_tile(rows: &[f32], width: usize, from: usize) -> Tile {
    let mut nearest = [f32::INFINITY; TILE];
    let mut farthest = [0.0_f32; TILE];
    let mut least = [f32::INFINITY; TILE];
    for row in rows.chunks_exact(width) {
        let depths = &row[from..from + TILE];
        for n in 0..TILE {
            let depth = depths[n];
            let measured = if depth > 0.0 { depth } else { f32::INFINITY };
            nearest[n] = if measured < nearest[n] {
                measured
            } else {
                nearest[n]
            };
            farthest[n] = if depth > farthest[n] {
                depth
            } else {
                farthest[n]
            };
            least[n] = if depth < least[n] { depth } else { least[n] };
        }
    }
    let farthest = farthest.into_iter().fold(0.0, f32::max);
    Tile {
        nearest: nearest.into_iter().fold(f32::INFINITY, f32::min),
        farthest: if farthest > 0.0 {
            farthest
        } else {
            f32::NEG_INFINITY
        },
        is_full: least.into_iter().fold(f32::INFINITY, f32::min) > 0.0,
    }
}
