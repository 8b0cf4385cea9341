//! One point of `codec`: code, store, decode, compare, time.

use std::path::Path;

use anyhow::{Context as _, ensure};
use geometry::robust;
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::{CodeTable, ColorDecoder, ColorEncoder};
use sequence::file_layer::WritePath;
use sequence::{
    COLOR_STREAM, DEPTH_STREAM, DepthSamples, Description, FrameTimes, Recording, RecordingWriter,
};

use super::super::machine::{involuntary_switches, rss_peak_mb};
use super::super::subject::{DEFAULT_POINT, PointFigures, Setting};
use super::SUBJECT;
use super::coder::{DepthCoder, as_codes};
use crate::clock::{Cost, Stopwatch};

/// Parts of the input that the bootstrap draws.
const BLOCK_COUNT: usize = 10;
/// Pairs that are coded once before anything is timed.
const WARM_UP: usize = 5;
/// Times that all pairs are coded and decoded.
const PASS_COUNT: usize = 3;
/// Place of the point and of the default among the two lanes of a pass.
const POINT: usize = 0;
const REFERENCE: usize = 1;
/// Time between two pairs, milliseconds.
const PERIOD_MS: f64 = 1000.0 / 30.0;

/// The images of a recording in memory.
struct Input {
    depth: Vec<Vec<u16>>,
    color: Vec<Vec<u8>>,
    size: [u32; 2],
}

/// What a pair became.
#[derive(Default)]
struct Payloads {
    depth: Vec<u8>,
    color: Vec<u8>,
}

/// Runs a point on `pair_count` pairs of `recording`, spread evenly; `desk` is a folder for the file it writes.
///
/// # Errors
/// When the recording cannot be read, the setting does not apply to it, or a coder is not lossless.
pub fn run_point(
    recording: &Path,
    setting: &Setting,
    pair_count: usize,
    desk: &Path,
) -> anyhow::Result<PointFigures> {
    let preparing = Stopwatch::start();
    let recording = Recording::open(recording)?;
    let is_of_values = recording.depth_camera().samples == DepthSamples::Values;
    let domain = setting.get("depth-domain").map_or("", String::as_str);
    let recorded = read(&recording, pair_count)?;
    let in_codes = if domain == "codes" && is_of_values {
        Some(Input {
            depth: as_codes(&recorded.depth, recorded.size[0], recorded.size[1])?,
            color: recorded.color.clone(),
            size: recorded.size,
        })
    } else {
        None
    };
    let input = in_codes.as_ref().unwrap_or(&recorded);
    let [width, height] = input.size;
    let finds_table = domain == "recorded" && is_of_values;
    let mut warm = Coders::new(&recording, setting, width, height, finds_table)?;
    for index in 0..WARM_UP.min(input.depth.len()) {
        let mut payloads = Payloads::default();
        warm.encode(input, index, &mut payloads)?;
        warm.decode(input, index, &payloads)?;
    }
    drop(warm);
    let shared_s = preparing.cost().core_s;
    let reference = SUBJECT.setting_of(DEFAULT_POINT).context("no default")?;
    let mut passes = Vec::new();
    for _ in 0..PASS_COUNT {
        let new = |setting: &Setting, finds_table: bool| {
            Coders::new(&recording, setting, width, height, finds_table)
        };
        let point = Lane::new(setting, input, new(setting, finds_table)?)?;
        let coders = new(&reference, is_of_values)?;
        let reference = Lane::new(&reference, &recorded, coders)?;
        passes.push(pass(point, reference, desk, recording.description())?);
    }
    figures(input, &passes, shared_s)
}

/// One time through all pairs of one setting.
struct Lane<'a> {
    input: &'a Input,
    coders: Coders,
    chunk: usize,
    coded: Vec<Payloads>,
    /// Of every pair.
    encoding: Vec<Cost>,
    decoding: Vec<Cost>,
    file_bytes: u64,
}

impl<'a> Lane<'a> {
    fn new(setting: &Setting, input: &'a Input, coders: Coders) -> anyhow::Result<Self> {
        Ok(Self {
            input,
            coders,
            chunk: setting.get("chunk-pairs").context("no chunk")?.parse()?,
            coded: Vec::new(),
            encoding: Vec::new(),
            decoding: Vec::new(),
            file_bytes: 0,
        })
    }

    /// Codes and stores a pair as a recorder does.
    fn encode(&mut self, writer: &mut RecordingWriter) -> anyhow::Result<()> {
        let index = self.coded.len();
        let watch = Stopwatch::start();
        let mut payloads = Payloads::default();
        let table = self.coders.encode(self.input, index, &mut payloads)?;
        store(writer, index, table.as_ref(), &payloads)?;
        if (index + 1).is_multiple_of(self.chunk) {
            writer.seal()?;
        }
        self.encoding.push(watch.cost());
        self.coded.push(payloads);
        Ok(())
    }

    fn decode(&mut self) -> anyhow::Result<()> {
        let index = self.decoding.len();
        let cost = self.coders.decode(self.input, index, &self.coded[index])?;
        self.decoding.push(cost);
        Ok(())
    }
}

