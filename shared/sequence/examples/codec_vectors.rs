//! Writes the vectors of the codecs: `codec_vectors FOLDER` (recordings/vectors/codecs).
//!
//! Each vector is `NAME.payload` with its `NAME.raw`, or without one where a decoder must refuse it; `index.json` says
//! what it is. The frames are computed, none is of a camera. The bytes depend on the version of zstd; what they
//! decode to does not.

use std::error::Error;
use std::path::{Path, PathBuf};

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{CodeTable, ColorEncoder, ColorFormat, DepthCodec, DepthEncoder};
use serde_json::{Value, json};

type Outcome = Result<(), Box<dyn Error>>;

struct Vectors {
    folder: PathBuf,
    index: Vec<Value>,
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
    codes(&mut vectors)?;
    tables(&mut vectors)?;
    color(&mut vectors)?;
    refused_depth(&mut vectors)?;
    refused_color(&mut vectors)?;
    infrared(&mut vectors)?;
    let index = serde_json::to_string_pretty(&vectors.index)?;
    std::fs::write(vectors.folder.join("index.json"), index + "\n")?;
    println!("{} vectors", vectors.index.len());
    Ok(())
}

impl Vectors {
    /// Adds a vector; one without `raw` must be refused.
    fn add(
        &mut self,
        name: &str,
        format: &str,
        (width, height): (u32, u32),
        table: Option<&str>,
        (payload, raw): (&[u8], Option<&[u8]>),
        describes: &str,
    ) -> Outcome {
        std::fs::write(self.folder.join(format!("{name}.payload")), payload)?;
        if let Some(raw) = raw {
            std::fs::write(self.folder.join(format!("{name}.raw")), raw)?;
        }
        self.index.push(json!({
            "name": name, "format": format, "width": width, "height": height, "table": table,
            "refused": raw.is_none(), "describes": describes,
        }));
        Ok(())
    }

    fn table(&self, name: &str, table: &CodeTable) -> Outcome {
        Ok(std::fs::write(self.folder.join(name), table.to_bytes())?)
    }

    fn refused(
        &mut self,
        name: &str,
        payload: &[u8],
        table: Option<&str>,
        describes: &str,
    ) -> Outcome {
        self.add(name, "depth", (64, 48), table, (payload, None), describes)
    }
}

fn little_endian(samples: &[u16]) -> Vec<u8> {
    samples
        .iter()
        .flat_map(|sample| sample.to_le_bytes())
        .collect()
}

fn encoded(
    encoder: &mut DepthEncoder,
    samples: &[u16],
    codec: DepthCodec,
) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let encoded = encoder.encode(samples, codec, &mut payload)?;
    payload.truncate(encoded.byte_count);
    Ok(payload)
}

/// Two slanted walls with noise of a step, holes, and a few samples of 65535.
fn shifts(random: &mut Pcg64Mcg, width: u32, height: u32) -> Vec<u16> {
    let mut samples = Vec::new();
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let wall = if x * 2 > width {
            700 + y / 2
        } else {
            480 + (x + y) / 5
        };
        samples.push(match random.random_range(0..300) {
            0 => u16::MAX,
            _ if x * 8 > width * 7 || (x / 7 + y / 5) % 9 == 0 => 0,
            chance => (wall + u32::from(chance % 12 == 0)) as u16,
        });
    }
    samples
}

/// Depth in millimetres of a shift of a real PS1080, within the range of the vectors.
fn millimetres(code: u16) -> u16 {
    let at_zero_plane = ((f64::from(code) - 800.0) / 4.0 - 0.375) * 0.1052;
    match code {
        0 | u16::MAX => code,
        _ => (10.0 * (at_zero_plane * 120.0 / (7.5 - at_zero_plane) + 120.0)) as u16,
    }
}

