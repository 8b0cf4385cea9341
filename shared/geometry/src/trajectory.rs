//! Measures of a trajectory beside the absolute error: relative errors, which need no alignment, orientations
//! in the alignment, and the time between two clocks.

use crate::alignment::{AlignmentError, AlignmentRank, FEWEST_PAIRS, RigidAlignment, align_rigid};
use crate::pose::Pose;
use crate::robust;
use crate::rotation::{self, interpolate};
use crate::svd::signed_svd;
use glam::{DMat3, DQuat, DVec3};

/// How a list of errors is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Root mean square.
    pub rmse: f64,
    /// Median.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// The spread of errors in any unit; `None` for no errors, or where one is not a number.
    pub fn of(errors: &[f64]) -> Option<Self> {
        if errors.iter().any(|error| error.is_nan()) {
            return None;
        }
        let median = robust::median(&mut errors.to_vec())?;
        let square: f64 = errors.iter().map(|error| error * error).sum();
        Some(Self {
            rmse: (square / errors.len() as f64).sqrt(),
            median,
            max: errors.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

/// Error of the motion between two poses, over many pairs of poses (Sturm et al. 2012, RPE).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeError {
    /// Root mean square of the translation, metres.
    pub translation_rmse: f64,
    /// Root mean square of the angle, radians.
    pub rotation_rmse: f64,
    /// Pairs.
    pub count: usize,
}

/// The relative error over `pairs` (indices of both lists, which pair up by index); `None` without pairs.
///
/// # Panics
/// When a pair names a pose that does not exist.
pub fn relative_error(
    reference: &[Pose],
    estimate: &[Pose],
    pairs: &[(usize, usize)],
) -> Option<RelativeError> {
    let (mut translation, mut rotation) = (0.0, 0.0);
    for &(from, to) in pairs {
        let expected = reference[from].inverse() * reference[to];
        let found = estimate[from].inverse() * estimate[to];
        let error = expected.inverse() * found;
        translation += error.translation().length_squared();
        rotation += rotation::log(error.rotation()).length_squared();
    }
    let count = pairs.len();
    (count > 0).then(|| RelativeError {
        translation_rmse: (translation / count as f64).sqrt(),
        rotation_rmse: (rotation / count as f64).sqrt(),
        count,
    })
}

/// For every index the one whose time is nearest to `step_nanos` later, where there is one within
/// `tolerance_nanos`. `nanos` rise.
pub fn pairs_by_time(nanos: &[i64], step_nanos: i64, tolerance_nanos: i64) -> Vec<(usize, usize)> {
    let partner = |&from: &i64| {
        let wanted = from.checked_add(step_nanos)?;
        let after = nanos.partition_point(|&time| time < wanted);
        let distance = |&index: &usize| nanos[index].abs_diff(wanted);
        let nearest = [after.checked_sub(1), (after < nanos.len()).then_some(after)]
            .into_iter()
            .flatten()
            .min_by_key(distance)?;
        (distance(&nearest) <= tolerance_nanos.unsigned_abs()).then_some(nearest)
    };
    let pairs = nanos.iter().map(partner).enumerate();
    pairs
        .filter_map(|(from, to)| Some((from, to?)))
        .filter(|(from, to)| from != to)
        .collect()
}

/// For every index the first later one to which the reference has travelled `step` metres, along its path.
pub fn pairs_by_distance(reference: &[Pose], step: f64) -> Vec<(usize, usize)> {
    let mut travelled = Vec::with_capacity(reference.len());
    let mut sum = 0.0;
    for (index, pose) in reference.iter().enumerate() {
        if let Some(before) = index.checked_sub(1) {
            sum += (pose.translation() - reference[before].translation()).length();
        }
        travelled.push(sum);
    }
    let partner = |from: usize| {
        let wanted = travelled[from] + step;
        let to = travelled.partition_point(|&length| length < wanted);
        (to < travelled.len() && to > from).then_some((from, to))
    };
    (0..reference.len()).filter_map(partner).collect()
}

/// The rotation that brings the orientations of `estimate` nearest to those of `reference` in the sum of
/// squares (chordal); `None` for no poses or where they contradict each other so much that none is nearest.
pub fn mean_rotation(pairs: impl IntoIterator<Item = (DQuat, DQuat)>) -> Option<DQuat> {
    let mut sum = DMat3::ZERO;
    for (reference, estimate) in pairs {
        sum += DMat3::from_quat(reference * estimate.conjugate());
    }
    let svd = signed_svd(sum);
    // Where the second and third values cancel, a half turn is as good (Markley et al. 2007).
    let is_clear = svd.values.y + svd.values.z > 1e-6 * svd.values.x && svd.values.x > 0.0;
    is_clear.then(|| rotation::from_matrix(svd.left * svd.right.transpose()))
}

/// An alignment of poses: positions, and orientations where positions leave something open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseAlignment {
    /// Takes estimated poses to the reference.
    pub reference_from_estimate: Pose,
    /// What the positions determine.
    pub rank: AlignmentRank,
    /// Whether the rotation is that of the orientations, because the positions do not determine it.
    pub is_by_orientation: bool,
    /// Angle between the rotation that the positions give and that of the orientations, radians: how far the
    /// two disagree; `None` where one of them says nothing.
    pub disagreement: Option<f64>,
}

/// Aligns poses, paired by index, without scale: by their positions ([`align_rigid`]); where these form a line
/// or a point, the rotation is the mean of the orientations instead.
///
/// # Errors
/// As [`align_rigid`].
pub fn align_poses(reference: &[Pose], estimate: &[Pose]) -> Result<PoseAlignment, AlignmentError> {
    let positions =
        |poses: &[Pose]| -> Vec<DVec3> { poses.iter().map(Pose::translation).collect() };
    let (reference_positions, estimate_positions) = (positions(reference), positions(estimate));
    let RigidAlignment {
        reference_from_estimate,
        rank,
        ..
    } = align_rigid(&reference_positions, &estimate_positions)?;
    let pairs = reference.iter().zip(estimate);
    let by_orientation = mean_rotation(pairs.map(|(r, e)| (r.rotation(), e.rotation())));
    let alignment = PoseAlignment {
        reference_from_estimate,
        rank,
        is_by_orientation: false,
        disagreement: None,
    };
    let Some(rotation) = by_orientation else {
        return Ok(alignment);
    };
    if rank == AlignmentRank::Full {
        let difference = reference_from_estimate.rotation() * rotation.conjugate();
        return Ok(PoseAlignment {
            disagreement: Some(rotation::log(difference).length()),
            ..alignment
        });
    }
    let offsets = reference_positions
        .iter()
        .zip(&estimate_positions)
        .map(|(r, e)| *r - rotation * *e);
    let translation = offsets.sum::<DVec3>() / reference.len() as f64;
    let found = Pose::new(rotation, translation);
    Ok(
        found.map_or(alignment, |reference_from_estimate| PoseAlignment {
            reference_from_estimate,
            is_by_orientation: true,
            ..alignment
        }),
    )
}

/// How [`fit_time_offset`] searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffsetSearch {
    /// Offsets from minus this to plus this, nanoseconds.
    pub reach_nanos: i64,
    /// Distance of the offsets that are tried first, nanoseconds: between neighbours of the best one, the error
    /// must have one minimum.
    pub grid_nanos: i64,
    /// Time between the two poses of a motion, nanoseconds.
    pub step_nanos: i64,
    /// How far that time may be missed, nanoseconds.
    pub tolerance_nanos: i64,
    /// Poses of the reference further apart are not interpolated, nanoseconds.
    pub largest_gap_nanos: i64,
    /// Width at which the search ends, nanoseconds.
    pub resolution_nanos: i64,
}

