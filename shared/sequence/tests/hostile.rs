//! No file makes the reader panic, and none that is damaged gives other data.

mod small;

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use imaging::{Image, Rgb8Image};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use rustix::fs::{FlockOperation, flock};
use sequence::layout::{FrameEntry, HEADER_BYTES, Header, PoseEntry, Section};
use sequence::{PoseSet, Recording, SequenceError, Split};
use small::Small;
use zerocopy::{FromBytes as _, IntoBytes as _};

/// All that a reader can learn from a file.
#[derive(Debug, PartialEq)]
struct Everything {
    streams: String,
    times_nanos: Vec<i64>,
    depth: Vec<Image<u16>>,
    color: Vec<Rgb8Image>,
    is_subsampled: Vec<bool>,
    pose_sets: Vec<PoseSet>,
    split: Split,
}

fn read_all(path: &Path) -> Result<Everything, SequenceError> {
    let recording = Recording::open(path)?;
    let frames = 0..recording.frame_count();
    Ok(Everything {
        streams: format!(
            "{:?} {:?} {:?}",
            recording.depth_camera(),
            recording.color_camera(),
            recording.color_from_depth()
        ),
        times_nanos: frames.clone().map(|k| recording.time_nanos(k)).collect(),
        depth: frames
            .clone()
            .map(|k| recording.depth_raw(k))
            .collect::<Result<_, _>>()?,
        color: frames
            .clone()
            .map(|k| recording.color(k))
            .collect::<Result<_, _>>()?,
        is_subsampled: frames
            .map(|k| recording.color_is_subsampled(k))
            .collect::<Result<_, _>>()?,
        pose_sets: recording.pose_sets().to_vec(),
        split: recording.split().clone(),
    })
}

#[test]
fn every_truncation_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let bytes = Small::new().write(&path).unwrap();
    for length in (0..bytes).rev() {
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(length).unwrap();
        drop(file);
        assert!(
            Recording::open(&path).is_err(),
            "cut to {length} of {bytes}"
        );
    }
}

#[test]
fn every_flipped_bit_is_an_error_or_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let whole = read_all(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let file = OpenOptions::new().write(true).open(&path).unwrap();
    let mut noticed_count = 0;
    for (offset, &byte) in bytes.iter().enumerate() {
        for bit in 0..8 {
            file.write_all_at(&[byte ^ (1 << bit)], offset as u64)
                .unwrap();
            match read_all(&path) {
                Ok(read) => assert_eq!(read, whole, "bit {bit} of byte {offset}"),
                Err(_) => noticed_count += 1,
            }
        }
        file.write_all_at(&[byte], offset as u64).unwrap();
    }
    // No byte of the file is outside all checksums.
    assert_eq!(noticed_count, 8 * bytes.len());
}

#[test]
fn a_flipped_bit_in_a_payload_costs_one_frame_and_says_which() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    let small = Small::new();
    small.write(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = HEADER_BYTES + small.depth_png[0].len() + small.color_jpeg[0].len() + 40;
    bytes[at] ^= 4;
    std::fs::write(&path, &bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.depth_raw(0).unwrap(), small.depth[0]);
    assert_eq!(recording.depth_raw(2).unwrap(), small.depth[2]);
    assert!(recording.color(1).is_ok());
    let error = recording.depth_raw(1).unwrap_err().to_string();
    assert!(
        error.contains("depth of frame 1") && error.contains("CRC-32C"),
        "{error}"
    );
}

/// The parts of a file that were taken apart to lie with valid checksums.
struct Parts {
    payloads: Vec<u8>,
    description: String,
    frames: Vec<FrameEntry>,
    poses: Vec<PoseEntry>,
}

impl Parts {
    fn of(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let (header, _) = Header::ref_from_prefix(&bytes).unwrap();
        let part = |section: &Section| section.read(&bytes, "a part").unwrap();
        let description = part(&header.description);
        Self {
            payloads: bytes[HEADER_BYTES..header.description.offset.get() as usize].to_vec(),
            description: String::from_utf8(description.to_vec()).unwrap(),
            frames: <[FrameEntry]>::ref_from_bytes(part(&header.frames))
                .unwrap()
                .to_vec(),
            poses: <[PoseEntry]>::ref_from_bytes(part(&header.poses))
                .unwrap()
                .to_vec(),
        }
    }

    fn write(&self, path: &Path) {
        let mut bytes = vec![0; HEADER_BYTES];
        bytes.extend(&self.payloads);
        let mut append = |content: &[u8]| {
            let section = Section::of(bytes.len() as u64, content).unwrap();
            bytes.extend(content);
            section
        };
        let description = append(self.description.as_bytes());
        let frames = append(self.frames.as_bytes());
        let poses = append(self.poses.as_bytes());
        let header = Header::sealed(bytes.len() as u64, description, frames, poses);
        bytes[..HEADER_BYTES].copy_from_slice(header.as_bytes());
        std::fs::write(path, bytes).unwrap();
    }
}

/// Reads everything after `lie` and returns the sentence of the error.
fn sentence_after(lie: impl FnOnce(&mut Parts)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let mut parts = Parts::of(&path);
    lie(&mut parts);
    parts.write(&path);
    read_all(&path).unwrap_err().to_string()
}

