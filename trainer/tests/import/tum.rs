//! `glint import` of TUM folders: two streams with times of their own, poses with others.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::folders::{
    FRAME_COUNT, Folder, TUM_COLOR_COUNT, TUM_START, color, depth, shared_data, tum_color_micros,
    tum_depth_micros, world_from_camera,
};
use glint::import::{ImportFormat, ImportOptions, POSE_SET, import};
use sequence::{COLOR_STREAM, DEPTH_STREAM, Recording};

/// Metres and quaternions between poses 20 ms apart, on a path that turns by 0.5 rad/s.
const INTERPOLATION: f64 = 1e-6;

fn nanos(micros: i64) -> i64 {
    1000 * (TUM_START + micros)
}

/// Frame numbers and device times of a stream.
fn stamps(recording: &Recording, stream: u16) -> Vec<(u64, i64)> {
    let places = recording.contents().stream(stream).iter();
    places
        .map(|place| (place.label.number, place.label.device_nanos))
        .collect()
}

#[test]
fn both_streams_keep_their_own_times() {
    let folder = Folder::tum();
    let report = folder.import().unwrap();
    assert_eq!(report.format, ImportFormat::Tum);
    assert_eq!(
        (report.frame_count, report.color_count),
        (FRAME_COUNT as usize, TUM_COLOR_COUNT as usize)
    );
    let recording = Recording::open(&report.output).unwrap();
    let expected = |count: u32, micros: fn(u32) -> i64| -> Vec<(u64, i64)> {
        (0..count)
            .map(|frame| (u64::from(frame), nanos(micros(frame))))
            .collect()
    };
    assert_eq!(
        stamps(&recording, DEPTH_STREAM),
        expected(FRAME_COUNT, tum_depth_micros)
    );
    assert_eq!(
        stamps(&recording, COLOR_STREAM),
        expected(TUM_COLOR_COUNT, tum_color_micros)
    );
    for (frame, place) in (0..).zip(recording.contents().stream(DEPTH_STREAM)) {
        assert_eq!(recording.depth_frame(place).unwrap(), depth(frame));
    }
    for (frame, place) in (0..).zip(recording.contents().stream(COLOR_STREAM)) {
        let samples = recording.color_frame(place).unwrap();
        assert_eq!(samples, color(frame).pixels().as_flattened());
    }
    let timing = recording.description().streams.depth_timing;
    assert_eq!(timing.rate_hz, None);
    assert!(recording.depth_camera().is_registered);
}

#[test]
fn pairs_are_made_by_time_and_use_no_image_twice() {
    let report = Folder::tum().import().unwrap();
    // The folder is gone: what was reported is all that is left.
    assert_eq!(report.pair_count, FRAME_COUNT as usize / 2);
    let folder = Folder::tum();
    let recording = Recording::open(&folder.import().unwrap().output).unwrap();
    let pairs: Vec<(u64, u64)> = (0..recording.frame_count())
        .map(|pair| {
            let depth = recording.depth_times(pair).unwrap();
            let color = recording.color_times(pair).unwrap();
            assert_eq!(color.device_nanos - depth.device_nanos, 7_000_000);
            (depth.number, color.number)
        })
        .collect();
    assert_eq!(pairs, [(0, 0), (2, 3), (4, 6), (6, 9)]);
}

#[test]
fn depth_frames_get_poses_between_those_of_the_list() {
    let folder = Folder::tum();
    // Depth images 2 and 3 fall into holes of 80 and 60 ms; 5 has a neighbour at 40 ms.
    let text = String::from_utf8(folder.read("groundtruth.txt")).unwrap();
    let kept = |line: &&str| {
        let dropped = ["375304", "395304", "355304", "475304", "495304", "675304"];
        !dropped
            .iter()
            .any(|end| line.split(' ').next().unwrap().ends_with(end))
    };
    let text: Vec<&str> = text.lines().filter(kept).collect();
    folder.write("groundtruth.txt", text.join("\n").as_bytes());
    let report = folder.import().unwrap();
    assert_eq!(report.pose_count, FRAME_COUNT as usize - 2);
    assert!(
        report
            .notes
            .iter()
            .any(|note| note.starts_with("2 depth images have no pose")),
        "{:?}",
        report.notes
    );
    let recording = Recording::open(&report.output).unwrap();
    let [set] = recording.contents().pose_sets.as_slice() else {
        panic!("one set of poses");
    };
    assert_eq!(
        (set.head.name.as_str(), set.head.stream),
        (POSE_SET, DEPTH_STREAM)
    );
    let numbers: Vec<u64> = set.poses.iter().map(|pose| pose.number).collect();
    assert_eq!(numbers, [0, 1, 4, 5, 6, 7]);
    for pose in &set.poses {
        let expected = world_from_camera(pose.number as u32);
        let (got, pose) = (pose.world_from_camera, pose.number);
        let shift = (got.translation() - expected.translation()).length();
        let turn = 1.0 - got.rotation().dot(expected.rotation()).abs();
        assert!(
            shift < INTERPOLATION && turn < INTERPOLATION,
            "{pose}: {shift} {turn}"
        );
    }
}

