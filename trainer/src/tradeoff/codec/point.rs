//! One point of `codec`: code, store, decode, compare, time.

use std::path::Path;

use anyhow::{Context as _, ensure};
use geometry::robust;
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::{CodeTable, ColorDecoder, ColorEncoder};
use sequence::file_layer::WritePath;
use sequence::{COLOR_STREAM, DEPTH_STREAM, DepthSamples, FrameTimes, Recording, RecordingWriter};

use super::super::machine::{involuntary_switches, rss_peak_mb};
use super::super::subject::{PointFigures, Setting};
use super::coder::{DepthCoder, as_codes};
use crate::clock::{Cost, Stopwatch};

/// Parts of the input that the bootstrap draws.
const BLOCK_COUNT: usize = 10;
/// Pairs that are coded once before anything is timed.
const WARM_UP: usize = 5;
/// Times that all pairs are coded and decoded.
const PASS_COUNT: usize = 3;
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
    let samples = recording.depth_camera().samples;
    let domain = setting.get("depth-domain").map_or("", String::as_str);
    let mut input = read(&recording, pair_count)?;
    let is_of_values = samples == DepthSamples::Values;
    if domain == "codes" && is_of_values {
        input.depth = as_codes(&input.depth, input.size[0], input.size[1])?;
    }
    let [width, height] = input.size;
    let finds_table = domain == "recorded" && is_of_values;
    let mut warm = Coders::new(&recording, setting, width, height, finds_table)?;
    for index in 0..WARM_UP.min(input.depth.len()) {
        let mut payloads = Payloads::default();
        warm.encode(&input, index, &mut payloads)?;
        warm.decode(&input, index, &payloads)?;
    }
    drop(warm);
    let shared_s = preparing.cost().core_s;
    let chunk: usize = setting.get("chunk-pairs").context("no chunk")?.parse()?;
    let mut passes = Vec::new();
    for _ in 0..PASS_COUNT {
        let coders = Coders::new(&recording, setting, width, height, finds_table)?;
        passes.push(pass(&recording, &input, coders, chunk, desk)?);
    }
    figures(&input, &passes, shared_s)
}

/// One time through all pairs.
struct Pass {
    coded: Vec<Payloads>,
    /// Of every pair.
    encoding: Vec<Cost>,
    decoding: Vec<Cost>,
    file_bytes: u64,
}

fn pass(
    recording: &Recording,
    input: &Input,
    mut coders: Coders,
    chunk: usize,
    desk: &Path,
) -> anyhow::Result<Pass> {
    let path = desk.join("coded.glint");
    let mut writer = RecordingWriter::create(
        &path,
        recording.description(),
        WritePath::Auto,
        DiskLimits::default(),
    )?;
    let (mut encoding, mut coded) = (Vec::new(), Vec::new());
    for index in 0..input.depth.len() {
        let watch = Stopwatch::start();
        let mut payloads = Payloads::default();
        let table = coders.encode(input, index, &mut payloads)?;
        store(&mut writer, index, table.as_ref(), &payloads)?;
        if (index + 1) % chunk == 0 {
            writer.seal()?;
        }
        encoding.push(watch.cost());
        coded.push(payloads);
    }
    let file_bytes = writer.finish("complete")?.bytes;
    std::fs::remove_file(&path)?;
    let decoding = coded
        .iter()
        .enumerate()
        .map(|(index, payloads)| coders.decode(input, index, payloads))
        .collect::<anyhow::Result<_>>()?;
    Ok(Pass {
        coded,
        encoding,
        decoding,
        file_bytes,
    })
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

fn figures(input: &Input, passes: &[Pass], shared_s: f64) -> anyhow::Result<PointFigures> {
    let Pass {
        coded, file_bytes, ..
    } = passes.first().context("nothing was coded")?;
    let count = coded.len();
    let depth_bytes: usize = coded.iter().map(|payloads| payloads.depth.len()).sum();
    let color_bytes: usize = coded.iter().map(|payloads| payloads.color.len()).sum();
    let raw_bytes: usize = input.depth.iter().map(|depth| 2 * depth.len()).sum();
    let file_bytes = *file_bytes as f64;
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
    let encoding: Vec<&[Cost]> = passes.iter().map(|pass| pass.encoding.as_slice()).collect();
    let decoding: Vec<&[Cost]> = passes.iter().map(|pass| pass.decoding.as_slice()).collect();
    let all = encoding.iter().flat_map(|costs| costs.iter());
    let late_count = all.filter(|cost| 1e3 * cost.wall_s > PERIOD_MS).count();
    let metrics = [
        ("encode_ms", fastest_ms(&encoding, core)?),
        ("encode_ms_p99", p99_ms(&encoding, core)?),
        ("encode_wall_ms", fastest_ms(&encoding, wall)?),
        ("decode_ms", fastest_ms(&decoding, core)?),
        ("decode_ms_p99", p99_ms(&decoding, core)?),
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
