//! Frames that repeat their predecessors say nothing new: training leaves them out (hard-cases B13).

use std::path::Path;

use fusion::{Mesh, MeshConfig, Volume, VolumeConfig, extract_mesh};
use geometry::{DVec2, DVec3, Intrinsics, Pose};
use glint::stages::geometry::{Geometry, build, depth_of};
use glint::stages::observe::{ColorView, Observations, PixelRules, Surface, observe};
use glint::stages::poses::{PosedFrame, training_frames};
use imaging::Image;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use raytrace::{MirrorQuery, Scene};
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FramePose, FrameTimes, Recording, RecordingWriter, ResponseCurve, StreamTiming,
    Streams, VignettingCurve,
};

/// Views that differ.
const VIEW_COUNT: u64 = 14;
/// Coarse, since the images are.
const VOXEL_SIZE: f32 = 0.05;

/// A frame of the recordings here: what each camera shows.
#[derive(Clone, Copy)]
struct Shown {
    /// Where the camera is.
    view: u64,
    /// The view that the depth image shows.
    depth: u64,
    /// The view that the colour image shows.
    color: u64,
}

fn camera() -> Intrinsics {
    Intrinsics::pinhole(48, 36, 40.0, 40.0, 23.5, 17.5).unwrap()
}

fn world_from_camera(view: f64) -> Pose {
    Pose::from_translation(DVec3::new(0.012 * view, 0.004 * view, 0.1 - 0.008 * view))
        * Pose::from_axis_angle(DVec3::new(0.2, 1.0, 0.1), 0.04 * view)
}

/// Millimetres of the inside of a box of 1.6 x 1.2 x 2 m around the world's origin, with noise of its own in every
/// view.
fn depth(view: u64) -> Image<u16> {
    let (camera, pose) = (camera(), world_from_camera(view as f64));
    let mut random = Pcg64Mcg::seed_from_u64(view);
    let half = DVec3::new(0.8, 0.6, 1.0);
    Image::from_fn(48, 36, |x, y| {
        let pixel = DVec2::new(f64::from(x), f64::from(y));
        // The ray has z = 1 in the camera, so its parameter is the depth.
        let ray = pose.transform_vector(camera.camera_from_pixel(pixel).unwrap());
        let wall = (half * ray.signum() - pose.translation()) / ray;
        (1000.0 * wall.min_element()) as u16 + random.random_range(0..8)
    })
}

fn color(view: u64) -> Vec<u8> {
    let mut random = Pcg64Mcg::seed_from_u64(1000 + view);
    (0..3 * 48 * 36)
        .map(|_| random.random_range(20..200))
        .collect()
}

fn streams() -> Streams {
    Streams {
        depth: DepthCamera::new(camera(), 0.001, 0.3..=8.0).unwrap(),
        color: ColorCamera::new(
            camera(),
            ColorEncoding::Rgb8,
            1.0,
            ResponseCurve::Identity,
            VignettingCurve::None,
        )
        .unwrap(),
        color_from_depth: Pose::IDENTITY,
        depth_timing: StreamTiming::at_rate(30.0),
        color_timing: StreamTiming::at_rate(30.0),
        device: None,
    }
}

/// Writes a recording that marks its repeats, with a pose for every frame.
fn write(path: &Path, frames: &[Shown]) -> Recording {
    let streams = streams();
    let description = Description {
        writer: "a test".to_owned(),
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let mut writer = RecordingWriter::create_beside(path, FileId([3; 16]), &description).unwrap();
    let mut depth_encoder = DepthStreamEncoder::new(&streams, DepthCodec::Fast).unwrap();
    let mut color_encoder = ColorStreamEncoder::new(&streams).unwrap();
    let set = writer
        .begin_poses("source", "a test", DEPTH_STREAM)
        .unwrap();
    let mut before: Option<Shown> = None;
    for (number, frame) in (0..).zip(frames) {
        let times = |is_repeat| FrameTimes {
            number,
            device_nanos: 33_333_333 * number as i64,
            is_repeat,
            ..FrameTimes::default()
        };
        let (payload, table) = depth_encoder.encode(depth(frame.depth).pixels()).unwrap();
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table).unwrap();
        }
        let is_repeat = before.is_some_and(|before| before.depth == frame.depth);
        writer
            .write_frame(DEPTH_STREAM, &times(is_repeat), payload)
            .unwrap();
        let samples = color(frame.color);
        let payload = color_encoder.encode(&samples).unwrap();
        let is_repeat = before.is_some_and(|before| before.color == frame.color);
        writer
            .write_frame(COLOR_STREAM, &times(is_repeat), payload)
            .unwrap();
        // As a tracker has it that does not know of repeats: the poses go on a little.
        let shift = if before.is_some_and(|before| before.view == frame.view) {
            0.3
        } else {
            0.0
        };
        let pose = FramePose::ok(number, world_from_camera(frame.view as f64 + shift));
        writer.write_poses(set, &[pose]).unwrap();
        before = Some(*frame);
    }
    writer.finish("complete").unwrap();
    Recording::open(path).unwrap()
}

