//! Marching cubes over a volume.

use geometry::Vec3;
use rayon::prelude::*;

use super::Mesh;
use super::cases::{CASES, CORNERS, edge_start};
use super::halo::{Halo, halo_index};
use crate::normals::{face_normal_sums, unit_or_zero};
use crate::volume::Volume;
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// Settings of [`extract_mesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshConfig {
    /// Least weight of all eight corners of a cell (hard-cases D14); above 0.
    pub min_weight: f32,
}

impl Default for MeshConfig {
    fn default() -> Self {
        Self { min_weight: 2.0 }
    }
}

/// Nearest that a vertex comes to a voxel, in voxels.
///
/// Keeps triangles around a corner that is exactly 0 from collapsing (hard-cases D13): their sides are at
/// least 1 % of a voxel, 40 µm at 4 mm, which f32 positions resolve up to 100 m from the origin.
const EDGE_MARGIN: f32 = 0.01;

/// Gradient, in truncations per voxel times truncation voxels, below which it says nothing (D15).
const LEAST_GRADIENT: f32 = 1e-3;

const BITMAP_WORDS: usize = 3 * BLOCK_VOXELS / 64;
/// Cells −1..8 along an edge.
const CELL_EDGE: usize = BLOCK_EDGE + 1;

/// The vertices on edges that start in one block, and the cells of that block that hold surface.
struct BlockSurface {
    coordinates: [i32; 3],
    /// Bit `3·voxel + axis`: the edge from the voxel along the axis has a vertex.
    edges: [u64; BITMAP_WORDS],
    /// Vertices before each word of `edges`.
    before: [u16; BITMAP_WORDS],
    vertices: Vec<Vertex>,
    /// (voxel index of the cell's lowest corner, sign pattern).
    cells: Vec<(u16, u8)>,
}

struct Vertex {
    position: Vec3,
    normal: Vec3,
    weight: f32,
    /// 0 without colour.
    radiance: [f32; 3],
}

impl BlockSurface {
    /// Number of an edge's vertex within the block.
    fn rank(&self, edge: usize) -> u32 {
        let (word, bit) = (edge / 64, edge % 64);
        u32::from(self.before[word]) + (self.edges[word] & ((1u64 << bit) - 1)).count_ones()
    }
}

/// The zero surface of `volume` as triangles with shared vertices, counter-clockwise from free space.
///
/// Only cells with eight corners of weight ≥ `min_weight` count. Normals are the gradient of the distance
/// field, or area-weighted face normals where it is flat or contradicts the faces. Vertices and triangles
/// come in the order of block coordinates, for any number of threads.
pub fn extract_mesh(volume: &Volume, config: &MeshConfig) -> Mesh {
    let min_weight = config.min_weight.max(f32::MIN_POSITIVE);
    let order = surface_blocks(volume, min_weight);
    let surfaces: Vec<BlockSurface> = order
        .par_iter()
        .map_init(Halo::new, |halo, &index| {
            let coordinates = volume.block_coordinates(index);
            halo.load(volume, coordinates, min_weight);
            block_surface(halo, coordinates, volume)
        })
        .collect();

    let mut surface_of_block = vec![u32::MAX; volume.block_count()];
    let mut first_vertex = Vec::with_capacity(surfaces.len());
    let mut vertex_count = 0u32;
    for (rank, (surface, &index)) in surfaces.iter().zip(&order).enumerate() {
        surface_of_block[index as usize] = rank as u32;
        first_vertex.push(vertex_count);
        vertex_count += surface.vertices.len() as u32;
    }
    let triangles: Vec<Vec<[u32; 3]>> = surfaces
        .par_iter()
        .map(|surface| {
            block_triangles(surface, volume, &surface_of_block, &surfaces, &first_vertex)
        })
        .collect();

    let vertices = || surfaces.iter().flat_map(|surface| &surface.vertices);
    let mut mesh = Mesh {
        positions: vertices().map(|v| v.position).collect(),
        normals: vertices().map(|v| v.normal).collect(),
        weights: vertices().map(|v| v.weight).collect(),
        radiance: if volume.has_color() {
            vertices().map(|v| v.radiance).collect()
        } else {
            Vec::new()
        },
        triangles: triangles.concat(),
        origin: volume.config().origin,
    };
    mend_normals(&mut mesh);
    mesh
}

