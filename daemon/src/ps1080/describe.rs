//! What a recording says of a camera: nominal numbers of the unit, to be replaced by a calibration.

use std::ops::RangeInclusive;

use geometry::{Intrinsics, Pose};
use ps1080::blocks::FixedField;
use ps1080::color::ColorFormat;
use ps1080::mode::Resolution;
use ps1080::shift::ShiftParameters;
use sequence::{
    ColorCamera, ColorEncoding, DepthCamera, DepthSamples, Device, ResponseCurve, ShiftConstants,
    StreamTiming, Streams, TickClock, VignettingCurve, YuvMeaning,
};

use crate::ps1080::modes::{ImageMode, Plan};
use crate::ps1080::open::Unit;

/// Width of the picture that the focal length is given for, pixels.
const VGA_WIDTH: f64 = 640.0;
/// Bits of the camera's counter.
const TICK_BITS: u32 = 32;
/// Metres a unit of a table in mm.
const MILLIMETRE: f64 = 0.001;

/// The streams of `unit` as `plan` has them. `path` says where it is plugged in.
///
/// # Errors
/// Numbers of the unit that make no camera.
pub(super) fn streams_of(
    unit: &Unit,
    plan: &Plan,
    product: &str,
    path: &str,
) -> anyhow::Result<Streams> {
    let numbers = |what| crate::ps1080::CameraError::Numbers { what };
    let wanted = &plan.wanted;
    let shift = ShiftParameters::new(&unit.fixed, unit.constant_shift, plan.pattern())
        .ok_or_else(|| numbers("fixed parameters"))?;
    let intrinsics = |resolution: Resolution| nominal(resolution, shift.vga_focal_pixels());
    let constants = constants_of(&shift);
    let range = range_of(&constants.computed_table_mm());
    let range = range.ok_or_else(|| numbers("table of depth"))?;
    let mut depth = DepthCamera::new(intrinsics(wanted.depth_resolution)?, MILLIMETRE, range)?;
    depth.samples = DepthSamples::Codes;
    depth.shift = Some(constants);
    depth.is_registered = wanted.is_registered;
    let mut color = ColorCamera::new(
        intrinsics(wanted.color_resolution)?,
        encoding_of(plan.image),
        1.0,
        ResponseCurve::Identity,
        VignettingCurve::None,
    )?;
    if matches!(color.encoding, ColorEncoding::Uyvy | ColorEncoding::Yuyv) {
        // As protocol section 7.5 turns it into RGB.
        color.yuv = Some(YuvMeaning {
            matrix: "bt601".to_owned(),
            range: "limited".to_owned(),
            siting: "left".to_owned(),
        });
    }
    let timing = StreamTiming {
        rate_hz: Some(f64::from(wanted.fps)),
        clock: Some(TickClock {
            tick_hz: unit.tick_rate.hz(),
            bits: TICK_BITS,
        }),
    };
    Ok(Streams {
        depth,
        color,
        color_from_depth: color_from_depth(unit, plan),
        depth_timing: timing,
        color_timing: timing,
        device: Some(Device {
            name: if unit.name.is_empty() {
                product.to_owned()
            } else {
                format!("{product} ({})", unit.name)
            },
            serial: unit.serial.clone(),
            firmware: format!("{} ({:?})", unit.firmware(), unit.version.hardware()),
            path: path.to_owned(),
        }),
    })
}

/// A pinhole at the middle of the picture; the focal length goes with the width.
fn nominal(resolution: Resolution, vga_focal_pixels: f64) -> anyhow::Result<Intrinsics> {
    let (width, height) = resolution.size();
    let focal = vga_focal_pixels * f64::from(width) / VGA_WIDTH;
    let middle = |count: u16| (f64::from(count) - 1.0) / 2.0;
    Ok(Intrinsics::pinhole(
        width.into(),
        height.into(),
        focal,
        focal,
        middle(width),
        middle(height),
    )?)
}

fn constants_of(shift: &ShiftParameters) -> ShiftConstants {
    ShiftConstants {
        zero_plane_mm: shift.zero_plane_mm,
        zero_plane_pixel_mm: shift.zero_plane_pixel_mm,
        emitter_distance_cm: shift.emitter_distance_cm,
        param_coefficient: shift.param_coefficient,
        constant_shift: shift.constant_shift,
        pixel_size_factor: shift.pixel_size_factor,
        offset_pixels: shift.offset_pixels,
        table_mm: Vec::new(),
    }
}

/// Depths of a table, metres, half a millimetre more on either side.
fn range_of(table_mm: &[u16]) -> Option<RangeInclusive<f32>> {
    let depths = || table_mm.iter().copied().filter(|depth| *depth > 0);
    let (near, far) = (depths().min()?, depths().max()?);
    Some((f32::from(near) - 0.5) / 1e3..=(f32::from(far) + 0.5) / 1e3)
}

/// The colour camera sits to the right of the depth camera, towards the emitter, as seen from behind them; registered
/// depth is seen from the colour camera, and infrared is what the depth camera sees.
fn color_from_depth(unit: &Unit, plan: &Plan) -> Pose {
    let distance_cm = f64::from(unit.fixed.length_cm(FixedField::ColorDistance));
    let is_one_view = plan.wanted.is_registered || plan.image == ImageMode::Infrared;
    if is_one_view || !(0.0..100.0).contains(&distance_cm) {
        return Pose::IDENTITY;
    }
    sequence::nominal::color_from_depth(distance_cm / 100.0)
}

fn encoding_of(image: ImageMode) -> ColorEncoding {
    let ImageMode::Color(format) = image else {
        return ColorEncoding::Infrared10;
    };
    match format {
        ColorFormat::CompressedBayer | ColorFormat::Bayer => ColorEncoding::BayerGrbg,
        ColorFormat::CompressedYuv422 | ColorFormat::Uyvy => ColorEncoding::Uyvy,
        ColorFormat::Yuyv => ColorEncoding::Yuyv,
        ColorFormat::Jpeg | ColorFormat::Jpeg420 | ColorFormat::JpegMono => ColorEncoding::Jpeg,
    }
}