fn codes(vectors: &mut Vectors) -> Outcome {
    let mut random = Pcg64Mcg::seed_from_u64(20);
    let checkerboard = (0..33 * 17).map(|place| if place % 2 == 0 { 0 } else { u16::MAX });
    let mut steps = Vec::new();
    for power in 0..16 {
        for near in [-1_i32, 0, 1] {
            let step = ((1 << power) + near) as u16;
            steps.extend([
                30_000,
                30_000_u16.wrapping_add(step),
                30_000,
                30_000_u16.wrapping_sub(step),
            ]);
        }
    }
    let frames = [
        (
            "shifts",
            (64, 48),
            shifts(&mut random, 64, 48),
            "shift codes with noise, holes and both missing codes",
        ),
        (
            "odd",
            (37, 23),
            shifts(&mut random, 37, 23),
            "the same with odd sides",
        ),
        (
            "checkerboard",
            (33, 17),
            checkerboard.collect(),
            "0 and 65535 in turn: differences wrap",
        ),
        (
            "steps",
            (64, 3),
            steps,
            "differences of every power of two and its neighbours, both signs",
        ),
        (
            "missing",
            (40, 30),
            vec![0; 1200],
            "nothing was measured: all samples 0",
        ),
        (
            "missing-65535",
            (40, 30),
            vec![u16::MAX; 1200],
            "nothing was measured: all samples 65535",
        ),
        (
            "one-row",
            (48, 1),
            shifts(&mut random, 48, 1),
            "one row: no neighbour above",
        ),
        (
            "one-column",
            (1, 48),
            vec![900; 48],
            "one column: no neighbour but the one above",
        ),
    ];
    for (name, size, samples, describes) in frames {
        let mut encoder = DepthEncoder::of_codes(size.0, size.1)?;
        for (word, codec) in [("fast", DepthCodec::Fast), ("dense", DepthCodec::Dense)] {
            let payload = encoded(&mut encoder, &samples, codec)?;
            let name = format!("depth-{word}-{name}");
            let raw = little_endian(&samples);
            vectors.add(
                &name,
                "depth",
                size,
                None,
                (&payload, Some(&raw)),
                describes,
            )?;
        }
    }
    let noise: Vec<u16> = (0..40 * 30).map(|_| random.random()).collect();
    let payload = encoded(
        &mut DepthEncoder::of_codes(40, 30)?,
        &noise,
        DepthCodec::Fast,
    )?;
    let raw = little_endian(&noise);
    let describes = "noise of 16 bits, which no codec makes smaller: stored raw";
    vectors.add(
        "depth-raw-noise",
        "depth",
        (40, 30),
        None,
        (&payload, Some(&raw)),
        describes,
    )
}

fn tables(vectors: &mut Vectors) -> Outcome {
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let first: Vec<u16> = shifts(&mut random, 64, 48)
        .into_iter()
        .map(millimetres)
        .collect();
    let mut second = first.clone();
    second[200] = 555;
    second[201] = 9_876;
    let mut encoder = DepthEncoder::of_values(64, 48, None)?;
    for (samples, table, describes) in [
        (
            first,
            "1.table",
            "millimetres as codes of the table that they prove to be",
        ),
        (
            second,
            "2.table",
            "two new values: the table is extended under the next id",
        ),
    ] {
        for (word, codec) in [("fast", DepthCodec::Fast), ("dense", DepthCodec::Dense)] {
            let payload = encoded(&mut encoder, &samples, codec)?;
            let name = format!("depth-{word}-table-{}", &table[..1]);
            let raw = little_endian(&samples);
            vectors.add(
                &name,
                "depth",
                (64, 48),
                Some(table),
                (&payload, Some(&raw)),
                describes,
            )?;
        }
        vectors.table(
            table,
            encoder.table().ok_or("the millimetres are no table")?,
        )?;
    }
    Ok(())
}

fn color_payload(
    format: ColorFormat,
    (width, height): (u32, u32),
    frame: &[u8],
) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut encoder = ColorEncoder::new(format, width, height)?;
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let length = encoder.encode(frame, &mut payload)?;
    payload.truncate(length);
    Ok(payload)
}

fn color(vectors: &mut Vectors) -> Outcome {
    let mut random = Pcg64Mcg::seed_from_u64(22);
    for (word, format, odd) in [
        ("bayer-grbg", ColorFormat::BayerGrbg, (31, 17)),
        ("uyvy", ColorFormat::Uyvy, (30, 17)),
        ("yuyv", ColorFormat::Yuyv, (30, 17)),
        ("rgb8", ColorFormat::Rgb8, (31, 17)),
    ] {
        for size in [(64, 48), odd] {
            let bytes = format.frame_bytes(size.0, size.1)?;
            let row_bytes = bytes / size.1 as usize;
            let ramp = |place: usize| 3 * (place / row_bytes) + (place % row_bytes) / 2;
            let frame: Vec<u8> = (0..bytes)
                .map(|place| (ramp(place) as u8).wrapping_add(random.random_range(0..6)))
                .collect();
            let payload = color_payload(format, size, &frame)?;
            let name = format!("color-{word}-{}x{}", size.0, size.1);
            let describes = "a ramp with noise that wraps at 256";
            vectors.add(&name, word, size, None, (&payload, Some(&frame)), describes)?;
        }
    }
    for (name, size, describes) in [
        (
            "color-bayer-grbg-one-row",
            (48, 1),
            "one row: two planes are empty",
        ),
        (
            "color-bayer-grbg-one-column",
            (1, 48),
            "one column: two planes are empty",
        ),
    ] {
        let frame: Vec<u8> = (0..48).map(|place| 200 + place / 5).collect();
        let payload = color_payload(ColorFormat::BayerGrbg, size, &frame)?;
        vectors.add(
            name,
            "bayer-grbg",
            size,
            None,
            (&payload, Some(&frame)),
            describes,
        )?;
    }
    let noise: Vec<u8> = (0..40 * 30).map(|_| random.random()).collect();
    let payload = color_payload(ColorFormat::BayerGrbg, (40, 30), &noise)?;
    let describes = "noise, which prediction does not make smaller: stored raw";
    vectors.add(
        "color-bayer-grbg-noise",
        "bayer-grbg",
        (40, 30),
        None,
        (&payload, Some(&noise)),
        describes,
    )
}