/// The point and the default by turns, pair by pair: what disturbs one disturbs the other.
fn pass<'a>(
    mut point: Lane<'a>,
    mut reference: Lane<'a>,
    desk: &Path,
    description: &Description,
) -> anyhow::Result<[Lane<'a>; 2]> {
    let begin = |name: &str| {
        let path = desk.join(name);
        RecordingWriter::create(
            &path,
            description,
            WritePath::default(),
            DiskLimits::default(),
        )
    };
    let (mut of_point, mut of_reference) = (begin("point.glint")?, begin("reference.glint")?);
    let pair_count = point.input.depth.len();
    for index in 0..pair_count {
        if index % 2 == 0 {
            point.encode(&mut of_point)?;
            reference.encode(&mut of_reference)?;
        } else {
            reference.encode(&mut of_reference)?;
            point.encode(&mut of_point)?;
        }
    }
    point.file_bytes = of_point.finish("complete")?.bytes;
    of_reference.finish("complete")?;
    for name in ["point.glint", "reference.glint"] {
        std::fs::remove_file(desk.join(name))?;
    }
    for _ in 0..pair_count {
        point.decode()?;
        reference.decode()?;
    }
    Ok([point, reference])
}

fn read(recording: &Recording, pair_count: usize) -> anyhow::Result<Input> {
    let frame_count = recording.frame_count();
    ensure!(
        frame_count >= BLOCK_COUNT,
        "{} has {frame_count} pairs, at least {BLOCK_COUNT} are needed",
        recording.path().display()
    );
    let count = pair_count.clamp(BLOCK_COUNT, frame_count);
    let indices = (0..count).map(|k| k * frame_count / count);
    let (mut depth, mut color) = (Vec::new(), Vec::new());
    for index in indices {
        depth.push(recording.depth_raw(index)?.pixels().to_vec());
        color.push(recording.color_raw(index)?);
    }
    let camera = &recording.depth_camera().intrinsics;
    Ok(Input {
        depth,
        color,
        size: [camera.width(), camera.height()],
    })
}

/// The coders of both streams.
struct Coders {
    depth: DepthCoder,
    /// `None` where the camera's bytes are the payload.
    color: Option<(ColorEncoder, ColorDecoder)>,
    decoded_depth: Vec<u16>,
    decoded_color: Vec<u8>,
}

impl Coders {
    fn new(
        recording: &Recording,
        setting: &Setting,
        width: u32,
        height: u32,
        finds_table: bool,
    ) -> anyhow::Result<Self> {
        let camera = recording.color_camera();
        let size = (camera.intrinsics.width(), camera.intrinsics.height());
        let color = match camera.encoding.lossless() {
            Some(format) => {
                let mut encoder = ColorEncoder::new(format, size.0, size.1)?;
                let level = setting.get("zstd-level").context("no level of zstd")?;
                encoder.set_zstd_level(level.parse()?)?;
                Some((encoder, ColorDecoder::new(format, size.0, size.1)?))
            }
            None => None,
        };
        Ok(Self {
            depth: DepthCoder::new(setting, width, height, finds_table)?,
            color,
            decoded_depth: vec![0; width as usize * height as usize],
            decoded_color: Vec::new(),
        })
    }

    /// Codes a pair, both streams at a time where the pool has two threads.
    fn encode(
        &mut self,
        input: &Input,
        index: usize,
        payloads: &mut Payloads,
    ) -> anyhow::Result<Option<CodeTable>> {
        let (depth, color) = (&mut self.depth, &mut self.color);
        let (table, done) = rayon::join(
            || depth.encode(&input.depth[index], &mut payloads.depth),
            || -> anyhow::Result<()> {
                let frame = &input.color[index];
                match color {
                    None => payloads.color.clone_from(frame),
                    Some((encoder, _)) => {
                        payloads.color.resize(encoder.max_payload_bytes(), 0);
                        let length = encoder.encode(frame, &mut payloads.color)?;
                        payloads.color.truncate(length);
                    }
                }
                Ok(())
            },
        );
        done?;
        table
    }

    /// Decodes a pair and compares it with what went in, which is not timed.
    fn decode(&mut self, input: &Input, index: usize, payloads: &Payloads) -> anyhow::Result<Cost> {
        let watch = Stopwatch::start();
        let (depth, color) = (&mut self.depth, &mut self.color);
        let (decoded_depth, decoded_color) = (&mut self.decoded_depth, &mut self.decoded_color);
        let (depth_done, color_done) = rayon::join(
            || depth.decode(&payloads.depth, decoded_depth),
            || -> anyhow::Result<()> {
                match color {
                    None => decoded_color.clone_from(&payloads.color),
                    Some((_, decoder)) => {
                        decoded_color.resize(input.color[index].len(), 0);
                        decoder.decode(&payloads.color, decoded_color)?;
                    }
                }
                Ok(())
            },
        );
        let cost = watch.cost();
        depth_done?;
        color_done?;
        ensure!(
            self.decoded_depth == input.depth[index] && self.decoded_color == input.color[index],
            "pair {index} did not come back as it was"
        );
        Ok(cost)
    }
}