/// Blocks that can start an edge with a vertex or a cell with triangles, in key order.
fn surface_blocks(volume: &Volume, min_weight: f32) -> Vec<u32> {
    const NEGATIVE: u8 = 1;
    const POSITIVE: u8 = 2;
    let signs: Vec<u8> = (0..volume.block_count() as u32)
        .into_par_iter()
        .map(|index| {
            let block = volume.block(index);
            let mut found = 0;
            for (&tsdf, &weight) in block.tsdf.iter().zip(&block.weight) {
                let sign = if tsdf < 0.0 { NEGATIVE } else { POSITIVE };
                found |= if weight >= min_weight { sign } else { 0 };
            }
            found
        })
        .collect();
    let mut order = volume.sorted_blocks();
    order.retain(|&index| {
        let coordinates = volume.block_coordinates(index);
        let mut found = 0;
        for corner in 0..CORNERS {
            let neighbour =
                std::array::from_fn(|axis| coordinates[axis] + (corner >> axis & 1) as i32);
            found |= volume
                .block_index(neighbour)
                .map_or(0, |neighbour| signs[neighbour as usize]);
        }
        found == NEGATIVE | POSITIVE
    });
    order
}

fn block_surface(halo: &Halo, coordinates: [i32; 3], volume: &Volume) -> BlockSurface {
    let mut surface = BlockSurface {
        coordinates,
        edges: [0; BITMAP_WORDS],
        before: [0; BITMAP_WORDS],
        vertices: Vec::new(),
        cells: Vec::new(),
    };
    let (is_complete, patterns) = cell_patterns(halo);
    let edge = BLOCK_EDGE as i32;
    for voxel in 0..BLOCK_VOXELS as i32 {
        let [x, y, z] = [voxel % edge, voxel / edge % edge, voxel / (edge * edge)];
        let cell = cell_index(x, y, z);
        if is_complete[cell] && !matches!(patterns[cell], 0 | 255) {
            surface.cells.push((voxel as u16, patterns[cell]));
        }
        for axis in 0..3 {
            if edge_has_vertex(halo, &is_complete, [x, y, z], axis) {
                let bit = 3 * voxel as usize + axis;
                surface.edges[bit / 64] |= 1 << (bit % 64);
                surface
                    .vertices
                    .push(vertex(halo, [x, y, z], axis, coordinates, volume));
            }
        }
    }
    let mut count = 0;
    for (before, word) in surface.before.iter_mut().zip(surface.edges) {
        *before = count;
        count += word.count_ones() as u16;
    }
    surface
}

/// For cells −1..8: whether all corners are observed, and which are negative.
fn cell_patterns(halo: &Halo) -> ([bool; CELL_EDGE.pow(3)], [u8; CELL_EDGE.pow(3)]) {
    let mut is_complete = [false; CELL_EDGE.pow(3)];
    let mut patterns = [0u8; CELL_EDGE.pow(3)];
    let edge = BLOCK_EDGE as i32;
    for z in -1..edge {
        for y in -1..edge {
            for x in -1..edge {
                let (mut pattern, mut complete) = (0, true);
                for corner in 0..CORNERS {
                    let [dx, dy, dz] = [corner & 1, corner >> 1 & 1, corner >> 2].map(|d| d as i32);
                    let tsdf = halo.tsdf[halo_index(x + dx, y + dy, z + dz)];
                    complete &= !tsdf.is_nan();
                    // Exactly 0 counts as positive everywhere.
                    pattern |= u8::from(tsdf < 0.0) << corner;
                }
                is_complete[cell_index(x, y, z)] = complete;
                patterns[cell_index(x, y, z)] = pattern;
            }
        }
    }
    (is_complete, patterns)
}

#[inline]
fn cell_index(x: i32, y: i32, z: i32) -> usize {
    ((z + 1) as usize * CELL_EDGE + (y + 1) as usize) * CELL_EDGE + (x + 1) as usize
}

/// Whether the edge crosses zero and one of the four cells around it is complete.
fn edge_has_vertex(halo: &Halo, is_complete: &[bool], voxel: [i32; 3], axis: usize) -> bool {
    let mut end = voxel;
    end[axis] += 1;
    let value = |[x, y, z]: [i32; 3]| halo.tsdf[halo_index(x, y, z)];
    if (value(voxel) < 0.0) == (value(end) < 0.0) {
        return false;
    }
    (0..4).any(|cell: i32| {
        let mut at = voxel;
        at[(axis + 1) % 3] -= cell & 1;
        at[(axis + 2) % 3] -= cell >> 1;
        is_complete[cell_index(at[0], at[1], at[2])]
    })
}

