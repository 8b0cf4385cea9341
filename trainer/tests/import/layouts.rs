//! `glint import` of whole folders, small ones and the data sets beside the repository.

use std::path::{Path, PathBuf};

use crate::folders::{
    FRAME_COUNT, Folder, HEIGHT, WIDTH, color, color_jpeg, depth, depth_png, matrix_text,
    shared_data, tum_line, world_from_camera,
};
use geometry::{DVec3, Pose};
use glint::import::{ImportFormat, ImportOptions, POSE_SET, import};
use sequence::Recording;

/// Nine decimals of a quaternion and metres.
const TUM_ROUNDING: f64 = 3e-9;

fn assert_close(read: Pose, expected: Pose, tolerance: f64) {
    let shift = (read.translation() - expected.translation()).length();
    let turn = read.rotation().dot(expected.rotation()).abs();
    assert!(
        shift <= tolerance && 1.0 - turn <= tolerance,
        "{read:?} {expected:?}"
    );
}

#[test]
fn a_plain_folder_comes_back_from_the_recording() {
    let folder = Folder::plain();
    let report = folder.import().unwrap();
    assert_eq!(report.format, ImportFormat::Folder);
    let recording = Recording::open(&report.output).unwrap();
    assert_eq!(recording.frame_count(), FRAME_COUNT as usize);
    assert_eq!(recording.split().train, [0, 1, 2, 3, 4]);
    assert_eq!(recording.split().unused, [5]);
    assert_eq!(recording.split().test, [6, 7]);
    let poses = recording.poses(POSE_SET).unwrap();
    for frame in 0..FRAME_COUNT {
        let index = frame as usize;
        assert_eq!(recording.time_nanos(index), 100_000_000 * i64::from(frame));
        assert_eq!(recording.depth_raw(index).unwrap(), depth(frame));
        assert_eq!(recording.color_bytes(index).unwrap(), color_jpeg(frame));
        assert_close(
            poses[index].unwrap(),
            world_from_camera(frame),
            TUM_ROUNDING,
        );
    }
    let (depth, color) = (recording.depth_camera(), recording.color_camera());
    assert_eq!(depth.intrinsics, crate::folders::depth_camera());
    assert_eq!(
        (depth.depth_scale, depth.depth_range.clone()),
        (0.001, 0.4..=10.0)
    );
    assert_eq!(color.intrinsics.focal().y, 111.0);
    assert_eq!(color.response(), imaging::Response::gamma(2.2).unwrap());
    assert!((color.vignetting().factor(63.5 + 80.0, 47.5) - 0.66).abs() < 1e-12);
    assert_eq!(recording.color_from_depth(), Pose::IDENTITY);
}

#[test]
fn the_report_counts_what_is_there() {
    let folder = Folder::plain();
    folder.copy("frames/000002.depth.png", "frames/000003.depth.png");
    folder.copy("frames/000004.color.jpg", "frames/000005.color.jpg");
    let report = folder.import().unwrap();
    let frames = u64::from(FRAME_COUNT);
    assert_eq!(report.depth.code_0_count, frames * u64::from(HEIGHT));
    assert_eq!(report.depth.code_65535_count, frames * u64::from(WIDTH - 1));
    assert_eq!(report.depth.out_of_range_count, 0);
    assert_eq!(
        report.depth.measured_count,
        frames * u64::from((WIDTH - 1) * (HEIGHT - 1))
    );
    assert_eq!(
        (report.repeated_depth_count, report.repeated_color_count),
        (1, 1)
    );
    assert!(report.worst_rotation_error < 1e-8);
    let fit = report.pose_fit.unwrap();
    assert!(
        fit.given_fraction > 0.8 && fit.inverse_fraction < 0.5,
        "{fit:?}"
    );
    let text = report.to_string();
    assert!(text.contains("8 frames over 0.7 s"), "{text}");
    assert!(text.contains("noise model"), "{text}");
}

#[test]
fn a_seven_scenes_folder_is_recognised_and_timed_at_30_hz() {
    let folder = Folder::seven_scenes();
    let report = folder.import().unwrap();
    assert_eq!(report.format, ImportFormat::SevenScenes);
    assert!(
        report
            .notes
            .iter()
            .any(|note| note.contains("30 frames a second"))
    );
    let recording = Recording::open(&report.output).unwrap();
    assert_eq!(recording.time_nanos(1), 33_333_333);
    assert_eq!(recording.time_nanos(3), 100_000_000);
    assert_eq!(recording.split().train.len(), FRAME_COUNT as usize);
    for frame in 0..FRAME_COUNT {
        let index = frame as usize;
        assert_eq!(recording.color(index).unwrap(), color(frame));
        let pose = recording.poses(POSE_SET).unwrap()[index].unwrap();
        assert_close(pose, world_from_camera(frame), 1e-12);
    }
}

