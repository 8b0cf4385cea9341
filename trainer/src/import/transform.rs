//! The extrinsic as a rig file writes it.

use std::fmt;
use std::path::Path;

use geometry::{DQuat, DVec3, Pose};
use serde::de::{MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Serialize};

use super::error::ImportError;
use super::judge::Judge;

/// `"identity"`, or a table with `rotation` (unit quaternion x, y, z, w) and `translation` (metres).
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct RigTransform {
    rotation: [f64; 4],
    translation: [f64; 3],
}

const IDENTITY_ROTATION: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// Largest deviation from length 1 of a quaternion that was rounded when it was written.
pub(crate) const LARGEST_QUATERNION_ERROR: f64 = 1e-2;

impl RigTransform {
    /// A transform as a rig file writes it, every number to its last bit.
    pub(crate) fn of(pose: &Pose) -> Self {
        // Inverses bring -0; it is the same number and reads badly.
        Self {
            rotation: pose.rotation().to_array().map(|value| value + 0.0),
            translation: pose.translation().to_array().map(|value| value + 0.0),
        }
    }

    /// The transform, judged: a unit quaternion and cameras less than a metre apart.
    pub(crate) fn pose(&self, path: &Path) -> Result<Pose, ImportError> {
        let rotation = DQuat::from_array(self.rotation);
        let translation = DVec3::from_array(self.translation);
        let judge = Judge { path };
        judge.within(
            "length of the extrinsic's rotation",
            rotation.length(),
            1.0 - LARGEST_QUATERNION_ERROR..=1.0 + LARGEST_QUATERNION_ERROR,
            "1: a unit quaternion x, y, z, w",
        )?;
        // Cameras a metre apart are no RGB-D camera: millimetres were written.
        judge.within(
            "length of the extrinsic's translation",
            translation.length(),
            0.0..=1.0,
            "at most 1 metre",
        )?;
        Pose::new(rotation, translation).map_err(|source| ImportError::Pose {
            path: path.to_path_buf(),
            line: None,
            source,
        })
    }
}

impl<'de> Deserialize<'de> for RigTransform {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TransformVisitor)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformNumbers {
    rotation: Option<[f64; 4]>,
    translation: Option<[f64; 3]>,
}

struct TransformVisitor;

impl<'de> Visitor<'de> for TransformVisitor {
    type Value = RigTransform;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("\"identity\" or a table with rotation = [x, y, z, w] and translation = [x, y, z] in metres")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<RigTransform, E> {
        if text != "identity" {
            return Err(E::invalid_value(serde::de::Unexpected::Str(text), &self));
        }
        Ok(RigTransform {
            rotation: IDENTITY_ROTATION,
            translation: [0.0; 3],
        })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RigTransform, A::Error> {
        let numbers = TransformNumbers::deserialize(MapAccessDeserializer::new(map))?;
        Ok(RigTransform {
            rotation: numbers.rotation.unwrap_or(IDENTITY_ROTATION),
            translation: numbers.translation.unwrap_or_default(),
        })
    }
}
