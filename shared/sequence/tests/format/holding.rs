//! All that a file holds, in the words of `recordings/vectors/recordings/index.json`.

use std::collections::BTreeMap;

use sequence::codecs::{ColorDecoder, DepthDecoder, depth_table_id};
use sequence::layout::FrameHeader;
use sequence::record::RecordKind;
use sequence::scan::{Checking, Damage, RecordPlace, Scanner};
use sequence::{Contents, Description, FileId, FramePose, FrameTimes, PoseState, SequenceError};
use serde_json::{Value, json};
use zerocopy::FromBytes as _;

/// What is read of a file: one value for each key of the index.
#[derive(Clone, Debug)]
pub(crate) struct Holding {
    pub(crate) contents: Contents,
    pub(crate) description: Description,
    /// Frames that decode, by stream and number.
    pub(crate) frames: BTreeMap<(u16, u64), Frame>,
    /// Records that are lost: `stream number` of frames, `kind n` of others.
    pub(crate) lost: Vec<String>,
    pub(crate) unknown: Vec<u16>,
}

/// A frame that was decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    pub(crate) times: FrameTimes,
    /// Samples as bytes; of JPEG the file.
    pub(crate) samples: Vec<u8>,
}

/// Reads everything; an error where the file is refused.
pub(crate) fn read(bytes: &[u8]) -> Result<Holding, SequenceError> {
    let contents = Contents::read(bytes, Checking::Everything)?;
    let description = contents
        .description
        .clone()
        .ok_or(SequenceError::NoDescription)?;
    let mut lost = Vec::new();
    for damage in &contents.damages {
        if let Damage::Record { label, .. } = damage {
            lost.push(if label.kind == RecordKind::Frame as u16 {
                format!("{} {}", label.stream, label.number)
            } else {
                format!("kind {}", label.kind)
            });
        }
    }
    let mut unknown = Vec::new();
    let mut scanner = Scanner::begin(bytes, Checking::Everything)?;
    while let Some(chunk) = scanner.next_chunk()? {
        let kinds = chunk.records.iter().map(|place| place.label.kind);
        unknown.extend(kinds.filter(|kind| RecordKind::from_number(*kind).is_none()));
    }
    let mut frames = BTreeMap::new();
    for (&stream, places) in &contents.frames {
        for place in places {
            match frame(&scanner, &contents, &description, place) {
                Ok(Some(frame)) => {
                    frames.insert((stream, place.label.number), frame);
                }
                Ok(None) => {}
                Err(_) => lost.push(format!("{stream} {}", place.label.number)),
            }
        }
    }
    lost.sort();
    unknown.sort_unstable();
    Ok(Holding {
        contents,
        description,
        frames,
        lost,
        unknown,
    })
}

/// A frame with its samples; `None` of a stream that is not described.
pub(crate) fn frame(
    scanner: &Scanner<'_, [u8]>,
    contents: &Contents,
    description: &Description,
    place: &RecordPlace,
) -> Result<Option<Frame>, SequenceError> {
    let damaged = || SequenceError::Damaged {
        offset: place.offset,
    };
    let payload = scanner.payload(place)?.ok_or_else(damaged)?;
    let (header, image) = FrameHeader::ref_from_prefix(&payload).map_err(|_| damaged())?;
    let stream = place.label.stream;
    let samples = if stream == description.depth_id {
        depth_samples(contents, description, stream, image)?
    } else if stream == description.color_id {
        color_samples(description, image)?
    } else {
        return Ok(None);
    };
    let flags = header.flags.get();
    let times = FrameTimes {
        number: header.number.get(),
        device_ticks: (flags & 2 != 0).then(|| header.device_ticks.get()),
        device_nanos: header.device_nanos.get(),
        host_nanos: (flags & 4 != 0)
            .then(|| [header.host_first_nanos.get(), header.host_last_nanos.get()]),
        is_repeat: flags & 1 != 0,
    };
    Ok(Some(Frame { times, samples }))
}

fn depth_samples(
    contents: &Contents,
    description: &Description,
    stream: u16,
    image: &[u8],
) -> Result<Vec<u8>, SequenceError> {
    let table = match depth_table_id(image)? {
        Some(id) => {
            let table = contents.tables.get(&(stream, id));
            Some(table.ok_or(SequenceError::NoTable { id })?)
        }
        None => None,
    };
    let camera = &description.streams.depth.intrinsics;
    let mut samples = vec![0; (camera.width() * camera.height()) as usize];
    DepthDecoder::new(camera.width(), camera.height())?.decode(image, table, &mut samples)?;
    Ok(little_endian(&samples))
}

fn color_samples(description: &Description, image: &[u8]) -> Result<Vec<u8>, SequenceError> {
    let color = &description.streams.color;
    let (width, height) = (color.intrinsics.width(), color.intrinsics.height());
    let Some(format) = color.encoding.lossless() else {
        return Ok(image.to_vec());
    };
    let mut samples = vec![0; format.frame_bytes(width, height)?];
    ColorDecoder::new(format, width, height)?.decode(image, &mut samples)?;
    Ok(samples)
}

