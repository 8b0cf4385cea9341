//! The specification: a point at a time.

use glam::{Vec3A, Vec4};

use super::{FieldSample, Neighbourhood, REACH, slope};
use crate::kernels::integrate::Block;
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

pub(super) fn sample_fields(
    points: &[Neighbourhood<'_>],
    min_weight: f32,
    samples: &mut [FieldSample],
) {
    for (point, out) in points.iter().zip(samples) {
        *out = sample(point, min_weight).unwrap_or(FieldSample::NONE);
    }
}

fn sample(point: &Neighbourhood<'_>, min_weight: f32) -> Option<FieldSample> {
    let share = point.share;
    let weight = weight(point, min_weight)?;
    // Rows along x, named by their place along y and z; 1 and 2 enclose the point.
    let row = |y, z| gather(point, y, z, |block| &block.tsdf);
    let inner = [[row(1, 1), row(2, 1)], [row(1, 2), row(2, 2)]];
    let (before_y, behind_y) = ([row(0, 1), row(0, 2)], [row(3, 1), row(3, 2)]);
    let (before_z, behind_z) = ([row(1, 0), row(2, 0)], [row(1, 3), row(2, 3)]);
    let along_z = |[a, b]: [Vec4; 2]| a + (b - a) * share.z;
    let along_y = |[a, b]: [Vec4; 2]| a + (b - a) * share.y;
    let at_x = |row: Vec4| row.y + (row.z - row.y) * share.x;
    let lines = [along_y(inner[0]), along_y(inner[1])];
    let middle = along_z(lines);

    let ends =
        |rows: [Vec4; 2], others: [Vec4; 2]| rows[0].max(rows[1]).max(others[0].max(others[1]));
    let ends_x = ends(inner[0], inner[1]);
    let (ends_y, ends_z) = (ends(before_y, behind_y), ends(before_z, behind_z));
    let in_y = [[inner[0][0], inner[1][0]], [inner[0][1], inner[1][1]]].map(along_z);
    let slopes = [
        slope(middle.to_array(), share.x, ends_x.x.max(ends_x.w)),
        slope(
            [along_z(before_y), in_y[0], in_y[1], along_z(behind_y)].map(at_x),
            share.y,
            ends_y.y.max(ends_y.z),
        ),
        slope(
            [along_y(before_z), lines[0], lines[1], along_y(behind_z)].map(at_x),
            share.z,
            ends_z.y.max(ends_z.z),
        ),
    ];
    Some(FieldSample {
        tsdf: at_x(middle),
        gradient: Vec3A::from_array(slopes),
        weight,
    })
}

/// Trilinear weight of the cell; `None` when one of its corners has less than `min_weight`.
fn weight(point: &Neighbourhood<'_>, min_weight: f32) -> Option<f32> {
    let share = point.share;
    let row = |y, z| gather(point, y, z, |block| &block.weight);
    let [a, b, c, d] = [row(1, 1), row(2, 1), row(1, 2), row(2, 2)];
    let least = a.min(b).min(c.min(d));
    if !(least.y.min(least.z) >= min_weight) {
        return None;
    }
    let (low, high) = (a + (b - a) * share.y, c + (d - c) * share.y);
    let middle = low + (high - low) * share.z;
    Some(middle.y + (middle.z - middle.y) * share.x)
}

/// Four values in a row along x, of what `values` shows of a block.
fn gather<'a>(
    point: &Neighbourhood<'a>,
    y: usize,
    z: usize,
    values: impl Fn(&'a Block) -> &'a [f32; BLOCK_VOXELS],
) -> Vec4 {
    let (part, line) = point.line(y, z);
    let (lower, upper) = (values(point.blocks[part]), values(point.blocks[part | 1]));
    let row: [f32; REACH] = std::array::from_fn(|x| {
        let x = point.first[0] + x;
        let half = if x < BLOCK_EDGE { lower } else { upper };
        half[line + x % BLOCK_EDGE]
    });
    Vec4::from_array(row)
}