impl Default for OffsetSearch {
    /// 0.2 s either way in steps of 5 ms, motions of 1 s (20 ms more or less), gaps up to 100 ms, to 0.05 ms.
    fn default() -> Self {
        Self {
            reach_nanos: 200_000_000,
            grid_nanos: 5_000_000,
            step_nanos: 1_000_000_000,
            tolerance_nanos: 20_000_000,
            largest_gap_nanos: 100_000_000,
            resolution_nanos: 50_000,
        }
    }
}

/// The time between two clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOffset {
    /// Reference time less estimate time, nanoseconds.
    pub offset_nanos: i64,
    /// Relative rotation error there, radians.
    pub rotation_rmse: f64,
    /// Relative rotation error without an offset, radians.
    pub rotation_rmse_at_zero: f64,
    /// Pairs.
    pub count: usize,
}

/// The least share by which the worst offset must be worse than the best one: below, the rotation is too slow
/// or too even to tell the time.
const LEAST_CONTRAST: f64 = 1.1;

/// The constant offset between the clocks of two timed paths that makes their relative rotations most alike: a
/// scan, then golden section around its best. Both rise in time.
///
/// Every offset is judged by the same pairs, those that the reference covers at all of them. `None` with fewer
/// than [`FEWEST_PAIRS`] of these, or where the rotation does not tell.
pub fn fit_time_offset(
    reference: &[(i64, Pose)],
    estimate: &[(i64, Pose)],
    search: &OffsetSearch,
) -> Option<TimeOffset> {
    let reach = search.reach_nanos.max(0);
    let grid = search.grid_nanos.max(1);
    let offsets: Vec<i64> = (-(reach / grid)..=reach / grid).map(|k| k * grid).collect();
    let at = |time: i64| reference_at(reference, time, search.largest_gap_nanos);
    let covered: Vec<(i64, Pose)> = estimate
        .iter()
        .filter(|(time, _)| {
            let mut times = offsets.iter().map(|offset| time.saturating_add(*offset));
            times.all(|time| at(time).is_some())
        })
        .copied()
        .collect();
    let nanos: Vec<i64> = covered.iter().map(|(time, _)| *time).collect();
    let pairs = pairs_by_time(&nanos, search.step_nanos, search.tolerance_nanos);
    if pairs.len() < FEWEST_PAIRS {
        return None;
    }
    let error = |offset: i64| -> f64 {
        let (mut square, mut count) = (0.0, 0_usize);
        for &(from, to) in &pairs {
            let ((time_a, a), (time_b, b)) = (covered[from], covered[to]);
            let found = a.rotation().conjugate() * b.rotation();
            if let (Some(a), Some(b)) = (
                at(time_a.saturating_add(offset)),
                at(time_b.saturating_add(offset)),
            ) {
                let expected = a.rotation().conjugate() * b.rotation();
                square += rotation::log(expected.conjugate() * found).length_squared();
                count += 1;
            }
        }
        if count == 0 {
            return f64::INFINITY;
        }
        (square / count as f64).sqrt()
    };
    let errors: Vec<f64> = offsets.iter().map(|&offset| error(offset)).collect();
    let best = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]))?;
    let worst = errors.iter().copied().fold(0.0, f64::max);
    if worst < LEAST_CONTRAST * errors[best] || worst < 1e-6 {
        return None;
    }
    let around = offsets[best];
    let (offset_nanos, rotation_rmse) =
        golden_section(error, around - grid, around + grid, search.resolution_nanos);
    Some(TimeOffset {
        offset_nanos,
        rotation_rmse,
        rotation_rmse_at_zero: error(0),
        count: pairs.len(),
    })
}

/// The pose of a timed path at a time.
fn reference_at(reference: &[(i64, Pose)], time: i64, largest_gap_nanos: i64) -> Option<Pose> {
    let after = reference.partition_point(|(t, _)| *t < time);
    let next = *reference.get(after)?;
    if next.0 == time {
        return Some(next.1);
    }
    interpolate(
        *reference.get(after.checked_sub(1)?)?,
        next,
        time,
        largest_gap_nanos,
    )
}

/// Where a function with one minimum between `low` and `high` has it, to `resolution`, and its value there.
fn golden_section(f: impl Fn(i64) -> f64, low: i64, high: i64, resolution: i64) -> (i64, f64) {
    const RATIO: f64 = 0.618_033_988_749_894_8;
    let (mut low, mut high) = (low as f64, high as f64);
    let value = |x: f64| f(x.round() as i64);
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    while high - low > resolution.max(1) as f64 {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - RATIO * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + RATIO * (high - low);
            at_b = value(b);
        }
    }
    if at_a <= at_b {
        (a.round() as i64, at_a)
    } else {
        (b.round() as i64, at_b)
    }
}