impl Holding {
    /// The values of the index.
    pub(crate) fn values(&self) -> Value {
        let Self {
            contents,
            description,
            ..
        } = self;
        let part = description
            .part
            .map(|part| json!({"number": part.number, "first_file_id": hex(part.first_file_id)}));
        let table = |(&(stream, id), table): (&(u16, u16), &sequence::codecs::CodeTable)| {
            format!("{stream} {id} {}", table.values().len())
        };
        let event =
            |event: &sequence::Event| json!([event.stream, event.host_nanos, event.details]);
        let mut gaps: Vec<String> = contents.gaps.iter().map(gap_line).collect();
        gaps.sort();
        let gravity = contents
            .gravity
            .iter()
            .map(|(stream, gravity)| gravity_line(*stream, gravity));
        let mut damages: Vec<&str> = contents.damages.iter().map(damage_word).collect();
        damages.sort_unstable();
        json!({
            "streams": stream_lines(description),
            "part": part,
            "tables": contents.tables.iter().map(table).collect::<Vec<_>>(),
            "frames": frame_lines(description, self.frames.iter()),
            "gaps": gaps,
            "events": contents.events.iter().map(event).collect::<Vec<_>>(),
            "pose_sets": contents.pose_sets.iter().map(|set| json!(set.head)).collect::<Vec<_>>(),
            "poses": pose_lines(contents),
            "gravity": gravity.collect::<Vec<_>>(),
            "histograms": contents.histograms.iter().map(|(_, histogram)| histogram).collect::<Vec<_>>(),
            "notes": contents.notes.iter().map(|note| json!([note.host_nanos, note.text])).collect::<Vec<_>>(),
            "split": contents.split,
            "end": contents.end,
            "unknown": self.unknown,
            "lost": self.lost,
            "damages": damages,
            "tail": contents.tail.len(),
        })
    }
}

pub(crate) fn stream_lines(description: &Description) -> Vec<String> {
    let (depth, color) = (&description.streams.depth, &description.streams.color);
    let format = serde_json::to_value(depth.samples).unwrap();
    let line = |id, kind, format: &str, camera: &geometry::Intrinsics| {
        format!(
            "{id} {kind} {format} {}x{}",
            camera.width(),
            camera.height()
        )
    };
    let format = format.as_str().unwrap();
    vec![
        line(description.depth_id, "depth", format, &depth.intrinsics),
        line(
            description.color_id,
            "color",
            color.encoding.name(),
            &color.intrinsics,
        ),
    ]
}

/// Frames of both streams, a line each.
pub(crate) fn frame_lines<'a>(
    description: &Description,
    frames: impl Iterator<Item = (&'a (u16, u64), &'a Frame)>,
) -> Value {
    let mut lines = BTreeMap::from([
        (description.depth_id.to_string(), Vec::new()),
        (description.color_id.to_string(), Vec::new()),
    ]);
    for ((stream, _), frame) in frames {
        let of_stream = lines.entry(stream.to_string()).or_default();
        of_stream.push(frame.line());
    }
    json!(lines)
}

impl Frame {
    fn line(&self) -> String {
        let FrameTimes {
            number,
            device_ticks,
            device_nanos,
            host_nanos,
            is_repeat,
        } = self.times;
        let [first, last] = host_nanos.unwrap_or_default();
        let flags = u8::from(is_repeat)
            + 2 * u8::from(device_ticks.is_some())
            + 4 * u8::from(host_nanos.is_some());
        let ticks = device_ticks.unwrap_or_default();
        let crc = crc32(&self.samples);
        format!("{number} {ticks} {device_nanos} {first} {last} {flags} {crc:08x}")
    }
}

pub(crate) fn gap_line(gap: &sequence::Gap) -> String {
    let (from, to) = (
        gap.from_nanos.unwrap_or(i64::MIN),
        gap.to_nanos.unwrap_or(i64::MAX),
    );
    let cause = gap
        .cause
        .map_or_else(String::new, |cause| cause.to_string());
    format!(
        "{} {} {} {from} {to} {cause} {}",
        gap.stream, gap.first_number, gap.count, gap.note
    )
}

pub(crate) fn gravity_line(stream: u16, gravity: &sequence::Gravity) -> String {
    let down = gravity.down;
    format!(
        "{stream} {} {:.6} {:.6} {:.6} {:.6}",
        gravity.number, down.x, down.y, down.z, gravity.sigma
    )
}

fn pose_lines(contents: &Contents) -> Vec<String> {
    let mut lines = Vec::new();
    for set in &contents.pose_sets {
        for pose in &set.poses {
            lines.push(pose_line(set.head.id, pose));
        }
    }
    lines
}

pub(crate) fn pose_line(set: u16, pose: &FramePose) -> String {
    let (state, axes) = match pose.state {
        PoseState::Ok => (1, 0),
        PoseState::Weak(axes) => (2, axes),
        PoseState::Lost => (3, 0),
    };
    let mut line = format!("{set} {} {} {state} {axes}", pose.number, pose.map);
    let motion = pose.world_from_camera;
    for number in motion.rotation().to_array() {
        line += &format!(" {number:.9}");
    }
    for number in motion.translation().to_array() {
        line += &format!(" {number:.9}");
    }
    for number in pose.covariance.iter().flatten() {
        line += &format!(" {number:.6}");
    }
    line
}

fn damage_word(damage: &Damage) -> &'static str {
    match damage {
        Damage::FileHeader => "file-header",
        Damage::Header { .. } => "header",
        Damage::CommitMark { .. } => "commit-mark",
        Damage::Index { .. } => "index",
        Damage::Record { .. } => "record",
        Damage::Padding { .. } => "padding",
        Damage::Tail { .. } => "tail",
    }
}

pub(crate) fn little_endian(samples: &[u16]) -> Vec<u8> {
    samples
        .iter()
        .flat_map(|sample| sample.to_le_bytes())
        .collect()
}

fn hex(id: FileId) -> String {
    id.0.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The CRC-32 of zlib: another one than the file's, so that no test checks the file by its own sums.
pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    })
}