#[test]
fn rotations_are_made_exact_and_the_worst_is_reported() {
    let folder = Folder::seven_scenes();
    let rounded = matrix_text(&world_from_camera(3), 1.0 + 9e-5);
    folder.write("frame-000003.pose.txt", rounded.as_bytes());
    let report = folder.import().unwrap();
    assert!((1.7e-4..1.9e-4).contains(&report.worst_rotation_error));
    let recording = Recording::open(&report.output).unwrap();
    let pose = recording.poses(POSE_SET).unwrap()[3].unwrap();
    assert_close(pose, world_from_camera(3), 1e-9);
}

#[test]
fn poses_of_the_colour_camera_become_those_of_the_depth_camera() {
    let folder = Folder::plain();
    folder.edit(
        "rig.toml",
        "depth_from_color = \"identity\"",
        "color_from_depth = { translation = [-0.0244, 0.008, 0.0], rotation = [0.0, 0.0, 0.01, 0.99995] }",
    );
    folder.edit("rig.toml", "frame_rate", "poses = \"color\"\nframe_rate");
    let report = folder.import().unwrap();
    let recording = Recording::open(&report.output).unwrap();
    let color_from_depth = recording.color_from_depth();
    assert_eq!(
        color_from_depth.translation(),
        DVec3::new(-0.0244, 0.008, 0.0)
    );
    let pose = recording.poses(POSE_SET).unwrap()[4].unwrap();
    assert_close(pose, world_from_camera(4) * color_from_depth, TUM_ROUNDING);
}

#[test]
fn both_ways_of_writing_the_extrinsic_agree() {
    let folder = Folder::plain();
    let named = |key: &str, sign: f64| {
        let rig = crate::folders::RIG.replace(
            "depth_from_color = \"identity\"",
            &format!(
                "{key} = {{ translation = [{:.4}, 0.0, 0.0] }}",
                0.025 * sign
            ),
        );
        folder.write("rig.toml", rig.as_bytes());
        let report = folder.import().unwrap();
        Recording::open(&report.output).unwrap().color_from_depth()
    };
    assert_eq!(
        named("color_from_depth", -1.0),
        named("depth_from_color", 1.0)
    );
}

#[test]
fn a_range_keeps_the_split_of_the_frames_it_keeps() {
    let folder = Folder::plain();
    let mut options = folder.options();
    options.range = Some(3..8);
    import(&options, &mut |_, _| {}).unwrap();
    let recording = Recording::open(&options.output).unwrap();
    assert_eq!(recording.frame_count(), 5);
    assert_eq!(recording.split().train, [0, 1]);
    assert_eq!(recording.split().unused, [2]);
    assert_eq!(recording.split().test, [3, 4]);
    assert_eq!(recording.depth_raw(0).unwrap(), depth(3));
    assert_eq!(recording.time_nanos(0), 300_000_000);
}

#[test]
fn a_range_leaves_a_broken_frame_out() {
    let folder = Folder::plain();
    folder.remove("frames/000001.depth.png");
    folder.edit("poses.txt", "0.200000 ", "0.200000 nan ");
    assert!(folder.import().is_err());
    let mut options = folder.options();
    options.range = Some(3..8);
    import(&options, &mut |_, _| {}).unwrap();
}

#[test]
fn frames_in_no_list_of_the_split_are_unused_and_reported() {
    let folder = Folder::plain();
    folder.write("split.json", br#"{"train": [4, 0, 1], "test": [7]}"#);
    let report = folder.import().unwrap();
    assert_eq!(
        (report.train_count, report.unused_count, report.test_count),
        (3, 4, 1)
    );
    assert!(
        report
            .notes
            .iter()
            .any(|note| note.contains("4 frames are in no list"))
    );
}

#[test]
fn masks_and_truth_never_enter() {
    let folder = Folder::plain();
    let without = folder.import().unwrap();
    let bytes = std::fs::read(&without.output).unwrap();
    for name in ["masks", "truth", "truth/depth"] {
        std::fs::create_dir(folder.path(name)).unwrap();
    }
    folder.copy("frames/000000.depth.png", "masks/000000.png");
    folder.copy("frames/000000.depth.png", "truth/depth/000000.png");
    folder.write("truth/environment.exr", b"a room");
    folder.import().unwrap();
    assert_eq!(std::fs::read(&without.output).unwrap(), bytes);
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let folder = Folder::plain();
    let bytes = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let report = pool.install(|| folder.import()).unwrap();
        std::fs::read(report.output).unwrap()
    });
    assert_eq!(bytes[0], bytes[1]);
}

