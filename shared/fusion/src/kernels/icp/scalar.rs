//! The specification of the sums.

use super::{
    INLIER_SIGMAS, IcpStep, IcpSums, LEAST_COSINE_SQUARED, ModelPixels, PointTile, Z_NEAR,
};

/// Sums over the points of a tile in their order.
pub(super) fn sum_tile(points: PointTile<'_>, model: ModelPixels<'_>, step: &IcpStep) -> IcpSums {
    let mut sums = IcpSums::ZERO;
    for index in 0..points.x.len() {
        let point = [points.x[index], points.y[index], points.z[index]];
        sum_point(point, points.weight[index], model, step, &mut sums);
    }
    sums
}

fn sum_point(
    point: [f32; 3],
    point_weight: f32,
    model: ModelPixels<'_>,
    step: &IcpStep,
    sums: &mut IcpSums,
) {
    let q: [f32; 3] =
        std::array::from_fn(|row| dot(step.rotation[row], point) + step.translation[row]);
    // NaN fails.
    if !(q[2] > Z_NEAR) {
        return;
    }
    let inverse_z = 1.0 / q[2];
    let column = model.focal[0] * q[0] * inverse_z + (model.center[0] + 0.5);
    let line = model.focal[1] * q[1] * inverse_z + (model.center[1] + 0.5);
    let is_inside =
        column >= 0.0 && column < model.width as f32 && line >= 0.0 && line < model.height as f32;
    if !is_inside {
        return;
    }
    let surfel = &model.surfels[line as usize * model.width + column as usize];
    if !(surfel.weight > 0.0) {
        return;
    }
    sums.met_count += 1;
    let difference = std::array::from_fn(|axis| q[axis] - surfel.position[axis]);
    let along = dot(surfel.normal, q);
    let cosine_squared = along * along / dot(q, q);
    let is_near = dot(difference, difference) <= step.largest_distance * step.largest_distance;
    if !(is_near && cosine_squared >= LEAST_COSINE_SQUARED) {
        return;
    }
    let residual = dot(surfel.normal, difference);
    let base = point_weight * cosine_squared;
    let square = residual * residual * base;
    let scale_squared = step.robust_scale * step.robust_scale;
    let share = scale_squared / (scale_squared + square);
    let weight = base * share * share;
    let arm: [f32; 3] = std::array::from_fn(|axis| q[axis] - step.center[axis]);
    let n = surfel.normal;
    let row = [
        arm[1] * n[2] - arm[2] * n[1],
        arm[2] * n[0] - arm[0] * n[2],
        arm[0] * n[1] - arm[1] * n[0],
        n[0],
        n[1],
        n[2],
    ];
    let mut place = 0;
    for (i, &left) in row.iter().enumerate() {
        let weighted = weight * left;
        for &right in &row[i..] {
            sums.hessian[place] += f64::from(weighted * right);
            place += 1;
        }
        sums.gradient[i] += f64::from(weighted * residual);
    }
    sums.cost += f64::from(1.0 - share);
    sums.pair_count += 1;
    sums.inlier_count += u32::from(square <= INLIER_SIGMAS * INLIER_SIGMAS);
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
