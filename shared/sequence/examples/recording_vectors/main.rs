//! Writes the conformance vectors of the recording: `recording_vectors FOLDER`.
//!
//! A vector is a file and, where it shows damage, edits of it: bytes that are xored or put, zeros, a cut. What it
//! must hold is computed from what was written, not by reading it. `index.json` says all of it in words.

use std::error::Error;
use std::path::{Path, PathBuf};

use sequence::codecs::DepthCodec;
use sequence::description::Part;
use sequence::record::RecordKind;
use sequence::{ColorEncoding, DepthSamples, FileId};
use serde_json::{Map, Value, json};

use crate::memory::{Fault, MemoryFile, Plan};
use crate::tiny::Scene;

mod damage;
#[path = "../../tests/format/edit.rs"]
mod edit;
mod foreign;
#[path = "../../tests/format/holding.rs"]
mod holding;
#[path = "../../tests/format/memory.rs"]
#[expect(dead_code, reason = "the tests use all of it")]
mod memory;
#[path = "../../tests/format/tiny.rs"]
mod tiny;
mod truth;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

struct Vectors {
    folder: PathBuf,
    index: Vec<Value>,
}

impl Vectors {
    /// Adds a vector: `file` after `edits` holds `holds`, or is refused where that is `None`.
    fn add(
        &mut self,
        name: &str,
        file: &str,
        edits: &[Value],
        holds: Option<Map<String, Value>>,
        describes: &str,
    ) -> Outcome {
        let read = |name: &str| std::fs::read(self.folder.join(name));
        let bytes = edit::edited(&read, file, edits)?;
        match (holding::read(&bytes), &holds) {
            (Ok(found), Some(holds)) => {
                let found = found.values();
                for (key, value) in holds {
                    if found[key] != *value {
                        return Err(format!("{name}: {key} is {}, not {value}", found[key]).into());
                    }
                }
            }
            (Err(_), None) => {}
            (found, _) => return Err(format!("{name}: {:?}", found.map(|_| "is read")).into()),
        }
        self.index.push(json!({
            "name": name, "file": file, "edits": edits, "describes": describes,
            "refused": holds.is_none(), "holds": holds.unwrap_or_default(),
        }));
        Ok(())
    }

    /// Writes a file of the vectors.
    fn file(&self, name: &str, bytes: &[u8]) -> Outcome {
        Ok(std::fs::write(self.folder.join(name), bytes)?)
    }

    /// A closed recording of `scene` that holds all of it.
    fn whole(&mut self, name: &str, scene: &Scene, describes: &str) -> Outcome {
        let file = format!("{name}.glint");
        self.file(&file, &written(scene)?)?;
        let holds = truth::everything(scene);
        self.add(name, &file, &[], Some(holds), describes)
    }
}

/// The bytes of a closed recording of `scene`.
fn written(scene: &Scene) -> Outcome<Vec<u8>> {
    let file = MemoryFile::default();
    scene.write(file.layer())?;
    Ok(file.bytes())
}

fn main() -> Outcome {
    let folder = std::env::args()
        .nth(1)
        .ok_or("give the folder to write to")?;
    let mut vectors = Vectors {
        folder: Path::new(&folder).to_owned(),
        index: Vec::new(),
    };
    std::fs::create_dir_all(&vectors.folder)?;
    formats(&mut vectors)?;
    kinds(&mut vectors)?;
    never_closed(&mut vectors)?;
    void_chunk(&mut vectors)?;
    damage::of_headers(&mut vectors)?;
    damage::of_chunks(&mut vectors)?;
    damage::of_records(&mut vectors)?;
    damage::of_length(&mut vectors)?;
    foreign::bytes(&mut vectors)?;
    foreign::claims(&mut vectors)?;
    infrared(&mut vectors)?;
    let index = serde_json::to_string_pretty(&vectors.index)?;
    std::fs::write(vectors.folder.join("index.json"), index + "\n")?;
    println!("{} vectors", vectors.index.len());
    Ok(())
}

/// Both tables and all frames in one chunk.
fn dense_yuyv() -> Scene {
    Scene {
        codec: DepthCodec::Dense,
        encoding: ColorEncoding::Yuyv,
        seal_after: Vec::new(),
        ..Scene::default()
    }
}

/// Every format of both streams.
fn formats(vectors: &mut Vectors) -> Outcome {
    let describes = "three chunks with a record of every kind: depth in values by two tables, a Bayer mosaic, a \
        gap, a repeat, poses of which the later holds, a kind of a later version";
    vectors.whole("three-chunks", &Scene::default(), describes)?;
    let one_chunk = || Scene {
        seal_after: Vec::new(),
        ..Scene::default()
    };
    vectors.whole(
        "codes-uyvy",
        &Scene {
            samples: DepthSamples::Codes,
            encoding: ColorEncoding::Uyvy,
            ..one_chunk()
        },
        "depth in codes, fast, without a table; UYVY",
    )?;
    vectors.whole(
        "dense-yuyv",
        &dense_yuyv(),
        "depth in values by two tables, dense; YUYV",
    )?;
    vectors.whole(
        "noise-rgb8",
        &Scene {
            is_noise: true,
            encoding: ColorEncoding::Rgb8,
            ..one_chunk()
        },
        "noise that no codec makes smaller: both streams are raw; RGB8",
    )?;
    vectors.whole(
        "jpeg",
        &Scene {
            encoding: ColorEncoding::Jpeg,
            ..one_chunk()
        },
        "colour as JPEG files, kept byte for byte",
    )
}

