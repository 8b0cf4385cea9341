//! From the numbers of a unit to the constants of shift and depth (protocol section 8.2).
//!
//! The formula itself is not here: a recording carries these constants, and who reads recordings has the formula
//! (crate sequence, `ShiftConstants`, which has the same fields).

use crate::blocks::{FixedField, FixedParams};

/// Shifts a pixel: shifts are in quarters of one.
pub const PARAM_COEFFICIENT: f64 = 4.0;
/// What is subtracted from the shift, pixels.
pub const OFFSET_PIXELS: f64 = 0.375;
/// The constant shift of one real camera, pixels, where the block cannot be had.
pub const XTION_CONSTANT_SHIFT: u16 = 200;
const MM_PER_CM: f64 = 10.0;

/// Whether depth uses the reference pattern at its own size or at twice that.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ReferencePattern {
    /// In all other modes.
    #[default]
    OwnSize,
    /// At 60 frames a second, and beside infrared at QVGA: that of VGA.
    Vga,
}

/// Constants of a unit in one mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShiftParameters {
    /// Distance of the reference plane, mm: whole centimetres, since OpenNI2 cuts off the fraction.
    pub zero_plane_mm: f64,
    /// Size of a pixel at the reference plane, mm.
    pub zero_plane_pixel_mm: f64,
    /// Distance from emitter to camera, cm.
    pub emitter_distance_cm: f64,
    /// Shifts a pixel: [`PARAM_COEFFICIENT`].
    pub param_coefficient: f64,
    /// Shift of the reference plane, pixels.
    pub constant_shift: f64,
    /// Pixels of the sensor a pixel of the image.
    pub pixel_size_factor: f64,
    /// What is subtracted from the shift, pixels: [`OFFSET_PIXELS`].
    pub offset_pixels: f64,
}

impl ShiftParameters {
    /// Of the fixed parameters and the block "depth info"; `None` where a length is no positive number or the
    /// reference plane is nearer than 1 cm.
    pub fn new(
        fixed: &FixedParams,
        constant_shift: u16,
        pattern: ReferencePattern,
    ) -> Option<Self> {
        let length = |field| {
            let length_cm = fixed.length_cm(field);
            (length_cm > 0.0 && length_cm.is_finite()).then_some(f64::from(length_cm))
        };
        let zero_plane_cm = length(FixedField::ZeroPlaneDistance)?;
        // The cast cuts off the fraction; what is beyond 2³² is no distance.
        let whole_cm = zero_plane_cm as u32;
        if whole_cm == 0 || whole_cm == u32::MAX {
            return None;
        }
        Some(Self {
            zero_plane_mm: MM_PER_CM * f64::from(whole_cm),
            zero_plane_pixel_mm: MM_PER_CM * length(FixedField::ZeroPlanePixel)?,
            emitter_distance_cm: length(FixedField::EmitterDistance)?,
            param_coefficient: PARAM_COEFFICIENT,
            constant_shift: f64::from(constant_shift),
            pixel_size_factor: match pattern {
                ReferencePattern::OwnSize => 1.0,
                ReferencePattern::Vga => 2.0,
            },
            offset_pixels: OFFSET_PIXELS,
        })
    }

    /// Focal length at VGA as the unit's numbers have it, pixels; nominal, for colour too: a rig is calibrated.
    pub fn vga_focal_pixels(&self) -> f64 {
        self.zero_plane_mm / (2.0 * self.zero_plane_pixel_mm)
    }
}
