//! The attributes that say what a panorama's texels mean (design.md section 2).

use exr::prelude::attribute::AttributeValue;
use geometry::{DMat3, DVec3, pose};

use super::container::Content;
use crate::error::ImagingError;

/// The axes of every panorama of the house.
pub const PANORAMA_AXES: &str = "x-right y-down z-forward";

const AXES: &str = "glint.axes";
const WORLD_FROM_PANORAMA: &str = "glint.world_from_panorama";
const ORIGIN: &str = "glint.origin";
const RADIUS: &str = "glint.radius";
const GAIN: &str = "glint.gain";

/// Where a panorama stands and in which unit it is. The file holds f32: a rotation to 1e-7, an origin 10 km
/// out to a millimetre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaAttributes {
    /// Rotation of directions, panorama axes to world axes (`glint.world_from_panorama`, 3x3, row by row,
    /// applied to column vectors).
    pub world_from_panorama: DMat3,
    /// Where the panorama was taken, world axes, metres (`glint.origin`).
    pub origin: DVec3,
    /// Distance of what it shows, metres; infinite for a distant map (`glint.radius`).
    pub radius: f64,
    /// The reflectance that the values assume (`glint.gain`).
    pub gain: f64,
}

impl Default for PanoramaAttributes {
    fn default() -> Self {
        Self {
            world_from_panorama: DMat3::IDENTITY,
            origin: DVec3::ZERO,
            radius: f64::INFINITY,
            gain: 1.0,
        }
    }
}

impl PanoramaAttributes {
    /// Refuses a matrix that is no rotation and numbers out of range.
    fn check(&self) -> Result<(), ImagingError> {
        let unusable = |name, reason: String| Err(ImagingError::Attribute { name, reason });
        let matrix = self.world_from_panorama;
        let error = pose::orthogonality_error(matrix);
        // Written so that NaN fails.
        let is_rotation = error <= pose::LARGEST_ORTHOGONALITY_ERROR && matrix.determinant() > 0.0;
        if !is_rotation {
            return unusable(
                WORLD_FROM_PANORAMA,
                format!("no rotation, RᵀR is off by {error}"),
            );
        }
        if !self.origin.is_finite() {
            return unusable(ORIGIN, format!("{} is not finite", self.origin));
        }
        if self.radius.is_nan() || self.radius <= 0.0 {
            return unusable(RADIUS, format!("{} is not above 0", self.radius));
        }
        if !(self.gain.is_finite() && self.gain > 0.0) {
            return unusable(
                GAIN,
                format!("{} is not a finite number above 0", self.gain),
            );
        }
        Ok(())
    }

    pub(super) fn add_to(&self, content: &mut Content) -> Result<(), ImagingError> {
        self.check()?;
        let rows = self
            .world_from_panorama
            .transpose()
            .to_cols_array()
            .map(|v| v as f32);
        let origin = self.origin.as_vec3();
        content.add_attribute(AXES, AttributeValue::Text(PANORAMA_AXES.into()));
        content.add_attribute(WORLD_FROM_PANORAMA, AttributeValue::Matrix3x3(rows));
        content.add_attribute(
            ORIGIN,
            AttributeValue::FloatVec3((origin.x, origin.y, origin.z)),
        );
        content.add_attribute(RADIUS, AttributeValue::F32(self.radius as f32));
        content.add_attribute(GAIN, AttributeValue::F32(self.gain as f32));
        Ok(())
    }

    /// `None` when the file has none of the attributes; an error when one is not what its name promises.
    pub(super) fn found_in(content: &Content) -> Result<Option<Self>, ImagingError> {
        let names = [AXES, WORLD_FROM_PANORAMA, ORIGIN, RADIUS, GAIN];
        if names.iter().all(|name| content.attribute(name).is_none()) {
            return Ok(None);
        }
        let mut found = Self::default();
        match content.attribute(AXES) {
            None => {}
            Some(AttributeValue::Text(text)) if text.eq(PANORAMA_AXES) => {}
            Some(other) => return Err(wrong(AXES, other, PANORAMA_AXES)),
        }
        match content.attribute(WORLD_FROM_PANORAMA) {
            None => {}
            Some(AttributeValue::Matrix3x3(rows)) => {
                found.world_from_panorama =
                    DMat3::from_cols_array(&rows.map(f64::from)).transpose();
            }
            Some(other) => return Err(wrong(WORLD_FROM_PANORAMA, other, "a 3x3 matrix of floats")),
        }
        match content.attribute(ORIGIN) {
            None => {}
            Some(&AttributeValue::FloatVec3((x, y, z))) => {
                found.origin = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
            }
            Some(other) => return Err(wrong(ORIGIN, other, "three floats")),
        }
        if let Some(radius) = number_of(content, RADIUS)? {
            found.radius = radius;
        }
        if let Some(gain) = number_of(content, GAIN)? {
            found.gain = gain;
        }
        found.check()?;
        Ok(Some(found))
    }
}

fn number_of(content: &Content, name: &'static str) -> Result<Option<f64>, ImagingError> {
    match content.attribute(name) {
        None => Ok(None),
        Some(&AttributeValue::F32(value)) => Ok(Some(f64::from(value))),
        Some(&AttributeValue::F64(value)) => Ok(Some(value)),
        Some(other) => Err(wrong(name, other, "a number")),
    }
}

fn wrong(name: &'static str, got: &AttributeValue, expected: &str) -> ImagingError {
    ImagingError::Attribute {
        name,
        reason: format!("expected {expected}, got {got:?}"),
    }
}
