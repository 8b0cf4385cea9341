//! What a recording says of an OpenNI2 device: nominal numbers, to be replaced by a calibration.

use geometry::{Intrinsics, Pose};
use openni2_sys as sys;
use sequence::{
    ColorCamera, ColorEncoding, DepthCamera, DepthSamples, Device as DeviceWords, ResponseCurve,
    ShiftConstants, StreamTiming, Streams, TickClock, VignettingCurve, nominal,
};

use super::library::{Device, Sensor, VideoMode};

/// Farthest depth where the device names none, units.
const USUAL_MOST_DEPTH: i32 = 10_000;
/// Times count microseconds.
const CLOCK: TickClock = TickClock {
    tick_hz: 1_000_000,
    bits: 64,
};

/// Properties of the driver of PrimeSense cameras; whole numbers have 64 bits there.
mod vendor {
    pub(super) const CONST_SHIFT: i32 = 0x1080_1007;
    pub(super) const PIXEL_SIZE_FACTOR: i32 = 0x1080_1008;
    pub(super) const PARAM_COEFF: i32 = 0x1080_100A;
    pub(super) const ZERO_PLANE_DISTANCE: i32 = 0x1080_100C;
    pub(super) const ZERO_PLANE_PIXEL_SIZE: i32 = 0x1080_100D;
    pub(super) const EMITTER_DISTANCE: i32 = 0x1080_100E;
    pub(super) const COLOR_DISTANCE: i32 = 0x1080_100F;
}

/// Constants from shifts to depth, where the driver gives all of them.
pub(super) fn shift_constants(device: &Device) -> Option<ShiftConstants> {
    let whole = |property| device.get_of::<u64>(Sensor::Depth, property);
    let real = |property| device.get_of::<f64>(Sensor::Depth, property);
    let constants = ShiftConstants {
        zero_plane_mm: 10.0 * whole(vendor::ZERO_PLANE_DISTANCE)? as f64,
        zero_plane_pixel_mm: 10.0 * real(vendor::ZERO_PLANE_PIXEL_SIZE)?,
        emitter_distance_cm: real(vendor::EMITTER_DISTANCE)?,
        param_coefficient: whole(vendor::PARAM_COEFF)? as f64,
        constant_shift: whole(vendor::CONST_SHIFT)? as f64,
        pixel_size_factor: whole(vendor::PIXEL_SIZE_FACTOR)? as f64,
        offset_pixels: ShiftConstants::USUAL_OFFSET,
        table_mm: Vec::new(),
    };
    constants.is_believable().then_some(constants)
}

/// The streams of a device in the modes `depth` and `color`. A stream that is not there gets the camera of the other.
///
/// # Errors
/// A device without streams, or with numbers that make no camera.
pub(super) fn streams_of(
    device: &Device,
    depth: Option<VideoMode>,
    color: Option<VideoMode>,
    is_registered: bool,
    uri: &str,
) -> anyhow::Result<Streams> {
    let Some(any) = depth.or(color) else {
        anyhow::bail!("{uri}: OpenNI2 finds neither depth nor colour there");
    };
    let depth_mode = depth.unwrap_or(any);
    let scale = if depth_mode.format == sys::ONI_PIXEL_FORMAT_DEPTH_100_UM {
        1e-4
    } else {
        1e-3
    };
    let most: Option<i32> = device.get_of(Sensor::Depth, sys::ONI_STREAM_PROPERTY_MAX_VALUE);
    let most = most
        .filter(|most| (1..=65_535).contains(most))
        .unwrap_or(USUAL_MOST_DEPTH);
    let mut depth_camera = DepthCamera::new(
        intrinsics(device, Sensor::Depth, depth_mode)?,
        scale,
        0.0..=(f64::from(most) * scale) as f32,
    )?;
    depth_camera.shift = shift_constants(device);
    depth_camera.is_registered = is_registered;
    if depth.is_some() && is_shift(depth_mode) {
        depth_camera.samples = DepthSamples::Codes;
        depth_camera.depth_range = 0.0..=0.001 * USUAL_MOST_DEPTH as f32;
    }
    let color_mode = color.unwrap_or(any);
    let encoding = match color_mode.format {
        _ if color.is_none() => ColorEncoding::Rgb8,
        sys::ONI_PIXEL_FORMAT_YUV422 => ColorEncoding::Uyvy,
        sys::ONI_PIXEL_FORMAT_YUYV => ColorEncoding::Yuyv,
        sys::ONI_PIXEL_FORMAT_JPEG => ColorEncoding::Jpeg,
        // Grey is kept as three equal channels.
        sys::ONI_PIXEL_FORMAT_RGB888 | sys::ONI_PIXEL_FORMAT_GRAY8 => ColorEncoding::Rgb8,
        format => anyhow::bail!("{uri}: colour of pixel format {format} cannot be recorded"),
    };
    let color_camera = ColorCamera::new(
        intrinsics(device, Sensor::Color, color_mode)?,
        encoding,
        1.0,
        ResponseCurve::Identity,
        VignettingCurve::None,
    )?;
    let timing = |mode: Option<VideoMode>| StreamTiming {
        rate_hz: mode.map(|mode| f64::from(mode.fps.max(1))),
        clock: Some(CLOCK),
    };
    let distance_cm: Option<f64> = device.get_of(Sensor::Depth, vendor::COLOR_DISTANCE);
    let distance_cm = distance_cm.filter(|distance| (0.0..100.0).contains(distance));
    Ok(Streams {
        depth: depth_camera,
        color: color_camera,
        color_from_depth: match distance_cm {
            Some(distance_cm) if !is_registered && color.is_some() => {
                nominal::color_from_depth(distance_cm / 100.0)
            }
            _ => Pose::IDENTITY,
        },
        depth_timing: timing(depth),
        color_timing: timing(color),
        device: Some(DeviceWords {
            name: device.name(),
            path: uri.to_owned(),
            ..DeviceWords::default()
        }),
    })
}

/// Whether samples are the sensor's shifts.
fn is_shift(mode: VideoMode) -> bool {
    [
        sys::ONI_PIXEL_FORMAT_SHIFT_9_2,
        sys::ONI_PIXEL_FORMAT_SHIFT_9_3,
    ]
    .contains(&mode.format)
}

/// A pinhole at the middle of the picture.
fn intrinsics(device: &Device, sensor: Sensor, mode: VideoMode) -> anyhow::Result<Intrinsics> {
    let angle: Option<f32> = device.get_of(sensor, sys::ONI_STREAM_PROPERTY_HORIZONTAL_FOV);
    let angle = angle.filter(|angle| (0.1..3.0).contains(angle));
    let angle = angle.map_or(nominal::PRIMESENSE_FIELD_OF_VIEW, f64::from);
    let size = [mode.width, mode.height];
    Ok(nominal::pinhole(size, angle, size, [0, 0])?)
}
