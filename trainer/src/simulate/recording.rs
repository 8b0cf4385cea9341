//! Frames of a film as a recording in raw form: shifts and a colour mosaic.

use std::path::Path;

use effects::Effect;
use rayon::prelude::*;
use scene::Film;
use scene::film::GAMMA;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, DepthSamples,
    Description, Device, FileId, FramePose, FrameTimes, RecordingWriter, ResponseCurve,
    ShiftConstants, Split, StreamTiming, Streams, VignettingCurve,
};

use crate::import::POSE_SET;

/// Frames a second.
const RATE_HZ: f64 = 10.0;
/// Time from frame to frame.
const FRAME_NANOS: i64 = 100_000_000;
/// Frames that are filmed before they are written.
const BATCH: u32 = 4;
/// What the recording says made it.
const WRITER: &str = concat!("glint simulate ", env!("CARGO_PKG_VERSION"));

/// The cameras as a recording describes them. An effect that is off is a camera without it.
pub(crate) fn streams(film: &Film) -> anyhow::Result<Streams> {
    let (color, depth) = (film.color(), film.depth());
    let response = if film.effects().contains(Effect::Response) {
        ResponseCurve::Gamma { gamma: GAMMA }
    } else {
        ResponseCurve::Identity
    };
    let vignetting = if film.effects().contains(Effect::Vignetting) {
        let center = [color.intrinsics.width(), color.intrinsics.height()]
            .map(|size| 0.5 * f64::from(size - 1));
        VignettingCurve::EvenPolynomial {
            center,
            radius: f64::hypot(center[0], center[1]),
            a: film.design().vignetting_terms(),
        }
    } else {
        VignettingCurve::None
    };
    let mut depth_camera =
        DepthCamera::new(depth.intrinsics, 0.001, depth.nearest..=depth.farthest)?;
    depth_camera.samples = DepthSamples::Codes;
    depth_camera.shift = Some(ShiftConstants {
        zero_plane_mm: depth.shift.zero_plane_mm,
        zero_plane_pixel_mm: depth.shift.zero_plane_pixel_mm,
        emitter_distance_cm: 0.1 * depth.shift.emitter_distance_mm,
        param_coefficient: depth.shift.coefficient,
        constant_shift: depth.shift.constant_shift,
        pixel_size_factor: 1.0,
        offset_pixels: depth.shift.offset_pixels,
        table_mm: Vec::new(),
    });
    Ok(Streams {
        depth: depth_camera,
        color: ColorCamera::new(
            color.intrinsics,
            ColorEncoding::BayerGrbg,
            1.0,
            response,
            vignetting,
        )?,
        color_from_depth: film.color_from_depth(),
        depth_timing: StreamTiming::at_rate(RATE_HZ),
        color_timing: StreamTiming::at_rate(RATE_HZ),
        device: Some(Device {
            name: format!("simulated {}", film.design().name),
            ..Device::default()
        }),
    })
}

/// Films all frames into a recording in raw form, with the poses of the film and its split; the recording's length in
/// bytes. `identity` says what was filmed: the same words are the same recording. `progress(done, of)` is called as
/// frames are written; the file has no name before it is complete.
///
/// # Errors
/// What the disk refuses, and an output that is there.
pub fn write_recording(
    film: &Film,
    identity: &str,
    output: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<u64> {
    let streams = streams(film)?;
    let description = Description {
        writer: WRITER.to_owned(),
        // Nothing was filmed now: the same scene is the same file at any time of day.
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let id = FileId::of_content(&[WRITER.as_bytes(), identity.as_bytes()]);
    let mut writer = RecordingWriter::create_beside(output, id, &description)?;
    let set = writer.begin_poses(POSE_SET, WRITER, DEPTH_STREAM)?;
    writer.write_split(&split_of(film))?;
    let mut depth_encoder = DepthStreamEncoder::new(&streams, DepthCodec::Fast)?;
    let mut color_encoder = ColorStreamEncoder::new(&streams)?;
    let count = film.frame_count();
    for first in (0..count).step_by(BATCH as usize) {
        crate::interrupt::check()?;
        let numbers: Vec<u32> = (first..count.min(first + BATCH)).collect();
        let frames: Vec<_> = numbers.par_iter().map(|&n| film.frame(n)).collect();
        for (&number, frame) in numbers.iter().zip(frames) {
            let nanos = i64::from(number) * FRAME_NANOS;
            let times = FrameTimes {
                number: u64::from(number),
                device_nanos: nanos,
                ..FrameTimes::default()
            };
            let (payload, table) = depth_encoder.encode(frame.shifts.pixels())?;
            if let Some(table) = table {
                writer.write_table(DEPTH_STREAM, table)?;
            }
            writer.write_frame(DEPTH_STREAM, &times, payload)?;
            let payload = color_encoder.encode(frame.mosaic.pixels())?;
            writer.write_frame(COLOR_STREAM, &times, payload)?;
            writer.seal_if_due(nanos)?;
            progress(number as usize + 1, count as usize);
        }
    }
    let poses: Vec<FramePose> = (0..count)
        .map(|number| FramePose::ok(u64::from(number), film.recorded_pose(number)))
        .collect();
    writer.write_poses(set, &poses)?;
    let finished = writer.finish("complete")?;
    anyhow::ensure!(
        finished.lost.is_empty(),
        "{}: the disk reported errors and frames are missing; simulate to another disk",
        output.display()
    );
    Ok(finished.bytes)
}

/// Training frames first, then a gap, then the far end of the path.
pub(super) fn split_of(film: &Film) -> Split {
    let split = film.design().split.scaled(film.frame_count());
    let first_test = split.train + split.gap;
    Split {
        train: (0..split.train).collect(),
        unused: (split.train..first_test).collect(),
        test: (first_test..film.frame_count()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::FilmOptions;
    use scene::sensor::ShiftModel;
    use scene::world::LightQuality;

    fn film() -> Film {
        let options = FilmOptions {
            width: 64,
            quality: LightQuality {
                light_count: 16,
                bounce_count: 1,
            },
            ..FilmOptions::default()
        };
        Film::new("mirror-ball", options).unwrap()
    }

    #[test]
    fn the_recordings_constants_undo_the_sensors_shifts() {
        let constants = streams(&film()).unwrap().depth.shift.unwrap();
        let model = ShiftModel::default();
        for millimetres in [400.0, 600.0, 850.0, 1200.0, 2500.0, 3500.0] {
            let shift = model.shift(millimetres / 1000.0);
            let below = constants.depth_mm(shift.floor() as u16).unwrap();
            let above = constants.depth_mm(shift.ceil() as u16).unwrap();
            // Between the depths of the whole shifts on both sides.
            assert!(
                below <= millimetres + 1e-6 && millimetres <= above + 1e-6,
                "{millimetres}: {below} {above}"
            );
        }
    }
}