#[test]
fn the_bytes_do_not_depend_on_where_the_folder_lies() {
    let [here, there] = [Folder::tum(), Folder::tum()].map(|folder| {
        let report = folder.import().unwrap();
        std::fs::read(report.output).unwrap()
    });
    assert_eq!(here, there);
}

#[test]
fn poses_of_a_still_camera_are_not_called_wrong() {
    let folder = Folder::plain();
    let still: String = (0..FRAME_COUNT)
        .map(|frame| tum_line(frame, &world_from_camera(0)))
        .collect();
    folder.write("poses.txt", still.as_bytes());
    for frame in 0..FRAME_COUNT {
        folder.write(&format!("frames/{frame:06}.depth.png"), &depth_png(0));
    }
    let fit = folder.import().unwrap().pose_fit.unwrap();
    assert_eq!(fit.given_fraction, fit.inverse_fraction);
}

fn recordings() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings")
}

#[test]
fn redkitchen_comes_through_to_the_last_bit() {
    let Some(input) = shared_data("redkitchen") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let options = ImportOptions {
        input,
        output: folder.path().join("kitchen.glint"),
        format: None,
        rig: Some(recordings().join("redkitchen-rig.toml")),
        split: None,
        range: None,
    };
    let report = import(&options, &mut |_, _| {}).unwrap();
    assert_eq!(report.format, ImportFormat::SevenScenes);
    assert_eq!(report.depth.code_65535_count, 108);
    assert_eq!(
        (report.repeated_depth_count, report.repeated_color_count),
        (17, 16)
    );
    assert!((1.6e-4..2.0e-4).contains(&report.worst_rotation_error));
    let recording = Recording::open(&options.output).unwrap();
    assert_eq!(recording.frame_count(), 300);
    let first = recording.depth_raw(0).unwrap();
    let valid = first
        .pixels()
        .iter()
        .filter(|code| ![0, u16::MAX].contains(*code));
    assert_eq!(valid.clone().count(), 273_943);
    assert_eq!(valid.map(|&code| u64::from(code)).sum::<u64>(), 526_822_367);
    let mut crc = crc32fast::Hasher::new();
    for index in 0..recording.frame_count() {
        let codes = recording.depth_raw(index).unwrap();
        let rows: Vec<u8> = codes
            .pixels()
            .iter()
            .flat_map(|code| code.to_le_bytes())
            .collect();
        crc.update(&rows);
    }
    assert_eq!(crc.finalize(), 0xe734_0697);
    assert!(recording.color_is_subsampled(299).unwrap());
}

#[test]
fn the_bundled_recording_is_whole() {
    let recording = Recording::open(&recordings().join("two-cans.glint")).unwrap();
    assert_eq!(recording.frame_count(), 100);
    assert_eq!(recording.split().train.len(), 84);
    assert_eq!(recording.split().test, (88..100).collect::<Vec<_>>());
    for index in 0..recording.frame_count() {
        recording.depth_raw(index).unwrap();
        recording.color(index).unwrap();
        assert!(!recording.color_is_subsampled(index).unwrap());
        assert!(recording.poses(POSE_SET).unwrap()[index].is_some());
    }
}

#[test]
fn the_bundled_recording_is_what_the_importer_makes() {
    let Some(input) = shared_data("mitsuba-dev") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let options = ImportOptions {
        input,
        output: folder.path().join("two-cans.glint"),
        format: Some(ImportFormat::Folder),
        rig: None,
        split: None,
        range: None,
    };
    import(&options, &mut |_, _| {}).unwrap();
    let made = Recording::open(&options.output).unwrap();
    let bundled = Recording::open(&recordings().join("two-cans.glint")).unwrap();
    assert_eq!(made.content_hash(), bundled.content_hash());
}