/// Infrared came later: the vectors before it keep their places and their noise.
fn infrared(vectors: &mut Vectors) -> Outcome {
    let mut random = Pcg64Mcg::seed_from_u64(24);
    let format = ColorFormat::Infrared10;
    for size in [(64, 48), (31, 17)] {
        let dots = |random: &mut Pcg64Mcg, pixel: u32| {
            let slope = 6 * (pixel % size.0) + 4 * (pixel / size.0);
            let dot = if random.random_bool(0.1) { 300 } else { 0 };
            (slope + dot + random.random_range(0..8)) as u16
        };
        let samples: Vec<u16> = (0..size.0 * size.1)
            .map(|pixel| dots(&mut random, pixel).min(1023))
            .collect();
        let frame = little_endian(&samples);
        let payload = color_payload(format, size, &frame)?;
        let name = format!("color-infrared10-{}x{}", size.0, size.1);
        let describes = "a slope over all 10 bits, dots and noise";
        let both = (payload.as_slice(), Some(frame.as_slice()));
        vectors.add(&name, "infrared10", size, None, both, describes)?;
    }
    let noise: Vec<u16> = (0..20 * 15).map(|_| random.random()).collect();
    let noise = little_endian(&noise);
    let payload = color_payload(format, (20, 15), &noise)?;
    let describes = "16 bits of noise, which no camera sends and a reader keeps: stored raw";
    let both = (payload.as_slice(), Some(noise.as_slice()));
    let name = "color-infrared10-noise";
    vectors.add(name, "infrared10", (20, 15), None, both, describes)
}

fn with_head(head: &[u8], content: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    Ok([head, zstd::bulk::compress(content, 1)?.as_slice()].concat())
}

fn refused_depth(vectors: &mut Vectors) -> Outcome {
    let mut random = Pcg64Mcg::seed_from_u64(23);
    let samples = shifts(&mut random, 64, 48);
    let mut encoder = DepthEncoder::of_codes(64, 48)?;
    let fast = encoded(&mut encoder, &samples, DepthCodec::Fast)?;
    let dense = encoded(&mut encoder, &samples, DepthCodec::Dense)?;
    let longer = [dense.as_slice(), &[0]].concat();
    let mut unknown = dense.clone();
    unknown[0] = 3;
    vectors.refused(
        "refused-fast-cut",
        &fast[..fast.len() - 9],
        None,
        "a zstd frame without its end",
    )?;
    vectors.refused(
        "refused-dense-cut",
        &dense[..dense.len() - 1],
        None,
        "a range coder without its last byte",
    )?;
    vectors.refused(
        "refused-dense-surplus",
        &longer,
        None,
        "a byte behind the range coder",
    )?;
    vectors.refused("refused-head", &dense[..2], None, "two bytes of the head")?;
    vectors.refused(
        "refused-codec",
        &unknown,
        None,
        "codec 3, which does not exist",
    )?;
    vectors.refused(
        "refused-raw-short",
        &[0; 3 + 64],
        None,
        "raw samples of another size",
    )?;
    // 64 zeros, then 32,768 others, in a frame of 3,072.
    let beyond = with_head(&[1, 0, 0], &[0x88, 0x81, 0x88, 0x88, 0x01, 0x22])?;
    vectors.refused("refused-run", &beyond, None, "a run beyond the frame")?;
    let empty = with_head(&[1, 0, 0], &[0; 500])?;
    vectors.refused("refused-empty-runs", &empty, None, "runs of nothing")?;
    let endless = with_head(&[1, 0, 0], &[0xff; 50])?;
    vectors.refused("refused-number", &endless, None, "a number without an end")?;
    let bomb = with_head(&[1, 0, 0], &vec![0; 1 << 20])?;
    vectors.refused(
        "refused-bomb",
        &bomb,
        None,
        "a zstd frame of a mebibyte for a frame of 6 kB",
    )?;
    let mut with_table = dense.clone();
    with_table[1] = 9;
    vectors.refused(
        "refused-table",
        &with_table,
        Some("1.table"),
        "names table 9, table 1 is there",
    )?;
    with_table[1] = 1;
    vectors.refused(
        "refused-code",
        &with_table,
        Some("1.table"),
        "codes beyond their table",
    )
}

fn refused_color(vectors: &mut Vectors) -> Outcome {
    let bytes = 30 * 20 * 3;
    for (name, length, describes) in [
        (
            "refused-color-short",
            bytes - 1,
            "residuals of one sample less",
        ),
        (
            "refused-color-bomb",
            1 << 20,
            "a zstd frame of a mebibyte for a frame of 2 kB",
        ),
    ] {
        let payload = with_head(&[1], &vec![7; length])?;
        vectors.add(name, "rgb8", (30, 20), None, (&payload, None), describes)?;
    }
    Ok(())
}
