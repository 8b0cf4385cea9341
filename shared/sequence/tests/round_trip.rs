//! What is written is what is read.

mod small;

use geometry::Pose;
use imaging::decode_jpeg;
use sequence::{PoseSet, Recording, RecordingWriter, ResponseCurve, SequenceError, Split};
use small::{FRAME_COUNT, Small};

#[test]
fn everything_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    let bytes = small.write(&path).unwrap();
    assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.frame_count(), FRAME_COUNT as usize);
    assert_eq!(recording.depth_camera(), &small.streams.depth);
    assert_eq!(recording.color_camera(), &small.streams.color);
    assert_eq!(recording.split(), &small.split);
    assert_eq!(recording.path(), path);
    for (k, &time) in small.times_nanos.iter().enumerate() {
        assert_eq!(recording.time_nanos(k), time);
        assert_eq!(recording.depth_raw(k).unwrap(), small.depth[k]);
        assert_eq!(recording.depth_bytes(k).unwrap(), small.depth_png[k]);
        assert_eq!(recording.color_bytes(k).unwrap(), small.color_jpeg[k]);
        let decoded = decode_jpeg(&small.color_jpeg[k]).unwrap();
        assert_eq!(recording.color(k).unwrap(), decoded);
        assert!(!recording.color_is_subsampled(k).unwrap());
    }
    assert_close(
        &recording.color_from_depth(),
        &small.streams.color_from_depth,
    );
}

/// Rounding of a unit quaternion that is made unit once more.
const POSE_ROUNDING: f64 = 1e-15;

fn assert_close(read: &Pose, written: &Pose) {
    assert_eq!(read.translation(), written.translation());
    let difference = (read.rotation() - written.rotation()).length();
    assert!(difference <= POSE_ROUNDING, "{difference:e}");
}

#[test]
fn every_pose_set_comes_back_with_its_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    small.write(&path).unwrap();
    let recording = Recording::open(&path).unwrap();
    for set in &small.pose_sets {
        let read = recording.poses(&set.name).unwrap();
        assert_eq!(read.len(), set.world_from_depth.len());
        for (read, written) in read.iter().zip(&set.world_from_depth) {
            match (read, written) {
                (Some(read), Some(written)) => assert_close(read, written),
                (read, written) => assert_eq!(read.is_none(), written.is_none()),
            }
        }
    }
    assert!(recording.poses("refined").is_none());
}

#[test]
fn the_same_input_gives_the_same_bytes_and_hash() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.glint"), folder.path().join("b.glint"));
    Small::new().write(&a).unwrap();
    Small::new().write(&b).unwrap();
    assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    let (a, b) = (Recording::open(&a).unwrap(), Recording::open(&b).unwrap());
    assert_eq!(a.content_hash(), b.content_hash());
    let mut other = Small::new();
    other.times_nanos[0] -= 1;
    let c = folder.path().join("c.glint");
    other.write(&c).unwrap();
    let c = Recording::open(&c).unwrap();
    assert_ne!(a.content_hash(), c.content_hash());
}

#[test]
fn the_file_says_its_version_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert!(bytes.starts_with(b"glint recording, version 0\n"));
}

#[test]
fn a_measured_response_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let mut small = Small::new();
    let channel: Vec<f32> = (0..256).map(|k| (k as f32 / 255.0).powf(1.7)).collect();
    let curve = ResponseCurve::Table {
        red: channel.clone(),
        green: channel.iter().map(|v| 0.9 * v).collect(),
        blue: channel,
    };
    let color = &small.streams.color;
    small.streams.color = sequence::ColorCamera::new(
        color.intrinsics,
        color.codec,
        1.0,
        curve,
        sequence::VignettingCurve::None,
    )
    .unwrap();
    small.write(&path).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(
        recording.color_camera().response(),
        small.streams.color.response()
    );
    assert!(recording.color_camera().vignetting().is_none());
}

#[test]
fn a_response_that_falls_is_refused() {
    let channel: Vec<f32> = (0..256).map(|k| (k as f32 - 128.0).abs()).collect();
    let curve = ResponseCurve::Table {
        red: channel.clone(),
        green: channel.clone(),
        blue: channel,
    };
    assert!(matches!(
        curve.build(),
        Err(SequenceError::ResponseNotRising { .. })
    ));
}

#[test]
fn an_unfinished_recording_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    let mut writer = RecordingWriter::create(&path, small.streams.clone()).unwrap();
    writer
        .write_frame(0, &small.depth_png[0], &small.color_jpeg[0])
        .unwrap();
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_recording_is_replaced_while_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    small.write(&path).unwrap();
    let old = Recording::open(&path).unwrap();
    let mut other = Small::new();
    other.depth_png.swap(0, 1);
    other.write(&path).unwrap();
    assert_eq!(old.depth_raw(0).unwrap(), small.depth[0]);
    let new = Recording::open(&path).unwrap();
    assert_eq!(new.depth_raw(0).unwrap(), small.depth[1]);
}

#[test]
fn the_writer_refuses_what_the_reader_would_refuse() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let refused = |change: &dyn Fn(&mut Small)| {
        let mut small = Small::new();
        change(&mut small);
        let error = small.write(&path).unwrap_err().to_string();
        assert!(!path.exists(), "{error}");
        error
    };
    assert!(refused(&|small| small.times_nanos[2] = 0).contains("not after the frame before"));
    assert!(refused(&|small| small.split = Split::all_train(2)).contains("names frame 2 0 times"));
    let short = |small: &mut Small| {
        small.pose_sets[0].world_from_depth.pop();
    };
    assert!(refused(&short).contains("2 poses for 3 frames"));
    let twice = |small: &mut Small| small.pose_sets[1].name = "source".to_owned();
    assert!(refused(&twice).contains("`source` cannot name"));
    let named_oddly = |small: &mut Small| {
        small.pose_sets.push(PoseSet {
            name: "../x".to_owned(),
            world_from_depth: vec![None; 3],
        });
    };
    assert!(refused(&named_oddly).contains("cannot name a pose set"));
}

#[test]
fn a_folder_that_does_not_exist_is_named() {
    let error = Small::new()
        .write("/nowhere/at/all.glint".as_ref())
        .unwrap_err();
    assert!(error.to_string().contains("/nowhere/at/all.glint"));
}

#[test]
fn a_recording_is_read_from_many_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    small.write(&path).unwrap();
    let recording = Recording::open(&path).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for (k, depth) in small.depth.iter().enumerate() {
                    assert_eq!(&recording.depth_raw(k).unwrap(), depth);
                }
            });
        }
    });
}
