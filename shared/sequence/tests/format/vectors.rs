//! The committed vectors: what was written once stays readable, and what was damaged is named.

use std::path::{Path, PathBuf};

use sequence::Recording;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::memory::MemoryFile;
use super::tiny::Scene;
use super::{edit, holding};

/// An entry of `recordings/vectors/recordings/index.json`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Vector {
    pub(crate) name: String,
    file: String,
    edits: Vec<Value>,
    describes: String,
    pub(crate) refused: bool,
    holds: Map<String, Value>,
}

impl Vector {
    /// The file after its edits.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let read = |name: &str| std::fs::read(folder().join(name));
        edit::edited(&read, &self.file, &self.edits).unwrap()
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/vectors/recordings")
}

/// All vectors.
pub(crate) fn vectors() -> Vec<Vector> {
    let index = std::fs::read(folder().join("index.json")).unwrap();
    serde_json::from_slice(&index).unwrap()
}

#[test]
fn every_vector_holds_what_its_index_says() {
    let vectors = vectors();
    assert!(vectors.len() >= 50);
    for vector in vectors {
        let (name, describes) = (&vector.name, &vector.describes);
        match holding::read(&vector.bytes()) {
            Ok(found) => {
                assert!(!vector.refused, "{name} should be refused: {describes}");
                let found = found.values();
                for (key, value) in &vector.holds {
                    assert_eq!(found[key], *value, "{name}, {key}: {describes}");
                }
            }
            Err(error) => assert!(vector.refused, "{name} is refused: {error}: {describes}"),
        }
    }
}

#[test]
fn a_map_gives_the_frames_that_a_full_check_gives() {
    let folder = tempfile::tempdir().unwrap();
    for vector in vectors() {
        let bytes = vector.bytes();
        let path = folder.path().join(&vector.name);
        std::fs::write(&path, &bytes).unwrap();
        let opened = Recording::open(&path);
        assert_eq!(opened.is_err(), vector.refused, "{}", vector.name);
        let Ok(recording) = opened else { continue };
        let held = holding::read(&bytes).unwrap();
        let description = recording.description();
        let mut frame_count = 0;
        for place in recording.contents().stream(description.depth_id) {
            let key = (description.depth_id, place.label.number);
            let samples = recording.depth_frame(place).ok();
            let samples = samples.map(|image| holding::little_endian(image.pixels()));
            let expected = held.frames.get(&key).map(|frame| frame.samples.clone());
            assert_eq!(samples, expected, "{}, depth {}", vector.name, key.1);
            frame_count += usize::from(samples.is_some());
        }
        for place in recording.contents().stream(description.color_id) {
            let key = (description.color_id, place.label.number);
            let samples = recording.color_frame(place).ok();
            let expected = held.frames.get(&key).map(|frame| frame.samples.clone());
            assert_eq!(samples, expected, "{}, color {}", vector.name, key.1);
            frame_count += usize::from(samples.is_some());
        }
        assert_eq!(frame_count, held.frames.len(), "{}", vector.name);
    }
}

#[test]
fn what_is_written_today_holds_what_was_written_then() {
    let file = MemoryFile::default();
    Scene::default().write(file.layer()).unwrap();
    let today = holding::read(&file.bytes()).unwrap().values();
    let then = vectors()
        .iter()
        .find(|vector| vector.name == "three-chunks")
        .unwrap()
        .bytes();
    assert_eq!(today, holding::read(&then).unwrap().values());
}
