//! Import of an export: the same pixels, times, poses and cameras.

use std::path::{Path, PathBuf};

use geometry::Pose;
use glint::export::{ExportOptions, ExportTarget, export};
use glint::import::{ImportOptions, import};
use sequence::verify::verify;
use sequence::{
    COLOR_STREAM, ColorEncoding, DEPTH_STREAM, Device, FrameTimes, Recording, StreamTiming,
    Streams, TickClock,
};

use crate::made::{LOST, Made, import_folder};

const ENCODINGS: [ColorEncoding; 6] = [
    ColorEncoding::Jpeg,
    ColorEncoding::Rgb8,
    ColorEncoding::BayerGrbg,
    ColorEncoding::Uyvy,
    ColorEncoding::Yuyv,
    ColorEncoding::Infrared10,
];

/// Metres and quaternions: rounding of the last bits.
const ROUNDING: f64 = 1e-9;

fn assert_same_pose(a: Option<Pose>, b: Option<Pose>) {
    let (Some(a), Some(b)) = (a, b) else {
        assert_eq!(a.is_some(), b.is_some());
        return;
    };
    assert!((a.translation() - b.translation()).length() < ROUNDING);
    assert!(
        (a.rotation() - b.rotation()).length() < ROUNDING,
        "{a:?} {b:?}"
    );
}

/// The cameras without what no folder carries.
fn cameras(recording: &Recording) -> Streams {
    let mut streams = recording.description().streams.clone();
    streams.depth_timing = StreamTiming::default();
    streams.color_timing = StreamTiming::default();
    streams
}

fn assert_same_streams(a: &Recording, b: &Recording) {
    for stream in [DEPTH_STREAM, COLOR_STREAM] {
        let (places_a, places_b) = (a.contents().stream(stream), b.contents().stream(stream));
        assert_eq!(places_a.len(), places_b.len());
        for (place_a, place_b) in places_a.iter().zip(places_b) {
            assert_eq!(place_a.label.device_nanos, place_b.label.device_nanos);
            assert_eq!(place_a.is_repeat(), place_b.is_repeat());
            if stream == DEPTH_STREAM {
                assert_eq!(
                    a.depth_frame(place_a).unwrap(),
                    b.depth_frame(place_b).unwrap()
                );
            } else {
                assert_eq!(
                    a.color_frame(place_a).unwrap(),
                    b.color_frame(place_b).unwrap()
                );
            }
        }
    }
}

fn assert_same_pairs(a: &Recording, b: &Recording) {
    assert_eq!(a.frame_count(), b.frame_count());
    for index in 0..a.frame_count() {
        assert_eq!(a.depth_raw(index).unwrap(), b.depth_raw(index).unwrap());
        assert_eq!(a.color_raw(index).unwrap(), b.color_raw(index).unwrap());
        let pose = |recording: &Recording| recording.poses("source").unwrap()[index];
        assert_same_pose(pose(a), pose(b));
    }
    assert_eq!(a.split(), b.split());
}

#[test]
fn a_tum_folder_gives_back_both_streams_poses_and_split() {
    for encoding in [ColorEncoding::Jpeg, ColorEncoding::Rgb8] {
        let made = Made::new(encoding);
        let report = made.export(ExportTarget::Tum, "tum");
        assert_eq!(report.missing, [""; 0]);
        assert!(
            report
                .text
                .starts_with("8 depth images and 8 colour images, 7 pairs, 6 poses to "),
            "{}",
            report.text
        );
        let (recording, again) = (made.open(), made.import("tum"));
        assert_same_streams(&recording, &again);
        assert_same_pairs(&recording, &again);
        assert_eq!(cameras(&recording), cameras(&again));
        // Single depth frames have poses too, and none is made up where one is missing.
        let posed = |recording: &Recording| -> Vec<i64> {
            let places = recording.contents().stream(DEPTH_STREAM);
            let set = &recording.contents().pose_sets[0];
            let known = |number: u64| {
                set.poses
                    .iter()
                    .any(|pose| pose.number == number && pose.state != sequence::PoseState::Lost)
            };
            let posed = places.iter().filter(|place| known(place.label.number));
            posed.map(|place| place.label.device_nanos).collect()
        };
        assert_eq!(
            posed(&recording).len(),
            recording.contents().stream(DEPTH_STREAM).len() - LOST.len()
        );
        assert_eq!(posed(&recording), posed(&again));
    }
}

#[test]
fn a_seven_scenes_folder_gives_back_the_pairs() {
    for encoding in [ColorEncoding::Jpeg, ColorEncoding::Rgb8] {
        let made = Made::new(encoding);
        let report = made.export(ExportTarget::SevenScenes, "scenes");
        assert!(
            report.text.contains("7 pairs with 5 poses; left out")
                && report
                    .text
                    .contains("1 depth image and 1 colour image without a partner"),
            "{}",
            report.text
        );
        let (recording, again) = (made.open(), made.import("scenes"));
        assert_same_pairs(&recording, &again);
        assert_eq!(recording.description().streams, again.description().streams);
    }
}