fn vertex(halo: &Halo, voxel: [i32; 3], axis: usize, block: [i32; 3], volume: &Volume) -> Vertex {
    let mut end = voxel;
    end[axis] += 1;
    let (from, to) = (
        halo_index(voxel[0], voxel[1], voxel[2]),
        halo_index(end[0], end[1], end[2]),
    );
    let (d0, d1) = (halo.tsdf[from], halo.tsdf[to]);
    // The signs differ, so d0 − d1 is not 0.
    let share = (d0 / (d0 - d1)).clamp(EDGE_MARGIN, 1.0 - EDGE_MARGIN);
    let mut position = [0.0; 3];
    for (n, p) in position.iter_mut().enumerate() {
        let voxels = f64::from(block[n]) * BLOCK_EDGE as f64 + f64::from(voxel[n]);
        let along = if n == axis { f64::from(share) } else { 0.0 };
        *p = ((voxels + along) * f64::from(volume.config().voxel_size)) as f32;
    }
    let gradient = match (halo.gradient(voxel), halo.gradient(end)) {
        (Some(a), Some(b)) => a.lerp(b, share),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => Vec3::ZERO,
    };
    let slope = gradient.length() * volume.config().truncation_voxels;
    Vertex {
        position: Vec3::from_array(position),
        normal: if slope < LEAST_GRADIENT {
            Vec3::ZERO
        } else {
            unit_or_zero(gradient)
        },
        weight: halo.weight[from] + (halo.weight[to] - halo.weight[from]) * share,
        radiance: edge_radiance(volume, block, voxel, end, share),
    }
}

/// Radiance at `share` of the way between two voxels (relative to `block`): that of the one where the other has
/// none, 0 where neither has.
fn edge_radiance(
    volume: &Volume,
    block: [i32; 3],
    from: [i32; 3],
    to: [i32; 3],
    share: f32,
) -> [f32; 3] {
    if !volume.has_color() {
        return [0.0; 3];
    }
    let radiance = |voxel: [i32; 3]| {
        let edge = BLOCK_EDGE as i32;
        let at = volume.voxel_radiance(std::array::from_fn(|n| edge * block[n] + voxel[n]));
        at.map(|(radiance, _)| radiance)
    };
    match (radiance(from), radiance(to)) {
        (Some(a), Some(b)) => std::array::from_fn(|n| a[n] + (b[n] - a[n]) * share),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => [0.0; 3],
    }
}

fn block_triangles(
    surface: &BlockSurface,
    volume: &Volume,
    surface_of_block: &[u32],
    surfaces: &[BlockSurface],
    first_vertex: &[u32],
) -> Vec<[u32; 3]> {
    // Edges of a cell start in this block or in one of the seven above it.
    let owners: [Option<usize>; CORNERS] = std::array::from_fn(|corner| {
        let neighbour =
            std::array::from_fn(|axis| surface.coordinates[axis] + (corner >> axis & 1) as i32);
        let rank = surface_of_block[volume.block_index(neighbour)? as usize];
        (rank != u32::MAX).then_some(rank as usize)
    });
    let vertex_of = |cell: usize, edge: u8| -> u32 {
        let (axis, corner) = edge_start(usize::from(edge));
        let (mut owner, mut voxel) = (0, 0);
        for n in 0..3 {
            let place = (cell >> (3 * n) & (BLOCK_EDGE - 1)) + (corner >> n & 1);
            owner |= (place / BLOCK_EDGE) << n;
            voxel |= (place % BLOCK_EDGE) << (3 * n);
        }
        let owner = owners[owner]
            .expect("a complete cell's corners lie in blocks, and a crossing makes them surface");
        first_vertex[owner] + surfaces[owner].rank(3 * voxel + axis)
    };
    let mut triangles = Vec::with_capacity(2 * surface.cells.len());
    for &(cell, pattern) in &surface.cells {
        for triangle in &CASES[usize::from(pattern)].triangles {
            triangles.push(triangle.map(|edge| vertex_of(usize::from(cell), edge)));
        }
    }
    triangles
}

/// Replaces missing normals, and those that point away from the faces around them, by face normals.
fn mend_normals(mesh: &mut Mesh) {
    let sums = face_normal_sums(mesh);
    for (normal, &sum) in mesh.normals.iter_mut().zip(&sums) {
        let face = unit_or_zero(sum);
        let agrees = normal.dot(face) > 0.0;
        if !agrees && face != Vec3::ZERO {
            *normal = face;
        } else if *normal == Vec3::ZERO {
            // Faces that cancel: any unit vector is as good.
            *normal = Vec3::Z;
        }
    }
}
