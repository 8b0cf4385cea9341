//! Rigid transforms in f64.

use glam::{DMat3, DQuat, DVec3, EulerRot};

/// A rigid transform `to_from_from`: rotates, then translates. Metres. Named by both ends at the call
/// site (`world_from_camera`); products read right to left.
///
/// The quaternion is kept at unit length after every composition (hard-cases A05).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    rotation: DQuat,
    translation: DVec3,
}

/// Why numbers do not describe a rigid transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PoseError {
    /// An entry is NaN or infinite.
    NotFinite,
    /// `‖RᵀR − I‖∞` is too large for a rotation, even one that was rounded.
    NotRigid {
        /// Largest absolute entry of `RᵀR − I`.
        orthogonality_error: f64,
    },
    /// The determinant is negative: the matrix mirrors.
    Mirrored,
    /// A quaternion of (nearly) zero length.
    ZeroQuaternion,
}

impl std::fmt::Display for PoseError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotFinite => write!(f, "the pose holds a value that is not a number"),
            Self::NotRigid {
                orthogonality_error,
            } => write!(
                f,
                "the rotation is not orthonormal (largest entry of RtR - I is {orthogonality_error:.3e})"
            ),
            Self::Mirrored => write!(f, "the rotation mirrors (its determinant is negative)"),
            Self::ZeroQuaternion => write!(f, "the quaternion has length zero"),
        }
    }
}

impl std::error::Error for PoseError {}

/// Largest entry of `RᵀR − I` that passes as a rounded rotation and is projected.
///
/// 7-Scenes files are off by 1.8e-4 (measured); a scale of 1 % gives 2e-2 and is refused (A06).
pub const LARGEST_ORTHOGONALITY_ERROR: f64 = 5e-3;

/// Largest component below which a quaternion is rounding noise, not a rotation.
const SHORTEST_QUATERNION: f64 = 1e-9;

impl Pose {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// From a quaternion of any nonzero length and a translation in metres.
    pub fn new(rotation: DQuat, translation: DVec3) -> Result<Self, PoseError> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(PoseError::NotFinite);
        }
        // By the largest component first: the square of a huge length is infinite.
        let largest = rotation
            .to_array()
            .into_iter()
            .map(f64::abs)
            .fold(0.0, f64::max);
        if largest < SHORTEST_QUATERNION {
            return Err(PoseError::ZeroQuaternion);
        }
        let scaled = rotation / largest;
        Ok(Self {
            rotation: scaled / scaled.length(),
            translation,
        })
    }

    /// A pure translation, metres; finite (checked in debug builds only: callers have parsed it).
    pub fn from_translation(translation: DVec3) -> Self {
        debug_assert!(translation.is_finite(), "a translation is finite");
        Self {
            rotation: DQuat::IDENTITY,
            translation,
        }
    }

    /// A pure rotation about `axis` (any nonzero length) by `angle` radians, finite. An axis without
    /// length, or not finite, gives the identity.
    pub fn from_axis_angle(axis: DVec3, angle: f64) -> Self {
        debug_assert!(angle.is_finite(), "an angle is finite");
        let axis = crate::direction::unit(axis).unwrap_or(DVec3::ZERO);
        let rotation = crate::rotation::exp(axis * angle);
        Self {
            rotation,
            translation: DVec3::ZERO,
        }
    }

    /// From a rotation matrix that may carry rounding errors: it is projected onto the nearest rotation.
    ///
    /// Errors when the matrix mirrors, or is farther from orthonormal than
    /// [`LARGEST_ORTHOGONALITY_ERROR`]: that is a scale or a mistake, not rounding.
    pub fn from_matrix(rotation: DMat3, translation: DVec3) -> Result<Self, PoseError> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let orthogonality_error = orthogonality_error(rotation);
        if orthogonality_error > LARGEST_ORTHOGONALITY_ERROR {
            return Err(PoseError::NotRigid {
                orthogonality_error,
            });
        }
        if rotation.determinant() < 0.0 {
            return Err(PoseError::Mirrored);
        }
        Ok(Self {
            rotation: crate::rotation::from_matrix(nearest_rotation(rotation)),
            translation,
        })
    }

    /// The rotation as a unit quaternion.
    pub fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// The translation, metres: the origin of the right space expressed in the left one.
    pub fn translation(&self) -> DVec3 {
        self.translation
    }

    /// The rotation as a matrix.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// `point` of the right space, expressed in the left space.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// `vector` (a direction) of the right space, expressed in the left space.
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The transform the other way round.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// `(z, y, x)` Euler angles in radians, for people.
    pub fn euler_zyx(&self) -> (f64, f64, f64) {
        self.rotation.to_euler(EulerRot::ZYX)
    }
}

impl std::ops::Mul for Pose {
    type Output = Self;

    /// Composition: `a_from_c = a_from_b * b_from_c`.
    fn mul(self, right: Self) -> Self {
        let product = self.rotation * right.rotation;
        // One Newton step towards unit length: exact to rounding for inputs that are nearly unit (A05).
        let rotation = product * ((3.0 - product.length_squared()) * 0.5);
        Self {
            rotation,
            translation: self.rotation * right.translation + self.translation,
        }
    }
}

/// Largest absolute entry of `RᵀR − I`.
pub fn orthogonality_error(rotation: DMat3) -> f64 {
    let difference = rotation.transpose() * rotation - DMat3::IDENTITY;
    difference
        .to_cols_array()
        .iter()
        .fold(0.0, |worst: f64, entry| worst.max(entry.abs()))
}

/// The rotation nearest to `matrix` in the Frobenius norm (polar decomposition by Newton iteration).
///
/// `matrix` must have a positive determinant; converges quadratically.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    let mut rotation = matrix;
    for _ in 0..12 {
        let next = (rotation + rotation.inverse().transpose()) * 0.5;
        let change = orthogonality_error(next);
        rotation = next;
        if change < 1e-15 {
            break;
        }
    }
    rotation
}
