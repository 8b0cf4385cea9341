//! The processor: what a pair of frames costs it from packets to payload, and who else wants it.

use anyhow::Context as _;
use ps1080::color::{ColorDecoder, ColorFormat, encode_color};
use ps1080::samples::{SampleDecoder, SampleFormat, encode_samples};
use ps1080::stream::Padding;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{ColorEncoding, DepthSamples};

use super::{Finding, Roots, Severity, disk, read};
use crate::latency::thread_nanos;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const PAIR_COUNT: u32 = 20;
const PERIOD_NANOS: f64 = 1e9 / 30.0;
/// Share of one core that acquiring and recording should take at most: fusion wants the rest.
const GOOD_FRACTION: f64 = 0.35;
/// Share beyond which frames are lost as soon as anything else runs.
const MOST_FRACTION: f64 = 0.8;

/// Both.
pub(super) fn examine(roots: &Roots) -> Vec<Finding> {
    vec![busy(roots), capture(thread_nanos)]
}

/// Who else wants the processors.
pub fn busy(roots: &Roots) -> Finding {
    let processors = read(&roots.proc.join("stat")).map_or(1, |text| {
        let is_one = |line: &&str| {
            line.strip_prefix("cpu")
                .is_some_and(|rest| rest.starts_with(|first: char| first.is_ascii_digit()))
        };
        text.lines().filter(is_one).count().max(1)
    });
    let load: Option<f64> = read(&roots.proc.join("loadavg"))
        .and_then(|text| text.split_whitespace().next()?.parse().ok());
    let Some(load) = load else {
        return Finding::new(
            "busy",
            Severity::Note,
            "the load cannot be read".to_owned(),
            "uptime",
        );
    };
    let words = format!("{load:.1} programs want {processors} processors");
    let mend = "end what else runs, or give it a lower rank: top; renice -n 19 PID";
    if load >= processors as f64 + 1.0 {
        Finding::new("busy", Severity::Bad, words, mend)
    } else if load >= 0.75 * processors as f64 {
        Finding::new("busy", Severity::Warning, words, mend)
    } else {
        Finding::fine("busy", words)
    }
}

/// A short capture without camera and disk: frames are decoded from their packed form and encoded for the file.
/// `core_nanos` counts time of this thread.
pub fn capture(core_nanos: fn() -> u64) -> Finding {
    let spent = match spend(core_nanos) {
        Ok(spent) => spent,
        Err(error) => {
            return Finding::new(
                "processor",
                Severity::Bad,
                format!("the simulated capture failed: {error:#}"),
                "this is a mistake in glintd: please report it",
            );
        }
    };
    let fraction = spent as f64 / f64::from(PAIR_COUNT) / PERIOD_NANOS;
    let words = format!(
        "decoding and encoding take {:.0} % of a core ({:.1} ms a pair)",
        100.0 * fraction,
        fraction * PERIOD_NANOS / 1e6
    );
    let mend = "let it run at full speed: echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor; or record with --no-fuse, or ps1080?size=qvga";
    if fraction > MOST_FRACTION {
        Finding::new("processor", Severity::Bad, words, mend)
    } else if fraction > GOOD_FRACTION {
        Finding::new("processor", Severity::Warning, words, mend)
    } else {
        Finding::fine("processor", words)
    }
}

fn spend(core_nanos: fn() -> u64) -> anyhow::Result<u64> {
    let mut description = disk::description()?;
    description.streams.depth.samples = DepthSamples::Codes;
    description.streams.color.encoding = ColorEncoding::Uyvy;
    let mut depth_encoder = DepthStreamEncoder::new(&description.streams, DepthCodec::Fast)?;
    let mut color_encoder = ColorStreamEncoder::new(&description.streams)?;
    // Slopes with noise of a step, holes: what a room looks like.
    let noise = |index: usize| (index.wrapping_mul(2_654_435_761) >> 7) % 5;
    let shifts: Vec<u16> = (0..WIDTH * HEIGHT)
        .map(|index| match noise(index / 3) {
            0 if index % 64 < 9 => 2047,
            step => (400 + index % WIDTH / 2 + index / WIDTH / 2 + step) as u16,
        })
        .collect();
    let colors: Vec<u8> = (0..2 * WIDTH * HEIGHT)
        .map(|index| (60 + index / 2 % WIDTH / 8 + noise(index)) as u8)
        .collect();
    let format = ColorFormat::CompressedYuv422;
    let mut packed = vec![0; SampleFormat::Packed11.max_bytes(shifts.len(), WIDTH)];
    let packed_bytes = encode_samples(SampleFormat::Packed11, &shifts, WIDTH, &mut packed)?;
    let mut differences = vec![0; format.max_bytes(colors.len(), 2 * WIDTH)];
    let color_bytes = encode_color(format, &colors, 2 * WIDTH, &mut differences)?;
    let mut depth_decoder = SampleDecoder::new(SampleFormat::Packed11, shifts.len());
    let color_decoder = ColorDecoder::new(format, WIDTH as u16, HEIGHT as u16);
    let mut color_decoder = color_decoder.context("no decoder of colour")?;
    let (mut samples, mut bytes) = (vec![0; shifts.len()], vec![0; colors.len()]);
    let begun = core_nanos();
    for _ in 0..PAIR_COUNT {
        depth_decoder.begin(Padding::default());
        depth_decoder.push(&packed[..packed_bytes], &mut samples)?;
        depth_decoder.finish(&mut samples)?;
        color_decoder.begin();
        color_decoder.push(&differences[..color_bytes], &mut bytes)?;
        color_decoder.finish()?;
        depth_encoder.encode(&samples)?;
        color_encoder.encode(&bytes)?;
    }
    Ok(core_nanos().saturating_sub(begun))
}
