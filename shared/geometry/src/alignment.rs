//! Rigid alignment of two paths and the trajectory error after it.

use crate::pose::Pose;
use crate::svd::signed_svd;
use glam::{DMat3, DQuat, DVec3};

/// Fewest pairs that are aligned: 6 fitted degrees of freedom hide a share of the error, at 10 pairs a
/// tenth, at 3 pairs half of it (hard-cases L06).
pub const FEWEST_PAIRS: usize = 10;

/// Ratio of the second to the first singular value of the covariance below which a path is a line: its
/// sideways deviation is then under 3 % of its length and says nothing certain about the turn about it.
pub const LINE_RATIO: f64 = 1e-3;

/// Root mean square distance from its centre, metres, below which a path stands still: the jitter of a
/// tracker at rest reaches 3 mm per axis, and a rotation fitted to that is arbitrary.
pub const STATIONARY_SPREAD: f64 = 5e-3;

/// How much of a rigid transform two paths determine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AlignmentRank {
    /// A path that stands still: the translation alone (3 degrees of freedom).
    Point,
    /// A straight path: all but the turn about it (5 degrees of freedom).
    Line,
    /// A path in a plane or in space: everything (6 degrees of freedom).
    Full,
}

impl AlignmentRank {
    /// Degrees of freedom that the alignment took from the data.
    pub fn degrees_of_freedom(self) -> u32 {
        match self {
            Self::Point => 3,
            Self::Line => 5,
            Self::Full => 6,
        }
    }
}

impl std::fmt::Display for AlignmentRank {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Point => "point",
            Self::Line => "line",
            Self::Full => "full",
        })
    }
}

/// Why two paths cannot be aligned.
#[derive(Clone, Debug, PartialEq)]
pub enum AlignmentError {
    /// The lists pair up by index and must be equally long.
    Length {
        /// Positions of the reference.
        reference: usize,
        /// Positions of the estimate.
        estimate: usize,
    },
    /// Fewer than [`FEWEST_PAIRS`] pairs.
    TooFew {
        /// Pairs given.
        count: usize,
    },
    /// A position is NaN, infinite, or so large that its square is.
    NotFinite {
        /// Index of the first such pair.
        index: usize,
    },
}

impl std::fmt::Display for AlignmentError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Length {
                reference,
                estimate,
            } => {
                write!(
                    f,
                    "{reference} reference positions cannot be paired with {estimate} estimates"
                )
            }
            Self::TooFew { count } => {
                write!(
                    f,
                    "{count} tracked poses are too few to align, at least {FEWEST_PAIRS} are needed"
                )
            }
            Self::NotFinite { index } => write!(f, "position {index} is not a usable number"),
        }
    }
}

impl std::error::Error for AlignmentError {}

/// The rigid transform that brings an estimate nearest to a reference in the sum of squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidAlignment {
    /// Takes estimated positions to the reference, metres.
    pub reference_from_estimate: Pose,
    /// What the paths determine; the rest is left as it was, not invented.
    pub rank: AlignmentRank,
    /// Signed singular values of the covariance, m²; the third is negative when the paths mirror each other.
    pub singular_values: DVec3,
    /// Root mean square distance after alignment, metres.
    pub rmse: f64,
    /// Number of pairs.
    pub count: usize,
}

/// Aligns `estimate` to `reference`, paired by index, by rotation and translation without scale
/// (Umeyama 1991 with scale 1; a mirror image gets the best proper rotation).
///
/// A straight path takes the shortest turn from one line to the other, and a path that stands still none:
/// their rank says so (hard-cases L05). Fewer than [`FEWEST_PAIRS`] pairs are refused (L06).
pub fn align_rigid(
    reference: &[DVec3],
    estimate: &[DVec3],
) -> Result<RigidAlignment, AlignmentError> {
    let count = reference.len();
    if count != estimate.len() {
        return Err(AlignmentError::Length {
            reference: count,
            estimate: estimate.len(),
        });
    }
    if count < FEWEST_PAIRS {
        return Err(AlignmentError::TooFew { count });
    }
    let pairs = || reference.iter().copied().zip(estimate.iter().copied());
    if let Some(index) = pairs().position(|(r, e)| !is_usable(r) || !is_usable(e)) {
        return Err(AlignmentError::NotFinite { index });
    }
    let (reference_center, estimate_center) = (mean(reference), mean(estimate));
    let mut covariance = DMat3::ZERO;
    let (mut reference_square, mut estimate_square) = (0.0, 0.0);
    for (r, e) in pairs() {
        let (r, e) = (r - reference_center, e - estimate_center);
        covariance += DMat3::from_cols(r * e.x, r * e.y, r * e.z);
        reference_square += r.length_squared();
        estimate_square += e.length_squared();
    }
    let svd = signed_svd(covariance * (1.0 / count as f64));
    let spread = (reference_square.min(estimate_square) / count as f64).sqrt();
    let rank = if spread < STATIONARY_SPREAD {
        AlignmentRank::Point
    } else if svd.values.y <= LINE_RATIO * svd.values.x {
        AlignmentRank::Line
    } else {
        AlignmentRank::Full
    };
    let rotation = match rank {
        AlignmentRank::Point => DQuat::IDENTITY,
        AlignmentRank::Line => shortest_turn(svd.right.x_axis, svd.left.x_axis),
        AlignmentRank::Full => crate::rotation::from_matrix(svd.left * svd.right.transpose()),
    };
    let reference_from_estimate =
        Pose::new(rotation, reference_center - rotation * estimate_center)
            .expect("usable positions give a finite pose");
    let square: f64 = pairs()
        .map(|(r, e)| (r - reference_from_estimate.transform_point(e)).length_squared())
        .sum();
    Ok(RigidAlignment {
        reference_from_estimate,
        rank,
        singular_values: svd.values,
        rmse: (square / count as f64).sqrt(),
        count,
    })
}

