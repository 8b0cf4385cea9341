//! Judging the numbers of a rig file.

use std::path::Path;

use geometry::{Distortion, Intrinsics};

use super::error::ImportError;

/// The numbers of a pinhole camera before they are judged.
pub(crate) struct RawCamera<'a> {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) fx: f64,
    pub(crate) fy: f64,
    pub(crate) cx: f64,
    pub(crate) cy: f64,
    pub(crate) distortion: &'a [f64],
}

/// Names the rig file in every refusal.
pub(crate) struct Judge<'a> {
    pub(crate) path: &'a Path,
}

impl Judge<'_> {
    /// Refuses a number outside `range`, which `expected` says in words.
    pub(crate) fn within(
        &self,
        key: &'static str,
        value: f64,
        range: std::ops::RangeInclusive<f64>,
        expected: &'static str,
    ) -> Result<(), ImportError> {
        if range.contains(&value) {
            return Ok(());
        }
        Err(ImportError::RigValue {
            path: self.path.to_path_buf(),
            key,
            value,
            expected,
        })
    }

    /// Refuses intrinsics that do not fit their image, or a field of view that no RGB-D camera has.
    pub(crate) fn camera(
        &self,
        stream: &'static str,
        raw: RawCamera,
    ) -> Result<Intrinsics, ImportError> {
        let distortion = match *raw.distortion {
            [] => Distortion::NONE,
            [k1, k2, p1, p2, k3] => Distortion { k1, k2, p1, p2, k3 },
            _ => {
                return Err(ImportError::RigValue {
                    path: self.path.to_path_buf(),
                    key: "number of distortion coefficients",
                    value: raw.distortion.len() as f64,
                    expected: "0 or 5 (k1, k2, p1, p2, k3)",
                });
            }
        };
        let RawCamera {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            ..
        } = raw;
        let camera =
            Intrinsics::new(width, height, fx, fy, cx, cy, distortion).map_err(|source| {
                ImportError::Camera {
                    path: self.path.to_path_buf(),
                    stream,
                    source,
                }
            })?;
        let degrees = 2.0 * (0.5 * f64::from(width) / fx).atan().to_degrees();
        if !(25.0..=130.0).contains(&degrees) {
            return Err(ImportError::FieldOfView {
                path: self.path.to_path_buf(),
                stream,
                degrees,
            });
        }
        self.within(
            "fy / fx",
            fy / fx,
            0.8..=1.25,
            "0.8 to 1.25: pixels are nearly square",
        )?;
        let (x, y) = (cx / f64::from(width), cy / f64::from(height));
        self.within(
            "cx / width",
            x,
            0.25..=0.75,
            "0.25 to 0.75: near the middle of the image",
        )?;
        self.within(
            "cy / height",
            y,
            0.25..=0.75,
            "0.25 to 0.75: near the middle of the image",
        )?;
        Ok(camera)
    }
}