#[test]
fn a_folder_without_a_path_has_no_poses() {
    let folder = Folder::tum();
    folder.remove("groundtruth.txt");
    let report = folder.import().unwrap();
    assert_eq!((report.pose_count, report.pose_fit), (0, None));
    let text = report.to_string();
    assert!(
        text.contains("poses: none") && text.contains("no groundtruth.txt"),
        "{text}"
    );
    let recording = Recording::open(&report.output).unwrap();
    assert!(recording.pose_sets().is_empty());
}

#[test]
fn a_range_and_a_split_count_depth_images() {
    let folder = Folder::tum();
    folder.write("split.json", br#"{"train": [0, 2, 4], "test": [3, 6]}"#);
    let mut options = folder.options();
    options.range = Some(2..5);
    let report = import(&options, &mut |_, _| {}).unwrap();
    assert_eq!(report.frame_count, 3);
    let recording = Recording::open(&options.output).unwrap();
    let times: Vec<i64> = stamps(&recording, DEPTH_STREAM)
        .iter()
        .map(|(_, nanos)| *nanos)
        .collect();
    assert_eq!(times, [2, 3, 4].map(|frame| nanos(tum_depth_micros(frame))));
    // From 20 ms before the first to 20 ms after the last.
    let times: Vec<i64> = stamps(&recording, COLOR_STREAM)
        .iter()
        .map(|(_, nanos)| *nanos)
        .collect();
    assert_eq!(
        times,
        [3, 4, 5, 6].map(|frame| nanos(tum_color_micros(frame)))
    );
    let stored = recording.contents().split.as_ref().unwrap();
    assert_eq!((&stored.train, &stored.test), (&vec![0, 2], &vec![1]));
    // Of pairs: depth 1 has none.
    assert_eq!(recording.split().train, [0, 1]);
    options.range = Some(2..9);
    let error = import(&options, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("has the frames 0..8"), "{error}");
}

#[test]
fn lines_out_of_order_are_sorted_and_equal_times_kept() {
    let folder = Folder::tum();
    let text = String::from_utf8(folder.read("depth.txt")).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines.reverse();
    // The two comments are at the end now; image 7 is first.
    folder.write("depth.txt", lines.join("\n").as_bytes());
    let first = text.lines().nth(2).unwrap();
    folder.edit(
        "depth.txt",
        first,
        &format!("{first}\n{}", first.replace("0.png", "1.png")),
    );
    let report = folder.import().unwrap();
    let note = |part: &str| report.notes.iter().any(|note| note.contains(part));
    assert!(
        note("depth.txt: 7 lines go back in time"),
        "{:?}",
        report.notes
    );
    assert!(
        note("depth.txt: 1 lines have the time of the line before"),
        "{:?}",
        report.notes
    );
    let recording = Recording::open(&report.output).unwrap();
    let places = recording.contents().stream(DEPTH_STREAM);
    assert_eq!(places.len(), FRAME_COUNT as usize + 1);
    for (place, frame) in places.iter().zip([0, 1, 1, 2, 3, 4, 5, 6, 7]) {
        assert_eq!(recording.depth_frame(place).unwrap(), depth(frame));
    }
    assert_eq!(places[0].label.device_nanos, places[1].label.device_nanos);
}

#[test]
fn repeats_are_found_in_each_stream_alone() {
    let folder = Folder::tum();
    folder.copy("depth/4.png", "depth/5.png");
    folder.copy("rgb/2.png", "rgb/3.png");
    folder.copy("rgb/2.png", "rgb/4.png");
    let report = folder.import().unwrap();
    assert_eq!(report.repeated_depth_frames, [5]);
    assert_eq!(report.repeated_color_frames, [3, 4]);
    let text = report.to_string();
    assert!(
        text.contains("repeated frames: 1 depth (5); 2 colour (3, 4)"),
        "{text}"
    );
    let recording = Recording::open(&report.output).unwrap();
    let repeats = |stream| -> Vec<u64> {
        let places = recording.contents().stream(stream).iter();
        let times = places.map(|place| recording.frame(place).unwrap().0);
        times
            .filter(|times| times.is_repeat)
            .map(|times| times.number)
            .collect()
    };
    assert_eq!(repeats(DEPTH_STREAM), [5]);
    assert_eq!(repeats(COLOR_STREAM), [3, 4]);
}

#[test]
fn broken_lists_get_a_sentence() {
    let refuses = |expected: &str, damage: &dyn Fn(&Folder)| {
        let folder = Folder::tum();
        damage(&folder);
        let sentence = format!("{:#}", folder.import().expect_err("the folder is broken"));
        assert!(
            sentence.contains(expected),
            "no `{expected}` in: {sentence}"
        );
        assert!(!sentence.contains('\n') && !folder.path("out.glint").exists());
    };
    refuses("depth.txt holds no depth images", &|folder| {
        folder.write("depth.txt", b"# none\n");
    });
    refuses("rgb.txt holds no colour images", &|folder| {
        folder.write("rgb.txt", b"");
    });
    refuses("depth.txt, line 3: `soon` is no time", &|folder| {
        folder.edit("depth.txt", "1305031102.175304", "soon");
    });
    refuses("line 3: `../0.png` is no file of the folder", &|folder| {
        folder.edit("depth.txt", "depth/0.png", "../0.png");
    });
    refuses("`/etc/passwd` is no file", &|folder| {
        folder.edit("rgb.txt", "rgb/0.png", "/etc/passwd");
    });
    refuses("`` is no file", &|folder| {
        folder.edit("rgb.txt", " rgb/0.png", "");
    });
    refuses("depth/3.png", &|folder| folder.remove("depth/3.png"));
    refuses("groundtruth.txt, line 2", &|folder| {
        folder.edit("groundtruth.txt", " 0 0 0.2 ", " 0 0.2 ");
    });
    refuses("depth.registered", &|folder| {
        folder.edit("rig.toml", "fy = 110.0", "fy = 111.0");
    });
    refuses("depth.registered", &|folder| {
        folder.edit(
            "rig.toml",
            "\"identity\"",
            "{ translation = [0.02, 0.0, 0.0] }",
        );
    });
    refuses("wrong way round", &|folder| {
        let rows: String = (0..80)
            .map(|step| {
                let pose = crate::folders::world_from_camera_at(f64::from(step) * 0.1).inverse();
                let (t, q) = (pose.translation(), pose.rotation());
                let nanos = nanos(10_000 * i64::from(step));
                let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
                format!(
                    "{seconds}.{rest:09} {} {} {} {} {} {} {}\n",
                    t.x, t.y, t.z, q.x, q.y, q.z, q.w
                )
            })
            .collect();
        folder.write("groundtruth.txt", rows.as_bytes());
    });
}

fn import_shared(input: PathBuf, rig: &str) -> (tempfile::TempDir, glint::import::ImportReport) {
    let folder = tempfile::tempdir().unwrap();
    let recordings = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings");
    let options = ImportOptions {
        input,
        output: folder.path().join("x.glint"),
        format: None,
        rig: Some(recordings.join(rig)),
        split: None,
        range: None,
    };
    let report = import(&options, &mut |_, _| {}).unwrap();
    println!("{report}");
    (folder, report)
}

#[test]
fn the_repeats_of_redkitchen_are_found_in_each_stream() {
    let Some(input) = shared_data("redkitchen") else {
        return;
    };
    // Counted by comparing the files themselves.
    let bytes = |frame: u32, part: &str| {
        std::fs::read(input.join(format!("frame-{frame:06}.{part}"))).unwrap()
    };
    let same = |part: &str| -> Vec<u32> {
        (1..300)
            .filter(|&frame| bytes(frame, part) == bytes(frame - 1, part))
            .collect()
    };
    let (_folder, report) = import_shared(input.clone(), "redkitchen-rig.toml");
    assert_eq!(report.repeated_depth_frames[0], 222);
    assert_eq!(report.repeated_depth_frames, same("depth.png"));
    assert_eq!(report.repeated_color_frames, same("color.jpg"));
    let recording = Recording::open(&report.output).unwrap();
    let times = recording.depth_times(222).unwrap();
    assert!(times.is_repeat && times.number == 222);
    assert_eq!(
        recording.depth_raw(222).unwrap(),
        recording.depth_raw(221).unwrap()
    );
}

#[test]
fn the_tum_excerpt_is_paired_by_time_and_no_image_twice() {
    let Some(input) = shared_data("tum-fr1-rpy") else {
        return;
    };
    let (_folder, report) = import_shared(input, "tum-fr1-rig.toml");
    assert_eq!(report.format, ImportFormat::Tum);
    let fit = report.pose_fit.unwrap();
    assert!(fit.given_fraction > fit.inverse_fraction + 0.3, "{fit:?}");
    let recording = Recording::open(&report.output).unwrap();
    let (mut depth, mut color) = (BTreeSet::new(), BTreeSet::new());
    for pair in 0..recording.frame_count() {
        let of_depth = recording.depth_times(pair).unwrap();
        let of_color = recording.color_times(pair).unwrap();
        let skew = (of_color.device_nanos - of_depth.device_nanos).abs();
        assert!(skew <= 20_000_000, "{skew}");
        assert!(depth.insert(of_depth.number) && color.insert(of_color.number));
    }
    assert!(recording.frame_count() >= 85, "{}", recording.frame_count());
    assert_eq!(
        stamps(&recording, DEPTH_STREAM)[0].1,
        1_305_031_235_538_554_000
    );
    assert_eq!(
        stamps(&recording, COLOR_STREAM)[0].1,
        1_305_031_235_529_738_000
    );
}
