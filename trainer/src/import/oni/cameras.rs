//! The cameras of an `.oni` file, as far as it knows them.

use std::path::Path;

use geometry::{Intrinsics, Pose};
use sequence::{
    ColorCamera, ColorEncoding, DepthCamera, DepthSamples, ResponseCurve, ShiftConstants,
    StreamTiming, Streams, TickClock, VignettingCurve, nominal,
};

use super::container::{OniCodec, OniNode};
use super::properties::{OniPixels, OniShape, Properties};
use crate::import::error::ImportError;

/// Farthest depth where the file names none, mm.
const USUAL_MAX_DEPTH_MM: i64 = 10_000;

/// Times count microseconds.
const CLOCK: TickClock = TickClock {
    tick_hz: 1_000_000,
    bits: 64,
};

/// A node with the shape of its first frame.
#[derive(Clone, Copy)]
pub(super) struct Stream<'a> {
    pub(super) node: &'a OniNode,
    pub(super) shape: OniShape,
}

/// The cameras, nominal, and notes that say so. A stream that is not there gets the camera of the other.
pub(super) fn cameras(
    path: &Path,
    depth: Option<Stream>,
    color: Option<Stream>,
) -> Result<(Streams, Vec<String>), ImportError> {
    let mut notes = vec![
        "cameras are nominal, the colour camera's response and vignetting unknown: give a rig file with --rig".to_owned(),
    ];
    let Some(any) = depth.or(color) else {
        return Err(ImportError::NoFrames {
            path: path.to_path_buf(),
            expected: "depth or colour frames",
        });
    };
    let depth_camera = depth_camera(path, depth.unwrap_or(any))?;
    let color_camera = color_camera(path, color.unwrap_or(any), color.is_some())?;
    let constants = &any.node.properties;
    let is_registered = depth.is_some_and(|depth| is_registered(&depth.node.properties))
        && depth_camera.intrinsics == color_camera.intrinsics;
    let color_from_depth = if is_registered || color.is_none() {
        Pose::IDENTITY
    } else {
        notes.push("depth is taken for not registered, the cameras for parallel".to_owned());
        let distance_cm = constants.number("DCRCDIS").unwrap_or(0.0);
        nominal::color_from_depth(0.01 * distance_cm.clamp(-50.0, 50.0))
    };
    let timing = |stream: Option<Stream>| StreamTiming {
        rate_hz: stream.and_then(|stream| stream.node.properties.rate_hz()),
        clock: Some(CLOCK),
    };
    for (name, stream) in [("depth", depth), ("colour", color)] {
        if stream.is_some_and(|stream| stream.node.properties.is_mirrored()) {
            notes.push(format!(
                "{name} images are mirrored left to right, and are kept so"
            ));
        }
    }
    let streams = Streams {
        depth: DepthCamera {
            is_registered,
            ..depth_camera
        },
        color: color_camera,
        color_from_depth,
        depth_timing: timing(depth),
        color_timing: timing(color),
        device: None,
    };
    Ok((streams, notes))
}

fn is_registered(properties: &Properties) -> bool {
    properties
        .int("AlternativeViewPoint")
        .is_some_and(|on| on != 0)
}

fn intrinsics(path: &Path, stream: Stream, name: &'static str) -> Result<Intrinsics, ImportError> {
    let Stream { node, shape } = stream;
    let angle = node.properties.field_of_view();
    let angle = angle.map_or(nominal::PRIMESENSE_FIELD_OF_VIEW, |[horizontal, _]| {
        horizontal
    });
    let size = [shape.width, shape.height];
    let full_size = node.properties.full_size().unwrap_or(size);
    nominal::pinhole(full_size, angle, size, shape.offset).map_err(|source| ImportError::Camera {
        path: path.to_path_buf(),
        stream: name,
        source,
    })
}

fn depth_camera(path: &Path, stream: Stream) -> Result<DepthCamera, ImportError> {
    let properties = &stream.node.properties;
    let scale = match stream.shape.pixels {
        OniPixels::DepthTenths => 1e-4,
        _ => 1e-3,
    };
    let max_mm = properties
        .int("xnDeviceMaxDepth")
        .filter(|max| (1..=65_535).contains(max))
        .unwrap_or(USUAL_MAX_DEPTH_MM);
    let farthest = 1e-3 * max_mm as f32;
    let mut camera = DepthCamera::new(intrinsics(path, stream, "depth")?, scale, 0.0..=farthest)
        .map_err(|source| description(path, source))?;
    camera.shift = properties
        .shift_constants()
        .filter(ShiftConstants::is_believable);
    if stream.shape.pixels == OniPixels::Shifts {
        if camera.shift.is_none() {
            return Err(ImportError::Oni {
                path: path.to_path_buf(),
                what: "depth".to_owned(),
                source: super::OniDamage::NoShape,
            });
        }
        camera.samples = DepthSamples::Codes;
    }
    Ok(camera)
}

fn color_camera(path: &Path, stream: Stream, is_color: bool) -> Result<ColorCamera, ImportError> {
    let encoding = match stream.shape.pixels {
        _ if !is_color => ColorEncoding::Rgb8,
        OniPixels::Uyvy => ColorEncoding::Uyvy,
        OniPixels::Yuyv => ColorEncoding::Yuyv,
        _ if stream.node.codec == OniCodec::Jpeg => ColorEncoding::Jpeg,
        _ => ColorEncoding::Rgb8,
    };
    if let Some(format) = encoding.lossless() {
        let size = format.frame_bytes(stream.shape.width, stream.shape.height);
        size.map_err(|error| description(path, error.into()))?;
    }
    ColorCamera::new(
        intrinsics(path, stream, "color")?,
        encoding,
        1.0,
        ResponseCurve::Identity,
        VignettingCurve::None,
    )
    .map_err(|source| description(path, source))
}

fn description(path: &Path, source: sequence::SequenceError) -> ImportError {
    ImportError::Description {
        path: path.to_path_buf(),
        source,
    }
}