/// Every view once; in the first recording ten of them come a second time.
fn with_and_without_repeats(folder: &Path) -> [Recording; 2] {
    let once: Vec<Shown> = (0..VIEW_COUNT)
        .map(|view| Shown {
            view,
            depth: view,
            color: view,
        })
        .collect();
    let mut repeated = Vec::new();
    for shown in &once {
        repeated.push(*shown);
        if (1..=10).contains(&shown.view) {
            repeated.push(*shown);
        }
    }
    [
        write(&folder.join("with.glint"), &repeated),
        write(&folder.join("without.glint"), &once),
    ]
}

fn built(recording: &Recording, frames: &[PosedFrame]) -> Geometry {
    build(recording, frames, VOXEL_SIZE, &mut |_, _| {}).unwrap()
}

/// All bits of a mesh and what is said of it.
fn bits(geometry: &Geometry) -> String {
    let Geometry {
        mesh,
        normal_sigma,
        summary,
    } = geometry;
    let mut summary = summary.clone();
    summary.repeated_frame_count = 0;
    format!(
        "{:?} {:?} {:?} {:?} {normal_sigma:?} {summary:?}",
        mesh.origin, mesh.positions, mesh.normals, mesh.triangles
    )
}

/// Fuses whatever frames there are.
fn naive_fused(recording: &Recording, frames: &[PosedFrame]) -> (Volume, Mesh) {
    let config = VolumeConfig {
        voxel_size: VOXEL_SIZE,
        min_depth: 0.3,
        max_depth: 8.0,
        ..VolumeConfig::default()
    };
    let mut volume = Volume::new(config).unwrap();
    for frame in frames {
        let depth = depth_of(recording, frame.index).unwrap();
        volume
            .integrate(depth.pixels(), &camera(), &frame.world_from_camera)
            .unwrap();
    }
    let mesh = extract_mesh(&volume, &MeshConfig::default());
    (volume, mesh)
}