/// Infrared in place of colour. It came later: the vectors before it keep their places.
fn infrared(vectors: &mut Vectors) -> Outcome {
    let scene = Scene {
        samples: DepthSamples::Codes,
        encoding: ColorEncoding::Infrared10,
        seal_after: Vec::new(),
        ..Scene::default()
    };
    vectors.whole("infrared", &scene, "depth in codes; infrared of 10 bits")
}

/// A split with a key of a later version; that it is the only one does not matter to a reader.
const LATER_SPLIT: &[u8] = br#"{"train":[0],"unused":[],"test":[1],"later":{"why":"a new key"}}"#;

/// Other files that are whole, or that a reader must refuse.
fn kinds(vectors: &mut Vectors) -> Outcome {
    let one_chunk = || Scene {
        seal_after: Vec::new(),
        ..Scene::default()
    };
    vectors.whole(
        "part-two",
        &Scene {
            file_id: FileId(*b"its second file "),
            part: Some(Part {
                number: 2,
                first_file_id: Scene::default().file_id,
            }),
            ..one_chunk()
        },
        "the second file of a recording that was split",
    )?;
    vectors.whole(
        "shuffled-times",
        &Scene {
            is_shuffled: true,
            ..Scene::default()
        },
        "device times that go back and come twice: frames are in the order of their numbers",
    )?;
    let scene = Scene {
        extra: Some((RecordKind::Split as u16, LATER_SPLIT.to_vec())),
        ..one_chunk()
    };
    vectors.whole(
        "later-key",
        &scene,
        "a key of a later version in a split: ignored; of two splits the later holds",
    )?;
    let scene = Scene {
        extra: Some((0x8200, b"read me or refuse".to_vec())),
        ..one_chunk()
    };
    vectors.file("must-understand.glint", &written(&scene)?)?;
    vectors.add(
        "must-understand",
        "must-understand.glint",
        &[],
        None,
        "a record of an unknown kind with bit 15: refused",
    )
}

/// A recorder that died behind its first two chunks, with the records of the third in the file.
fn never_closed(vectors: &mut Vectors) -> Outcome {
    let scene = Scene::default();
    let file = MemoryFile::default();
    let mut writer = scene.begin(file.layer())?;
    scene.write_frames(&mut writer)?;
    drop(writer);
    let mut bytes = file.bytes();
    // Space that was reserved: a page of it is enough to see.
    let content = bytes.iter().rposition(|byte| *byte != 0).unwrap_or(0) + 1;
    bytes.truncate(content.next_multiple_of(4096) + 4096);
    vectors.file("never-closed.glint", &bytes)?;
    let mut holds = truth::without(&scene, &[(1, 5), (2, 5)]);
    holds.insert("end".to_owned(), Value::Null);
    holds.insert("damages".to_owned(), json!(["tail"]));
    // Description, table, pose set; the unknown kind, both frames, poses.
    holds.insert("tail".to_owned(), json!(7));
    let describes = "the recorder died: the third chunk was never sealed, reserved space follows";
    vectors.add(
        "never-closed",
        "never-closed.glint",
        &[],
        Some(holds),
        describes,
    )
}

/// A disk that refused to keep the second chunk.
fn void_chunk(vectors: &mut Vectors) -> Outcome {
    let scene = Scene::default();
    // Syncs are few among the calls: the first of the second chunk is found by trying.
    for call in 1..10_000 {
        let file = MemoryFile::failing(Plan {
            fault: Fault::Broken,
            call,
            is_lasting: false,
        });
        let is_written = scene.write(file.layer()).is_ok();
        let bytes = file.bytes();
        let Ok(found) = holding::read(&bytes) else {
            continue;
        };
        if is_written && !found.frames.contains_key(&(1, 4)) && found.frames.contains_key(&(1, 0)) {
            vectors.file("void-chunk.glint", &bytes)?;
            let mut holds = truth::without(&scene, &[(1, 2), (1, 4), (2, 2), (2, 4)]);
            let mut gaps = Vec::new();
            for stream in [1, 2] {
                let unknown = format!("{} {}", i64::MIN, i64::MAX);
                gaps.push(format!("{stream} 2 1 {unknown} disk-error "));
                gaps.push(holding::gap_line(&scene.gap(stream)));
                gaps.push(format!("{stream} 4 1 {unknown} disk-error "));
            }
            holds.insert("gaps".to_owned(), json!(gaps));
            let describes = "the disk refused the second chunk: it is void, its frames are in gaps";
            return vectors.add(
                "void-chunk",
                "void-chunk.glint",
                &[],
                Some(holds),
                describes,
            );
        }
    }
    Err("no call made the second chunk void".into())
}