/// Streams with all that a folder carries.
fn timed_streams(encoding: ColorEncoding) -> Streams {
    let mut streams = crate::made::streams(encoding);
    streams.depth_timing.clock = Some(TickClock {
        tick_hz: 60_000_000,
        bits: 64,
    });
    streams.color_timing = StreamTiming::at_rate(29.97);
    streams.device = Some(Device {
        name: "a camera".to_owned(),
        ..Device::default()
    });
    streams
}

#[test]
fn a_plain_folder_gives_back_both_streams_with_all_numbers_times_and_gaps() {
    for encoding in ENCODINGS {
        let made = Made::with(timed_streams(encoding));
        let report = made.export(ExportTarget::Folder, "folder");
        assert!(
            report
                .text
                .starts_with("7 pairs with 5 poses, and 2 images without a partner"),
            "{}",
            report.text
        );
        let (recording, again) = (made.open(), made.import("folder"));
        assert_same_streams(&recording, &again);
        assert_same_pairs(&recording, &again);
        assert_eq!(recording.description().streams, again.description().streams);
        assert_eq!(recording.contents().gaps, again.contents().gaps);
        for stream in [DEPTH_STREAM, COLOR_STREAM] {
            let times = |recording: &Recording| -> Vec<FrameTimes> {
                let places = recording.contents().stream(stream).iter();
                places
                    .map(|place| recording.frame(place).unwrap().0)
                    .collect()
            };
            assert_eq!(times(&recording), times(&again));
        }
        let verification = verify(again.path(), true).unwrap();
        assert_eq!(verification.findings, [""; 0]);
        assert_eq!(verification.missing.len(), recording.contents().gaps.len());
    }
}

#[test]
fn a_plain_folder_without_its_json_gives_back_the_pairs_and_the_times_of_their_depth() {
    let made = Made::new(ColorEncoding::Jpeg);
    made.export(ExportTarget::Folder, "folder");
    std::fs::remove_file(made.at("folder/frames.json")).unwrap();
    let (recording, again) = (made.open(), made.import("folder"));
    assert_same_pairs(&recording, &again);
    assert_eq!(cameras(&recording), cameras(&again));
    assert_eq!(again.contents().stream(DEPTH_STREAM).len(), 7);
    for index in 0..again.frame_count() {
        assert_eq!(recording.time_nanos(index), again.time_nanos(index));
    }
}

/// A folder of the data beside the repository, or `None` with the reason printed.
fn shared_data(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(name);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("skipped: ../shared/data/{name} is not there");
    None
}

fn import_shared(
    input: &Path,
    rig: &str,
    range: std::ops::Range<usize>,
    output: &Path,
) -> Recording {
    let options = ImportOptions {
        input: input.to_path_buf(),
        output: output.to_path_buf(),
        format: None,
        rig: Some(
            Path::new(env!("CARGO_MANIFEST_DIR"))
                .join("../recordings")
                .join(rig),
        ),
        split: None,
        range: Some(range),
    };
    import(&options, &mut |_, _| {}).unwrap();
    Recording::open(output).unwrap()
}

fn export_to(recording: &Recording, target: ExportTarget, output: &Path) {
    let options = ExportOptions {
        input: recording.path().to_path_buf(),
        target,
        output: output.to_path_buf(),
        poses: Some("source".to_owned()),
        frame: None,
    };
    println!("{}", export(&options, &mut |_, _| {}).unwrap().text);
}

#[test]
fn the_tum_excerpt_comes_back_from_its_export() {
    let Some(input) = shared_data("tum-fr1-rpy") else {
        return;
    };
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name);
    let recording = import_shared(&input, "tum-fr1-rig.toml", 0..30, &at("x.glint"));
    export_to(&recording, ExportTarget::Tum, &at("tum"));
    let again = import_folder(&at("tum"), &at("again.glint"));
    assert_same_streams(&recording, &again);
    assert_same_pairs(&recording, &again);
    assert_eq!(cameras(&recording), cameras(&again));
}

#[test]
fn redkitchen_comes_back_from_its_export_file_by_file() {
    let Some(input) = shared_data("redkitchen") else {
        return;
    };
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name);
    let recording = import_shared(&input, "redkitchen-rig.toml", 215..230, &at("x.glint"));
    export_to(&recording, ExportTarget::SevenScenes, &at("scenes"));
    for frame in 0..15 {
        let exported =
            |part: &str| std::fs::read(at(&format!("scenes/frame-{frame:06}.{part}"))).unwrap();
        let original = |part: &str| {
            std::fs::read(input.join(format!("frame-{:06}.{part}", frame + 215))).unwrap()
        };
        assert_eq!(exported("color.jpg"), original("color.jpg"));
        assert_eq!(
            imaging::decode_png_gray16(&exported("depth.png")).unwrap(),
            imaging::decode_png_gray16(&original("depth.png")).unwrap()
        );
    }
    let again = import_folder(&at("scenes"), &at("again.glint"));
    assert_same_pairs(&recording, &again);
    assert!(again.depth_times(222 - 215).unwrap().is_repeat);
}
