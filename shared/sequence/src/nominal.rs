//! Cameras of which nothing was measured: what their maker says holds for all of them, to be replaced by a calibration.

use geometry::{CameraError, DVec3, Distortion, Intrinsics, Pose};

use crate::cameras::ShiftConstants;

/// Horizontal angle of view of a PrimeSense camera as OpenNI2 reports it, radians.
pub const PRIMESENSE_FIELD_OF_VIEW: f64 = 1.0226;

/// A pinhole at the middle of a sensor of `sensor` columns and rows with square pixels, `field_of_view` radians from its
/// left border to its right one, of which an image of `size` columns and rows is kept from `offset` on.
///
/// # Errors
/// Numbers that make no camera.
pub fn pinhole(
    sensor: [u32; 2],
    field_of_view: f64,
    size: [u32; 2],
    offset: [u32; 2],
) -> Result<Intrinsics, CameraError> {
    let focal = 0.5 * f64::from(sensor[0]) / (0.5 * field_of_view).tan();
    let center = |axis: usize| 0.5 * (f64::from(sensor[axis]) - 1.0) - f64::from(offset[axis]);
    let [width, height] = size;
    Intrinsics::new(
        width,
        height,
        focal,
        focal,
        center(0),
        center(1),
        Distortion::NONE,
    )
}

/// The colour camera of a PrimeSense camera as its depth camera sees it: parallel, `distance_m` metres to the right as
/// they look, so that near things lie further left in colour.
pub fn color_from_depth(distance_m: f64) -> Pose {
    Pose::from_translation(DVec3::new(-distance_m, 0.0, 0.0))
}

impl ShiftConstants {
    /// Whether a sensor with these constants can exist: lengths and factors above 0, all below a million.
    pub fn is_believable(&self) -> bool {
        let is_positive = |value: f64| value > 0.0 && value < 1e6;
        is_positive(self.zero_plane_mm)
            && is_positive(self.zero_plane_pixel_mm)
            && is_positive(self.emitter_distance_cm)
            && is_positive(self.param_coefficient)
            && is_positive(self.pixel_size_factor)
            && self.constant_shift.abs() < 1e6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels: rounding of the focal length of section 8.1 of the protocol.
    const FOCAL_BOUND: f64 = 0.05;

    #[test]
    fn a_primesense_camera_has_the_focal_length_that_openni_says() {
        let whole = pinhole([640, 480], PRIMESENSE_FIELD_OF_VIEW, [640, 480], [0, 0]).unwrap();
        assert!((whole.focal().x - 570.34).abs() < FOCAL_BOUND);
        let center = whole.center();
        assert_eq!((center.x, center.y), (319.5, 239.5));
        let part = pinhole([640, 480], PRIMESENSE_FIELD_OF_VIEW, [400, 300], [20, 30]).unwrap();
        let center = part.center();
        assert_eq!((center.x, center.y), (299.5, 209.5));
        assert_eq!(part.focal(), whole.focal());
    }

    #[test]
    fn near_things_lie_further_left_in_colour() {
        let in_color = color_from_depth(0.025).transform_point(DVec3::Z);
        assert_eq!(in_color, DVec3::new(-0.025, 0.0, 1.0));
    }
}
