//! What a recording of a scene must hold.

use std::collections::{BTreeMap, BTreeSet};

use sequence::record::RecordKind;
use sequence::{COLOR_STREAM, DEPTH_STREAM, DepthSamples};
use serde_json::{Map, Value, json};

use crate::holding::{self, Frame, frame_lines, little_endian};
use crate::tiny::{NEW_VALUES, REPEAT, Scene};

/// All of a closed recording without damage.
pub(crate) fn everything(scene: &Scene) -> Map<String, Value> {
    let description = scene.description();
    let part = description.part.map(|part| {
        let digits = part.first_file_id.0.map(|byte| format!("{byte:02x}"));
        json!({"number": part.number, "first_file_id": digits.concat()})
    });
    let event = scene.event();
    let frame_count = scene.numbers().count();
    let totals = |id: u16| {
        let repeats =
            u8::from(id == DEPTH_STREAM && scene.numbers().any(|number| number == REPEAT));
        json!({"id": id, "frames": frame_count, "repeats": repeats, "missing": 1})
    };
    let note = scene.note();
    let extra = scene.extra.iter().map(|(kind, _)| *kind);
    let gaps = [DEPTH_STREAM, COLOR_STREAM].map(|stream| holding::gap_line(&scene.gap(stream)));
    let value = json!({
        "streams": holding::stream_lines(&description),
        "part": part,
        "tables": tables(scene),
        "frames": frames(scene, &[]),
        "gaps": gaps,
        "events": [[json!(event.stream), json!(event.host_nanos), event.details]],
        "pose_sets": [{"id": 1, "name": "source", "producer": "glint vectors", "stream": 1}],
        "poses": scene.numbers().map(|number| holding::pose_line(1, &scene.pose(number))).collect::<Vec<_>>(),
        "gravity": [holding::gravity_line(DEPTH_STREAM, &scene.gravity())],
        "histograms": [scene.histogram()],
        "notes": [[json!(note.host_nanos), json!(note.text)]],
        "split": scene.split(),
        "end": {"reason": "complete", "streams": [totals(DEPTH_STREAM), totals(COLOR_STREAM)]},
        "unknown": extra.filter(|kind| RecordKind::from_number(*kind).is_none()).collect::<Vec<_>>(),
        "lost": [],
        "damages": [],
        "tail": 0,
    });
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

/// What a damaged recording holds of its frames; the other keys are for the caller to state.
pub(crate) fn without(scene: &Scene, gone: &[(u16, u64)]) -> Map<String, Value> {
    Map::from_iter([("frames".to_owned(), frames(scene, gone))])
}

fn frames(scene: &Scene, gone: &[(u16, u64)]) -> Value {
    let mut frames = BTreeMap::new();
    for stream in [DEPTH_STREAM, COLOR_STREAM] {
        for number in scene
            .numbers()
            .filter(|number| !gone.contains(&(stream, *number)))
        {
            let samples = if stream == DEPTH_STREAM {
                little_endian(&scene.depth(number))
            } else {
                scene.color(number)
            };
            let times = scene.times(stream, number);
            frames.insert((stream, number), Frame { times, samples });
        }
    }
    frame_lines(&scene.description(), frames.iter())
}

/// Tables of codes that the depth needs: `stream id values`.
fn tables(scene: &Scene) -> Vec<String> {
    if scene.is_noise || scene.samples == DepthSamples::Codes {
        return Vec::new();
    }
    let values = |end_number: u64| {
        let numbers = scene.numbers().filter(|number| *number < end_number);
        let samples: BTreeSet<u16> = numbers.flat_map(|number| scene.depth(number)).collect();
        samples.len() - 1
    };
    vec![
        format!("{DEPTH_STREAM} 1 {}", values(NEW_VALUES)),
        format!("{DEPTH_STREAM} 2 {}", values(scene.end_number)),
    ]
}
