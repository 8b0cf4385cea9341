//! What is written comes back, through both ways of writing.

use sequence::file_layer::{self, WritePath};
use sequence::summary::Summary;
use sequence::{COLOR_STREAM, DEPTH_STREAM, Histogram, PoseState, Recording};

use super::small::{self, Waiting};

fn write_to(folder: &tempfile::TempDir, path: WritePath, chunk_frames: u64) -> std::path::PathBuf {
    let name = folder.path().join(format!("{path:?}-{chunk_frames}.glint"));
    small::write(
        file_layer::create(&name, path).unwrap(),
        chunk_frames,
        Waiting::InPlace,
    )
    .unwrap();
    name
}

fn assert_whole(recording: &Recording) {
    assert_eq!(recording.description(), &small::description());
    assert_eq!(recording.frame_count(), small::FRAME_COUNT as usize);
    for (index, number) in small::numbers().enumerate() {
        let mut depth_times = small::times(number);
        assert_eq!(recording.color_times(index).unwrap(), depth_times);
        depth_times.is_repeat = number == small::REPEAT;
        assert_eq!(recording.depth_times(index).unwrap(), depth_times);
        assert_eq!(
            recording.depth_raw(index).unwrap().pixels(),
            small::depth(number)
        );
        assert_eq!(recording.color_raw(index).unwrap(), small::color(number));
        assert_eq!(
            recording.frame_at(depth_times.device_nanos + 3),
            Some(index)
        );
        let pose = recording.poses("live").unwrap()[index].unwrap();
        // Reading makes the quaternion a unit again, which may move its last bit.
        let expected = small::pose(number).world_from_camera;
        assert_eq!(pose.translation(), expected.translation());
        assert!((pose.rotation() - expected.rotation()).length() < 1e-15);
    }
    // Number 5 is missing: pair 5 is number 6.
    assert_eq!(recording.split().train, [0, 1, 2, 3, 4, 5]);
    assert_eq!(recording.split().unused, [6]);
    assert_eq!(recording.split().test, [7, 8, 9]);
    let contents = recording.contents();
    assert_eq!(
        contents.gaps,
        [small::gap(DEPTH_STREAM), small::gap(COLOR_STREAM)]
    );
    assert_eq!(contents.notes[0].text, "a note");
    assert_eq!(contents.events[0].details["exposure_us"], 8000);
    assert_eq!(contents.histograms[0].1.counts, [9, 1]);
    assert_eq!(contents.gravity[0].0, DEPTH_STREAM);
    let weak = &contents.pose_sets[0].poses[6];
    assert_eq!((weak.number, weak.state), (7, PoseState::Weak(0b100_001)));
    assert_eq!(weak.covariance.unwrap()[20], 20.0);
    let end = contents.end.as_ref().unwrap();
    assert_eq!(
        (
            end.reason.as_str(),
            end.streams[0].frames,
            end.streams[0].repeats
        ),
        ("complete", 10, 1)
    );
    assert_eq!(contents.damages, []);
}

#[test]
fn everything_comes_back_whatever_the_chunks_and_the_way_of_writing() {
    let folder = tempfile::tempdir().unwrap();
    for chunk_frames in [1, 3, 100] {
        let mapped = write_to(&folder, WritePath::Mapped, chunk_frames);
        let plain = write_to(&folder, WritePath::Pwrite, chunk_frames);
        assert_eq!(
            std::fs::read(&mapped).unwrap(),
            std::fs::read(&plain).unwrap()
        );
        assert_whole(&Recording::open(&mapped).unwrap());
    }
}

#[test]
fn a_summary_shows_histograms_and_events() {
    let folder = tempfile::tempdir().unwrap();
    let recording = Recording::open(&write_to(&folder, WritePath::Pwrite, 3)).unwrap();
    let summary = Summary::of(recording.contents(), recording.description());
    let json = serde_json::to_value(&summary).unwrap();
    let skew = serde_json::json!(
        {"stream": 0, "name": "pair-skew", "unit": "ms", "edges": [0.0, 1.0, 2.0], "counts": [9, 1]}
    );
    assert_eq!(json["histograms"], serde_json::json!([skew]));
    assert_eq!(json["event_count"], 1);
    let event = &recording.contents().events[0];
    let expected = serde_json::json!(
        {"stream": event.stream, "host_nanos": event.host_nanos.to_string(), "details": event.details}
    );
    assert_eq!(json["events"], serde_json::json!([expected]));
    let words = summary.to_string();
    let expected = "histogram: pair-skew, 10 values, p50 from 0 to 1 ms, p99 from 1 to 2 ms\n";
    assert!(words.contains(expected), "{words}");
    let word = event.details["event"].as_str().unwrap();
    assert!(words.contains(&format!("events: 1 {word}\n")), "{words}");
}

#[test]
fn quantiles_of_a_histogram_are_bins_whatever_the_file_says() {
    let of = |counts: &[u64]| Histogram {
        name: "x".to_owned(),
        unit: "ms".to_owned(),
        edges: vec![0.0, 1.0],
        counts: counts.to_vec(),
    };
    assert_eq!(of(&[]).quantile_bin(0.5), None);
    assert_eq!(of(&[0, 0]).quantile_bin(0.5), None);
    assert_eq!(of(&[0, 1, 0]).quantile_bin(0.0), Some(1));
    assert_eq!(of(&[50, 49, 1]).quantile_bin(0.5), Some(0));
    assert_eq!(of(&[50, 49, 1]).quantile_bin(0.99), Some(1));
    assert_eq!(of(&[50, 49, 1]).quantile_bin(1.0), Some(2));
    assert_eq!(of(&[u64::MAX, u64::MAX]).quantile_bin(0.99), Some(0));
    assert_eq!(of(&[u64::MAX, 7]).count(), u64::MAX);
}