/// The error of a trajectory with frames lost, over the same frames for every method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryError {
    /// Root mean square distance of the tracked frames after alignment, metres. Losing the hard frames
    /// improves it: never shown without `tracked_fraction`.
    pub ate_rmse: f64,
    /// The same over all frames, with lost frames held at the last tracked position (frames lost before the
    /// first tracked one at that one), metres (hard-cases L07).
    pub ate_with_lost_at_last_pose: f64,
    /// Tracked frames by all frames, in (0, 1].
    pub tracked_fraction: f64,
    /// What the tracked frames determine of the alignment.
    pub rank: AlignmentRank,
    /// Number of tracked frames, at least [`FEWEST_PAIRS`].
    pub count: usize,
}

/// The absolute trajectory error of `estimate` (camera positions, `None` where lost) against `reference`
/// (one position for every frame), after rigid alignment of the tracked frames.
///
/// Errors when the lists differ in length, hold what is not finite, or fewer than [`FEWEST_PAIRS`] frames
/// are tracked. An index in [`AlignmentError::NotFinite`] counts frames.
pub fn trajectory_error(
    reference: &[DVec3],
    estimate: &[Option<DVec3>],
) -> Result<TrajectoryError, AlignmentError> {
    if reference.len() != estimate.len() {
        return Err(AlignmentError::Length {
            reference: reference.len(),
            estimate: estimate.len(),
        });
    }
    let usable = |(r, e): (&DVec3, &Option<DVec3>)| is_usable(*r) && e.is_none_or(is_usable);
    if let Some(index) = reference
        .iter()
        .zip(estimate)
        .position(|pair| !usable(pair))
    {
        return Err(AlignmentError::NotFinite { index });
    }
    let (tracked_reference, tracked): (Vec<DVec3>, Vec<DVec3>) = reference
        .iter()
        .zip(estimate)
        .filter_map(|(r, e)| Some((*r, (*e)?)))
        .unzip();
    let alignment = align_rigid(&tracked_reference, &tracked)?;
    let mut held = tracked[0];
    let mut square = 0.0;
    for (r, e) in reference.iter().zip(estimate) {
        held = e.unwrap_or(held);
        let aligned = alignment.reference_from_estimate.transform_point(held);
        square += (*r - aligned).length_squared();
    }
    Ok(TrajectoryError {
        ate_rmse: alignment.rmse,
        ate_with_lost_at_last_pose: (square / reference.len() as f64).sqrt(),
        tracked_fraction: alignment.count as f64 / reference.len() as f64,
        rank: alignment.rank,
        count: alignment.count,
    })
}

/// Whether squares of a position and their sums stay finite.
fn is_usable(position: DVec3) -> bool {
    // NaN fails the comparison, component by component.
    position
        .to_array()
        .into_iter()
        .all(|component| component.abs() < 1e100)
}

/// The mean of a list that is not empty; from the first element, so that a far origin costs no digits.
fn mean(points: &[DVec3]) -> DVec3 {
    let first = points[0];
    first + points.iter().map(|p| *p - first).sum::<DVec3>() / points.len() as f64
}

/// The rotation by the smallest angle that takes unit `from` to unit `to`; any half turn where they oppose.
fn shortest_turn(from: DVec3, to: DVec3) -> DQuat {
    match (from + to).try_normalize() {
        // Twice the turn to the vector halfway is exact at small angles, unlike the angle by acos.
        Some(halfway) if (from + to).length() > 1e-8 => {
            let axis = from.cross(halfway);
            DQuat::from_xyzw(axis.x, axis.y, axis.z, from.dot(halfway)).normalize()
        }
        _ => {
            let axis = from.any_orthonormal_vector();
            DQuat::from_xyzw(axis.x, axis.y, axis.z, 0.0)
        }
    }
}
