//! `frames.json`: what a recording holds beside its images. Integers that may exceed 2^53 are strings.

use sequence::contents::StoredPoses;
use sequence::{Event, FramePose, FrameTimes, Gap, PoseState};
use serde_json::{Value, json};

use super::files::{FrameFiles, StreamKind};
use super::pairs::WrittenPair;

/// An image without a partner.
pub(crate) struct SingleFrame {
    pub(crate) kind: StreamKind,
    pub(crate) name: String,
    pub(crate) times: FrameTimes,
}

/// Largest integer that JSON readers with f64 numbers keep.
const LARGEST_EXACT: u64 = 1 << 53;

/// The text of the file.
pub(crate) fn frames_json(
    files: &FrameFiles,
    pairs: &[WrittenPair],
    singles: &[SingleFrame],
) -> anyhow::Result<String> {
    let contents = files.recording.contents();
    let description: Value = serde_json::from_slice(&files.recording.description().to_json()?)?;
    let color = files.extension(StreamKind::Color);
    let pairs: Vec<Value> = (0..)
        .zip(pairs)
        .map(|(number, pair): (usize, _)| {
            json!({
                "depth_file": format!("frames/{number:06}.depth.png"),
                "color_file": format!("frames/{number:06}.color.{color}"),
                "depth": times(&pair.depth),
                "color": times(&pair.color),
            })
        })
        .collect();
    let singles: Vec<Value> = singles.iter().map(single).collect();
    let gravity: Vec<Value> = contents
        .gravity
        .iter()
        .map(|(stream, gravity)| {
            json!({
                "stream": stream,
                "number": integer(gravity.number),
                "down": gravity.down.to_array(),
                "sigma_rad": gravity.sigma,
            })
        })
        .collect();
    let notes: Vec<Value> = contents
        .notes
        .iter()
        .map(|note| json!({"host_nanos": note.host_nanos.to_string(), "text": note.text}))
        .collect();
    let value = json!({
        "about": "times in nanoseconds; metres; poses are world from camera, quaternions x y z w",
        "description": description,
        "pairs": pairs,
        "unpaired": singles,
        "gaps": contents.gaps.iter().map(gap).collect::<Vec<_>>(),
        "events": contents.events.iter().map(event).collect::<Vec<_>>(),
        "notes": notes,
        "gravity": gravity,
        "histograms": contents.histograms.iter().map(|(_, histogram)| histogram).collect::<Vec<_>>(),
        "pose_sets": contents.pose_sets.iter().map(pose_set).collect::<Vec<_>>(),
        "split": contents.split,
        "end": contents.end,
    });
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

/// A number of a frame: a number as long as every reader keeps it.
fn integer(value: u64) -> Value {
    if value <= LARGEST_EXACT {
        json!(value)
    } else {
        json!(value.to_string())
    }
}

fn times(times: &FrameTimes) -> Value {
    json!({
        "number": integer(times.number),
        "device_ticks": times.device_ticks.map(|ticks| ticks.to_string()),
        "device_nanos": times.device_nanos.to_string(),
        "host_nanos": times.host_nanos.map(|nanos| nanos.map(|nanos| nanos.to_string())),
        "is_repeat": times.is_repeat,
    })
}

fn single(frame: &SingleFrame) -> Value {
    let stream = match frame.kind {
        StreamKind::Depth => "depth",
        StreamKind::Color => "color",
    };
    let mut value = times(&frame.times);
    value["stream"] = json!(stream);
    value["file"] = json!(frame.name);
    value
}

fn gap(gap: &Gap) -> Value {
    json!({
        "stream": gap.stream,
        "first_number": integer(gap.first_number),
        "count": integer(gap.count),
        "from_nanos": gap.from_nanos.map(|nanos| nanos.to_string()),
        "to_nanos": gap.to_nanos.map(|nanos| nanos.to_string()),
        "cause": gap.cause,
        "note": gap.note,
    })
}

fn event(event: &Event) -> Value {
    json!({
        "stream": event.stream,
        "host_nanos": event.host_nanos.to_string(),
        "details": event.details,
    })
}

fn pose_set(set: &StoredPoses) -> Value {
    json!({
        "name": set.head.name,
        "producer": set.head.producer,
        "stream": set.head.stream,
        "poses": set.poses.iter().map(pose).collect::<Vec<_>>(),
    })
}

fn pose(pose: &FramePose) -> Value {
    let (state, weak_axes) = match pose.state {
        PoseState::Ok => ("ok", None),
        PoseState::Weak(axes) => ("weak", Some(axes)),
        PoseState::Lost => ("lost", None),
    };
    json!({
        "number": integer(pose.number),
        "map": pose.map,
        "state": state,
        "weak_axes": weak_axes,
        "rotation": pose.world_from_camera.rotation().to_array(),
        "translation": pose.world_from_camera.translation().to_array(),
        "covariance": pose.covariance,
    })
}