#[test]
fn hc_b13_a_repeated_frame_is_not_fused_twice() {
    let folder = tempfile::tempdir().unwrap();
    let [with, without] = with_and_without_repeats(folder.path());
    let frames_with = training_frames(&with, "source").unwrap();
    let frames_without = training_frames(&without, "source").unwrap();
    assert_eq!((frames_with.len(), frames_without.len()), (24, 14));

    // Bite: fused as they come, repeats raise weights and move the surface.
    let (naive, naive_mesh) = naive_fused(&with, &frames_with);
    let (right, right_mesh) = naive_fused(&without, &frames_without);
    let largest_ratio = right_mesh
        .positions
        .iter()
        .filter_map(|position| {
            let voxel = (*position / VOXEL_SIZE).floor().as_ivec3().to_array();
            let (naive, right) = (naive.voxel(voxel)?, right.voxel(voxel)?);
            (right.weight > 0.0).then_some(naive.weight / right.weight)
        })
        .fold(0.0, f32::max);
    assert!(largest_ratio > 1.5, "{largest_ratio}");
    assert_ne!(naive_mesh.positions, right_mesh.positions);

    // Hold: the same bits as without repeats, and the summary says how many there were.
    let geometry = built(&with, &frames_with);
    assert_eq!(geometry.summary.repeated_frame_count, 10);
    assert_eq!(geometry.summary.frame_count, 14);
    let expected = built(&without, &frames_without);
    assert!(bits(&geometry) == bits(&expected));

    // Neighbours: some of the frames, at other poses, with some of their repeats.
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let mut different_count = 0;
    let mut repeated_count = 0;
    for _ in 0..1000 {
        let (mut some, mut new) = (Vec::new(), Vec::new());
        for frame in &frames_with {
            let shift: [f64; 3] = std::array::from_fn(|_| random.random_range(-0.01..0.01));
            let moved = PosedFrame {
                world_from_camera: Pose::from_translation(DVec3::from_array(shift))
                    * frame.world_from_camera,
                ..*frame
            };
            if random.random_range(0..5) != 0 {
                continue;
            }
            some.push(moved);
            if !with.depth_is_repeat(frame.index) {
                new.push(moved);
            }
        }
        let [some, new] = [some, new].map(|frames| {
            let geometry = build(&with, &frames, VOXEL_SIZE, &mut |_, _| {});
            geometry.map_or_else(|error| error.to_string(), |geometry| bits(&geometry))
        });
        different_count += usize::from(some != new);
        repeated_count += usize::from(some.len() > 100);
    }
    println!(
        "B13, 1000 neighbours: {different_count} differ, tolerance 0; {repeated_count} have a surface"
    );
    assert_eq!(different_count, 0);
    assert!(repeated_count > 500, "{repeated_count}");
}

/// The fused surface, all of it one object.
fn surface(geometry: Geometry) -> Surface {
    let mesh = geometry.mesh;
    Surface {
        scene: Scene::new(&mesh.positions, &mesh.triangles).unwrap(),
        mirror: MirrorQuery::for_fused(VOXEL_SIZE),
        vertex_segment: vec![1; mesh.positions.len()],
        positions: mesh.positions,
        normals: mesh.normals,
        triangles: mesh.triangles,
        origin: mesh.origin,
    }
}

#[test]
fn colour_that_repeats_is_not_observed_twice_and_streams_repeat_on_their_own() {
    let folder = tempfile::tempdir().unwrap();
    // Frame 3 repeats depth alone, frame 5 colour alone, frame 8 both.
    let shown = |view, depth, color| Shown { view, depth, color };
    let mut frames: Vec<Shown> = (0..12).map(|view| shown(view, view, view)).collect();
    frames[3] = shown(3, 2, 3);
    frames[5] = shown(5, 5, 4);
    frames[8] = shown(8, 7, 7);
    let recording = write(&folder.path().join("x.glint"), &frames);
    let repeats = |is_repeat: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..recording.frame_count())
            .filter(|&index| is_repeat(index))
            .collect()
    };
    assert_eq!(repeats(&|index| recording.depth_is_repeat(index)), [3, 8]);
    assert_eq!(repeats(&|index| recording.color_is_repeat(index)), [5, 8]);

    let frames = training_frames(&recording, "source").unwrap();
    let geometry = built(&recording, &frames);
    assert_eq!(geometry.summary.repeated_frame_count, 2);
    let normal_sigma = geometry.normal_sigma.clone();
    let surface = surface(geometry);
    let view = ColorView::new(&recording);
    let look = |frames: &[PosedFrame]| -> Observations {
        let rules = PixelRules::default();
        let progress = |_, _| {};
        observe(
            &recording,
            &view,
            &surface,
            &normal_sigma,
            frames,
            &rules,
            &progress,
        )
        .unwrap()
    };
    let seen = look(&frames);
    assert_eq!(seen.repeated_frame_count, 2);
    let numbers: Vec<u32> = seen.frames.iter().map(|frame| frame.frame).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 4, 6, 7, 9, 10, 11]);
    assert!(seen.frames.iter().all(|frame| !frame.samples.is_empty()));
    // The pixels of later frames do not move because of the repeats.
    let new: Vec<PosedFrame> = frames
        .iter()
        .filter(|frame| ![5, 8].contains(&frame.index))
        .copied()
        .collect();
    assert_eq!(
        format!("{:?}", look(&new).frames),
        format!("{:?}", seen.frames)
    );
}
