//! What the cameras say of themselves, as a file for tests.

use std::path::Path;

use ps1080::parameter::PARAMETERS;
use ps1080::stream::StreamKind;
use serde_json::{Value, json};
use virtual_carmine::VirtualCarmine;

/// One camera's counters, the frames that were delivered whole (number on the film, stamp), its parameters, whether its
/// emitter is on.
pub(crate) fn camera(camera: &VirtualCarmine, unplugged_nanos: Option<i64>) -> Value {
    let delivered = |stream| -> Vec<Value> {
        let frames = camera.delivered(stream).iter();
        frames
            .map(|frame| json!([frame.film_index, frame.ticks]))
            .collect()
    };
    let parameters: serde_json::Map<String, Value> = PARAMETERS
        .iter()
        .map(|&parameter| (format!("{parameter:?}"), camera.parameter(parameter).into()))
        .collect();
    json!({
        "counters": camera.counters(),
        "depth_delivered": delivered(StreamKind::Depth),
        "image_delivered": delivered(StreamKind::Image),
        "parameters": parameters,
        "is_lit": camera.is_lit(),
        "is_gone": camera.is_gone(),
        "unplugged_nanos": unplugged_nanos,
    })
}

/// Writes the file, with the processor time that the cameras took of the process that they are in; a failure is said on standard error, since there is nobody else to tell.
pub(crate) fn write(path: &Path, cameras: &[Value], cpu_nanos: i64) {
    let text = json!({ "cameras": cameras, "camera_cpu_nanos": cpu_nanos }).to_string();
    let beside = path.with_extension("part");
    let written = std::fs::write(&beside, text).and_then(|()| std::fs::rename(&beside, path));
    if let Err(error) = written {
        eprintln!("virtual cameras: {}: {error}", path.display());
    }
}
