//! Recordings of tiny frames with any pose sets: only their times and poses matter.

use std::path::Path;

use geometry::{DVec3, Intrinsics, Pose, rotation};
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FramePose, FrameTimes, PoseState, RecordingWriter, ResponseCurve, StreamTiming,
    Streams, VignettingCurve,
};

pub(crate) const FRAME_NANOS: i64 = 33_333_333;
/// Where the colour camera stands.
pub(crate) const BASELINE: DVec3 = DVec3::new(-0.025, 0.0, 0.0);

/// A hand-held path at a time in seconds.
pub(crate) fn swinging(seconds: f64) -> Pose {
    let position = DVec3::new(
        0.4 * (1.3 * seconds).sin(),
        0.2 * (2.1 * seconds).cos(),
        0.3 * (0.7 * seconds).sin(),
    );
    let turn = DVec3::new(
        0.5 * (2.9 * seconds).sin(),
        0.4 * (1.7 * seconds + 0.3).sin(),
        0.2 * (3.7 * seconds).cos(),
    );
    Pose::new(rotation::exp(turn), position).unwrap()
}

/// The path at every frame.
pub(crate) fn swinging_frames(count: usize) -> Vec<Pose> {
    (0..count as i64)
        .map(|index| swinging((index * FRAME_NANOS) as f64 * 1e-9))
        .collect()
}

/// Poses of all frames, OK in map 0.
pub(crate) fn all_ok(poses: &[Pose]) -> Vec<FramePose> {
    (0..)
        .zip(poses)
        .map(|(number, pose)| FramePose::ok(number, *pose))
        .collect()
}

/// A pose of a state.
pub(crate) fn with_state(pose: &FramePose, state: PoseState) -> FramePose {
    FramePose {
        state,
        ..pose.clone()
    }
}

fn streams() -> Streams {
    let intrinsics = Intrinsics::pinhole(8, 6, 7.0, 7.0, 3.5, 2.5).unwrap();
    Streams {
        depth: DepthCamera::new(intrinsics, 0.001, 0.3..=3.0).unwrap(),
        color: ColorCamera::new(
            intrinsics,
            ColorEncoding::Rgb8,
            1.0,
            ResponseCurve::Gamma { gamma: 2.2 },
            VignettingCurve::None,
        )
        .unwrap(),
        color_from_depth: Pose::from_translation(BASELINE),
        depth_timing: StreamTiming::at_rate(30.0),
        color_timing: StreamTiming::at_rate(30.0),
        device: None,
    }
}

/// Writes a recording of `frame_count` frames; those that `repeats` names repeat the frame before.
pub(crate) fn write(
    path: &Path,
    frame_count: usize,
    repeats: &[u64],
    sets: &[(&str, u16, Vec<FramePose>)],
) {
    let description = Description {
        writer: "test".to_owned(),
        created: Created::default(),
        part: None,
        streams: streams(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let id = FileId::of_content(&[b"paths"]);
    let mut writer = RecordingWriter::create_beside(path, id, &description).unwrap();
    let mut depth = DepthStreamEncoder::new(&streams(), DepthCodec::Fast).unwrap();
    let mut color = ColorStreamEncoder::new(&streams()).unwrap();
    for number in 0..frame_count as u64 {
        let times = FrameTimes {
            number,
            device_nanos: number as i64 * FRAME_NANOS,
            is_repeat: repeats.contains(&number),
            ..FrameTimes::default()
        };
        let (payload, table) = depth.encode(&[1000; 48]).unwrap();
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table).unwrap();
        }
        writer.write_frame(DEPTH_STREAM, &times, payload).unwrap();
        let payload = color.encode(&[128; 144]).unwrap();
        writer.write_frame(COLOR_STREAM, &times, payload).unwrap();
    }
    for (name, stream, poses) in sets {
        let set = writer.begin_poses(name, "test", *stream).unwrap();
        writer.write_poses(set, poses).unwrap();
    }
    writer.finish("complete").unwrap();
}

/// A TUM file.
pub(crate) fn write_tum(path: &Path, poses: impl IntoIterator<Item = (i64, Pose)>) {
    let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for (nanos, pose) in poses {
        let (t, q) = (pose.translation(), pose.rotation());
        text.push_str(&format!(
            "{}.{:09} {} {} {} {} {} {} {}\n",
            nanos / 1_000_000_000,
            nanos % 1_000_000_000,
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        ));
    }
    std::fs::write(path, text).unwrap();
}