fn edit(from: &str, to: &str) -> String {
    sentence_after(|parts| {
        assert!(parts.description.contains(from), "{}", parts.description);
        parts.description = parts.description.replacen(from, to, 1);
    })
}

#[test]
fn lies_under_valid_checksums_are_refused() {
    let cases = [
        (
            sentence_after(|p| p.frames[1].depth.offset = u64::MAX.into()),
            "cannot be",
        ),
        (
            sentence_after(|p| p.frames[1].depth.offset = (1 << 40).into()),
            "cannot be",
        ),
        (
            sentence_after(|p| p.frames[2].color.bytes = u32::MAX.into()),
            "cannot be",
        ),
        (
            sentence_after(|p| p.frames[0].color = p.frames[0].depth),
            "color of frame 0",
        ),
        (
            sentence_after(|p| p.frames[0].depth.bytes = 0.into()),
            "depth of frame 0",
        ),
        (
            sentence_after(|p| p.frames[2].time_nanos = i64::MIN.into()),
            "not after",
        ),
        (
            sentence_after(|p| p.frames[1].time_nanos = p.frames[0].time_nanos),
            "not after",
        ),
        (
            sentence_after(|p| p.poses[0].rotation[2] = f64::NAN.into()),
            "pose 0 of set `source`",
        ),
        (
            sentence_after(|p| p.poses[1].rotation = [0.0.into(); 4]),
            "pose 1 of set `source`",
        ),
        (
            sentence_after(|p| p.poses[3].state = 2.into()),
            "state of a stored pose",
        ),
        (
            sentence_after(|p| {
                let _ = p.poses.pop();
            }),
            "5 stored poses for 6",
        ),
        (
            sentence_after(|p| {
                let _ = p.frames.pop();
            }),
            "the split names frame 2",
        ),
        (
            sentence_after(|p| p.description.clear()),
            "description of the streams",
        ),
        (
            sentence_after(|p| p.description = "[".repeat(100_000)),
            "description of the streams",
        ),
        (
            edit("\"width\": 12", "\"width\": 13"),
            "12x9 pixels, the camera 13x9",
        ),
        (
            edit("\"width\": 12", "\"width\": 4294967295"),
            "depth camera",
        ),
        (
            edit("\"scale_m\": 0.001", "\"scale_m\": 1e999"),
            "description of the streams",
        ),
        (
            edit("\"scale_m\": 0.001", "\"scale_m\": 0.0"),
            "the depth scale is 0",
        ),
        (edit("\"gamma\": 2.2", "\"gamma\": -2.2"), "response gamma"),
        (edit("\"source\",", "\"live\","), "`live` cannot name"),
        (edit("\"source\",", "\"sour\\u0000ce\","), "cannot name"),
        (edit("\"scale_m\"", "\"scale\""), "unknown field `scale`"),
        (edit("png16", "png17"), "unknown variant"),
        (
            edit("\"radius\": 9.0", "\"radius\": -9.0"),
            "vignetting radius",
        ),
        (
            edit("\"relative_exposure\": 0.7", "\"relative_exposure\": 0.0"),
            "relative exposure",
        ),
    ];
    for (sentence, expected) in cases {
        assert!(
            sentence.contains(expected) && sentence.contains("small.glint"),
            "expected `{expected}` in: {sentence}"
        );
    }
}

#[test]
fn random_bytes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.glint");
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for length in [0, 1, 31, 32, 33, 103, 104, 105, 5000] {
        let mut bytes: Vec<u8> = (0..length).map(|_| random.random()).collect();
        std::fs::write(&path, &bytes).unwrap();
        assert!(Recording::open(&path).is_err());
        // The same behind a true beginning.
        let known = sequence::layout::MAGIC.len().min(length);
        bytes[..known].copy_from_slice(&sequence::layout::MAGIC[..known]);
        std::fs::write(&path, &bytes).unwrap();
        assert!(Recording::open(&path).is_err());
    }
}

#[test]
fn what_is_no_file_is_refused_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.glint");
    for path in [folder.path(), Path::new("/dev/null"), &missing] {
        let error = Recording::open(path).unwrap_err().to_string();
        assert!(error.contains(path.to_str().unwrap()), "{error}");
    }
}

#[test]
fn a_file_that_someone_writes_is_not_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let writer = File::open(&path).unwrap();
    flock(&writer, FlockOperation::LockExclusive).unwrap();
    let error = Recording::open(&path).unwrap_err().to_string();
    assert!(error.contains("another program is writing"), "{error}");
    drop(writer);
    assert!(Recording::open(&path).is_ok());
}

#[test]
fn a_frame_beyond_the_end_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let recording = Recording::open(&path).unwrap();
    let error = recording.color(3).unwrap_err().to_string();
    assert!(
        error.contains("frame 3 does not exist, the recording has 3"),
        "{error}"
    );
}

#[test]
fn another_version_is_refused_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glint");
    Small::new().write(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[25] = b'1';
    std::fs::write(&path, &bytes).unwrap();
    let error = Recording::open(&path).unwrap_err().to_string();
    assert!(error.contains("not of version 0"), "{error}");
}
