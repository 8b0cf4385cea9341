//! A recording of a corner with a ball in it, seen by a hand that moves slowly: exact depth and poses, RGB8 colours.

use std::path::{Path, PathBuf};

use geometry::{DQuat, DVec3, Intrinsics, Pose};
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FramePose, FrameTimes, RecordingWriter, ResponseCurve, StreamTiming, Streams,
    VignettingCurve,
};

pub(crate) const WIDTH: u32 = 128;
pub(crate) const HEIGHT: u32 = 96;
const FOCAL: f64 = 112.0;
const CENTER: [f64; 2] = [63.5, 47.5];
pub(crate) const RATE_HZ: f64 = 30.0;

/// What a frame shows.
#[derive(Clone, Copy)]
pub(crate) enum Shot {
    /// The scene from the place of this number on the path.
    From(u64),
    /// No depth but that of one pixel, whose place is this number.
    Blank(u64),
}

pub(crate) fn camera() -> Intrinsics {
    Intrinsics::pinhole(WIDTH, HEIGHT, FOCAL, FOCAL, CENTER[0], CENTER[1]).unwrap()
}

/// World from camera at a place of the path: a loop that closes after 40 places, a metre from the origin.
pub(crate) fn pose(place: u64) -> Pose {
    let angle = std::f64::consts::TAU * (place % 40) as f64 / 40.0;
    let turn =
        DQuat::from_rotation_y(0.03 * angle.sin()) * DQuat::from_rotation_x(0.02 * angle.sin());
    let shift = DVec3::new(
        0.04 * angle.cos() - 0.04,
        0.03 * angle.sin(),
        0.02 * angle.sin(),
    );
    let start = Pose::new(DQuat::from_rotation_z(0.1), DVec3::new(1.0, -0.5, 0.2)).unwrap();
    start * Pose::new(turn, shift).unwrap()
}

/// Depth along z and a colour, of the ray through a pixel.
fn look(scene_from_camera: &Pose, x: u32, y: u32) -> (f64, [u8; 3]) {
    let direction = DVec3::new(
        (f64::from(x) - CENTER[0]) / FOCAL,
        (f64::from(y) - CENTER[1]) / FOCAL,
        1.0,
    );
    let origin = scene_from_camera.translation();
    let ray = scene_from_camera.rotation() * direction;
    // Wall, floor, side.
    let planes = [(DVec3::Z, 1.6), (DVec3::Y, 0.45), (DVec3::X, 0.55)];
    let mut nearest = f64::INFINITY;
    for (normal, distance) in planes {
        let along = normal.dot(ray);
        let depth = (distance - normal.dot(origin)) / along;
        if along > 1e-9 && depth > 0.0 {
            nearest = nearest.min(depth);
        }
    }
    let (center, radius) = (DVec3::new(-0.15, 0.2, 1.2), 0.22);
    let (a, b) = (ray.length_squared(), ray.dot(origin - center));
    let inside = b * b - a * ((origin - center).length_squared() - radius * radius);
    if inside > 0.0 {
        nearest = nearest.min((-b - inside.sqrt()) / a);
    }
    let hit = origin + ray * nearest;
    let wave = |value: f64| (100.0 + 60.0 * (20.0 * value).sin()) as u8;
    (nearest, [wave(hit.x), wave(hit.y), wave(hit.z)])
}

pub(crate) fn description() -> Description {
    let timing = StreamTiming::at_rate(RATE_HZ);
    Description {
        writer: "test".to_owned(),
        created: Created::default(),
        part: None,
        streams: Streams {
            depth: DepthCamera::new(camera(), 0.001, 0.4..=4.0).unwrap(),
            color: ColorCamera::new(
                camera(),
                ColorEncoding::Rgb8,
                1.0,
                ResponseCurve::Gamma { gamma: 2.2 },
                VignettingCurve::None,
            )
            .unwrap(),
            color_from_depth: Pose::IDENTITY,
            depth_timing: timing,
            color_timing: timing,
            device: None,
        },
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    }
}

pub(crate) fn times(number: u64) -> FrameTimes {
    FrameTimes {
        number,
        device_nanos: 33_333_333 * number as i64,
        ..FrameTimes::default()
    }
}

/// Samples of both streams.
pub(crate) fn images(shot: Shot) -> (Vec<u16>, Vec<u8>) {
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    match shot {
        Shot::From(place) => {
            // The scene stands before the start of the path.
            let scene_from_camera = pose(0).inverse() * pose(place);
            let seen: Vec<(f64, [u8; 3])> = pixels
                .map(|(x, y)| look(&scene_from_camera, x, y))
                .collect();
            let depth = seen
                .iter()
                .map(|(depth, _)| (1000.0 * depth).round() as u16);
            let colors = seen.iter().flat_map(|(_, color)| *color);
            (depth.collect(), colors.collect())
        }
        Shot::Blank(place) => {
            let count = (WIDTH * HEIGHT) as usize;
            let mut depth = vec![0; count];
            depth[place as usize % count] = 1000;
            (depth, vec![place as u8; 3 * count])
        }
    }
}

/// Infrared as a camera with its emitter on sees it: dots that move with the camera and so stand still in the picture.
fn dots(number: u64) -> Vec<u8> {
    let brightness = |index: u32| {
        let dot = index.wrapping_mul(2_654_435_761) >> 16 & 7;
        if dot == 0 { 900 } else { 60 }
    };
    let mut samples: Vec<u16> = (0..WIDTH * HEIGHT).map(brightness).collect();
    // No two pictures are the same.
    samples[0] = number as u16;
    samples.iter().flat_map(|code| code.to_le_bytes()).collect()
}

/// Writes `shots` with the set `source`, of the depth camera.
pub(crate) fn write(folder: &Path, shots: &[Shot]) -> PathBuf {
    write_as(folder, shots, ColorEncoding::Rgb8)
}

/// The same with colour, or with infrared in its place.
pub(crate) fn write_as(folder: &Path, shots: &[Shot], encoding: ColorEncoding) -> PathBuf {
    let path = folder.join("source.glint");
    let mut description = description();
    description.streams.color.encoding = encoding;
    let id = FileId::of_content(&[b"scene"]);
    let mut writer = RecordingWriter::create_beside(&path, id, &description).unwrap();
    let mut depth_encoder =
        DepthStreamEncoder::new(&description.streams, DepthCodec::Fast).unwrap();
    let mut color_encoder = ColorStreamEncoder::new(&description.streams).unwrap();
    let set = writer.begin_poses("source", "test", DEPTH_STREAM).unwrap();
    for (number, shot) in (0..).zip(shots) {
        let (depth, mut color) = images(*shot);
        if encoding == ColorEncoding::Infrared10 {
            color = dots(number);
        }
        let (payload, table) = depth_encoder.encode(&depth).unwrap();
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table).unwrap();
        }
        writer
            .write_frame(DEPTH_STREAM, &times(number), payload)
            .unwrap();
        let payload = color_encoder.encode(&color).unwrap().to_vec();
        writer
            .write_frame(COLOR_STREAM, &times(number), &payload)
            .unwrap();
        if let Shot::From(place) = shot {
            writer
                .write_poses(set, &[FramePose::ok(number, pose(*place))])
                .unwrap();
        }
        writer.seal_if_due(times(number).device_nanos).unwrap();
    }
    writer.finish("complete").unwrap();
    path
}