fn store(
    writer: &mut RecordingWriter,
    index: usize,
    table: Option<&CodeTable>,
    payloads: &Payloads,
) -> anyhow::Result<()> {
    let times = FrameTimes {
        number: index as u64,
        device_nanos: index as i64 * 33_333_333,
        ..FrameTimes::default()
    };
    if let Some(table) = table {
        writer.write_table(DEPTH_STREAM, table)?;
    }
    writer.write_frame(DEPTH_STREAM, &times, &payloads.depth)?;
    writer.write_frame(COLOR_STREAM, &times, &payloads.color)?;
    Ok(())
}

fn figures(input: &Input, passes: &[[Lane<'_>; 2]], shared_s: f64) -> anyhow::Result<PointFigures> {
    let [first, _] = passes.first().context("nothing was coded")?;
    let (coded, file_bytes) = (&first.coded, first.file_bytes);
    let count = coded.len();
    let depth_bytes: usize = coded.iter().map(|payloads| payloads.depth.len()).sum();
    let color_bytes: usize = coded.iter().map(|payloads| payloads.color.len()).sum();
    let raw_bytes: usize = input.depth.iter().map(|depth| 2 * depth.len()).sum();
    let file_bytes = file_bytes as f64;
    let overhead = (file_bytes - (depth_bytes + color_bytes) as f64) / count as f64;
    let block = |block: usize| {
        let range = block * count / BLOCK_COUNT..(block + 1) * count / BLOCK_COUNT;
        let pairs = coded[range]
            .iter()
            .map(|p| (p.depth.len() + p.color.len()) as f64);
        let length = pairs.len() as f64;
        pairs.sum::<f64>() / length + overhead
    };
    let core = |cost: &Cost| cost.core_s;
    let wall = |cost: &Cost| cost.wall_s;
    let encoding = |lane: usize| -> Vec<&[Cost]> {
        let lanes = passes.iter().map(|pass| &pass[lane]);
        lanes.map(|lane| lane.encoding.as_slice()).collect()
    };
    let decoding = |lane: usize| -> Vec<&[Cost]> {
        let lanes = passes.iter().map(|pass| &pass[lane]);
        lanes.map(|lane| lane.decoding.as_slice()).collect()
    };
    let encode_ms = fastest_ms(&encoding(POINT), core)?;
    let decode_ms = fastest_ms(&decoding(POINT), core)?;
    let reference_encode_ms = fastest_ms(&encoding(REFERENCE), core)?;
    let reference_decode_ms = fastest_ms(&decoding(REFERENCE), core)?;
    let of_point = encoding(POINT);
    let all = of_point.iter().flat_map(|costs| costs.iter());
    let late_count = all.filter(|cost| 1e3 * cost.wall_s > PERIOD_MS).count();
    let metrics = [
        ("encode_ratio", encode_ms / reference_encode_ms),
        ("decode_ratio", decode_ms / reference_decode_ms),
        ("encode_ms", encode_ms),
        ("encode_ms_p99", p99_ms(&encoding(POINT), core)?),
        ("encode_wall_ms", fastest_ms(&encoding(POINT), wall)?),
        ("decode_ms", decode_ms),
        ("decode_ms_p99", p99_ms(&decoding(POINT), core)?),
        ("reference_encode_ms", reference_encode_ms),
        ("bytes_per_pair", file_bytes / count as f64),
        ("depth_bytes", depth_bytes as f64 / count as f64),
        ("color_bytes", color_bytes as f64 / count as f64),
        (
            "depth_percent",
            100.0 * depth_bytes as f64 / raw_bytes as f64,
        ),
        (
            "deadline_miss_fraction",
            late_count as f64 / (passes.len() * count) as f64,
        ),
        ("frames", count as f64),
        ("shared_s", shared_s),
        ("rss_peak_mb", rss_peak_mb()),
        ("nivcsw", involuntary_switches() as f64),
    ];
    Ok(PointFigures {
        metrics: metrics
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect(),
        blocks: (0..BLOCK_COUNT).map(block).collect(),
    })
}

/// Median over the pairs of the fastest pass of each, milliseconds: what disturbs one pass is left out.
fn fastest_ms(passes: &[&[Cost]], of: fn(&Cost) -> f64) -> anyhow::Result<f64> {
    let count = passes.first().map_or(0, |costs| costs.len());
    let fastest = |pair: usize| {
        let times = passes.iter().map(|costs| 1e3 * of(&costs[pair]));
        times.fold(f64::INFINITY, f64::min)
    };
    robust::median(&mut (0..count).map(fastest).collect()).context("no pair was timed")
}

/// Quantile 0.99 over all pairs of all passes, milliseconds: what a recorder has to live with.
fn p99_ms(passes: &[&[Cost]], of: fn(&Cost) -> f64) -> anyhow::Result<f64> {
    let all = passes.iter().flat_map(|costs| costs.iter());
    let mut times = all.map(|cost| 1e3 * of(cost)).collect();
    robust::quantile(&mut times, 0.99).context("no pair was timed")
}
