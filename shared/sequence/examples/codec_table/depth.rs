//! Depth codecs on frames of millimetres.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _, ImageFormat};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{CodeTable, DepthCodec, DepthDecoder, DepthEncoder, depth_table_id};

use super::ffv1;
use super::measure::{Candidate, Failure, files, print_head, print_row};

type Row<'a> = Candidate<'a, u16>;

pub(crate) fn print(data: &Path, every: usize) -> Result<(), Failure> {
    let mut frames = Vec::new();
    let (mut width, mut height) = (0, 0);
    for path in files(&data.join("redkitchen"), ".depth.png", every)? {
        let image = image::open(path)?.into_luma16();
        (width, height) = image.dimensions();
        frames.push(image.into_raw());
    }
    let mut encoder = DepthEncoder::of_values(width, height, None)?;
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let mut table_count = 0;
    for frame in &frames {
        let encoded = encoder.encode(frame, DepthCodec::Fast, &mut payload)?;
        table_count += u32::from(encoded.has_new_table);
    }
    let table = encoder.table().ok_or("the values are no table")?.clone();
    println!(
        "{} depth frames {width}x{height}; {} values in the table, which was extended {} times",
        frames.len(),
        table.values().len(),
        table_count - 1
    );
    let pixel_count = width as usize * height as usize;
    let codes: Vec<Vec<u16>> = frames.iter().map(|frame| codes_of(&table, frame)).collect();

    print_head("depth, from millimetres (table look-up included)");
    for (name, codec) in [("fast", DepthCodec::Fast), ("dense", DepthCodec::Dense)] {
        print_row(
            &frames,
            pixel_count,
            ours(name, codec, Some(&table), width, height)?,
        )?;
    }
    print_head("depth, from codes");
    for (name, codec) in [("fast", DepthCodec::Fast), ("dense", DepthCodec::Dense)] {
        print_row(&codes, pixel_count, ours(name, codec, None, width, height)?)?;
    }
    print_head("depth, worst case: a frame of noise (stored raw)");
    for (name, codec) in [("fast", DepthCodec::Fast), ("dense", DepthCodec::Dense)] {
        let noise = [noise(pixel_count)];
        print_row(&noise, pixel_count, ours(name, codec, None, width, height)?)?;
    }
    for (title, frames) in [
        ("depth peers, millimetres", &frames),
        ("depth peers, codes", &codes),
    ] {
        print_head(title);
        print_row(frames, pixel_count, rvl(false)?)?;
        print_row(frames, pixel_count, rvl(true)?)?;
        print_row(frames, pixel_count, zstd_alone()?)?;
        print_row(
            frames,
            pixel_count,
            png("PNG 16 bit, fast", CompressionType::Fast, width, height),
        )?;
        print_row(
            frames,
            pixel_count,
            png(
                "PNG 16 bit, default",
                CompressionType::Default,
                width,
                height,
            ),
        )?;
        ffv1::print_row("gray16le", frames, width, height)?;
    }
    Ok(())
}

fn noise(pixel_count: usize) -> Vec<u16> {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    (0..pixel_count).map(|_| random.random()).collect()
}

fn codes_of(table: &CodeTable, frame: &[u16]) -> Vec<u16> {
    let code_of = |&value: &u16| match value {
        0 | u16::MAX => value,
        _ => table.values().partition_point(|&below| below < value) as u16 + 1,
    };
    frame.iter().map(code_of).collect()
}

fn ours<'a>(
    name: &'static str,
    codec: DepthCodec,
    table: Option<&'a CodeTable>,
    width: u32,
    height: u32,
) -> Result<Row<'a>, Failure> {
    let mut encoder = match table {
        Some(table) => DepthEncoder::of_values(width, height, Some(table.clone()))?,
        None => DepthEncoder::of_codes(width, height)?,
    };
    let mut decoder = DepthDecoder::new(width, height)?;
    let room = encoder.max_payload_bytes();
    Ok(Candidate {
        name,
        encode: Box::new(move |frame, payload| {
            payload.resize(room, 0);
            let encoded = encoder.encode(frame, codec, payload)?;
            payload.truncate(encoded.byte_count);
            Ok(())
        }),
        decode: Box::new(move |payload, frame| {
            let table = depth_table_id(payload)?.and(table);
            Ok(decoder.decode(payload, table, frame)?)
        }),
    })
}

/// RVL as its author published it: nibbles packed into 32-bit words, highest first; alone or in zstd 1.
fn rvl(in_zstd: bool) -> Result<Row<'static>, Failure> {
    let mut tokens = Vec::new();
    let mut unpacked = Vec::new();
    let mut compressor = zstd::bulk::Compressor::new(1)?;
    let mut decompressor = zstd::bulk::Decompressor::new()?;
    Ok(Candidate {
        name: if in_zstd { "RVL + zstd 1" } else { "RVL" },
        encode: Box::new(move |frame, payload| {
            let target = if in_zstd { &mut tokens } else { &mut *payload };
            target.clear();
            target.reserve(4 * frame.len());
            wilson_encode(frame, target);
            if in_zstd {
                payload.resize(zstd::zstd_safe::compress_bound(tokens.len()), 0);
                let length = compressor.compress_to_buffer(&tokens, payload.as_mut_slice())?;
                payload.truncate(length);
            }
            Ok(())
        }),
        decode: Box::new(move |payload, frame| {
            if in_zstd {
                unpacked.resize(4 * frame.len(), 0);
                let length = decompressor.decompress_to_buffer(payload, unpacked.as_mut_slice())?;
                wilson_decode(&unpacked[..length], frame);
            } else {
                wilson_decode(payload, frame);
            }
            Ok(())
        }),
    })
}

fn wilson_encode(frame: &[u16], out: &mut Vec<u8>) {
    let (mut word, mut nibbles) = (0_u32, 0);
    let mut number = |mut value: u32| {
        loop {
            let rest = value >> 3;
            word = word << 4 | value & 7 | if rest != 0 { 8 } else { 0 };
            nibbles += 1;
            if nibbles == 8 {
                out.extend_from_slice(&word.to_le_bytes());
                (word, nibbles) = (0, 0);
            }
            value = rest;
            if value == 0 {
                break;
            }
        }
    };
    let mut rest = frame;
    let mut previous = 0;
    while !rest.is_empty() {
        let zeros = rest.iter().take_while(|&&sample| sample == 0).count();
        let others = rest[zeros..]
            .iter()
            .take_while(|&&sample| sample != 0)
            .count();
        number(zeros as u32);
        number(others as u32);
        for &sample in &rest[zeros..zeros + others] {
            let difference = i32::from(sample) - previous;
            previous = i32::from(sample);
            number((difference << 1 ^ difference >> 31) as u32);
        }
        rest = &rest[zeros + others..];
    }
    if nibbles > 0 {
        out.extend_from_slice(&(word << (4 * (8 - nibbles))).to_le_bytes());
    }
}

/// As published: without a bound on anything but the slices.
fn wilson_decode(bytes: &[u8], frame: &mut [u16]) {
    let mut words = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|word| u32::from_le_bytes(*word));
    let (mut word, mut nibbles) = (0, 0);
    let mut number = || {
        let (mut value, mut shift) = (0, 0);
        loop {
            if nibbles == 0 {
                word = words.next().unwrap_or(0);
                nibbles = 8;
            }
            let nibble = word >> 28;
            word <<= 4;
            nibbles -= 1;
            value |= (nibble & 7) << shift;
            shift += 3;
            if nibble < 8 {
                return value;
            }
        }
    };
    let (mut at, mut previous) = (0, 0);
    while at < frame.len() {
        let zeros = number() as usize;
        let others = number() as usize;
        frame[at..at + zeros].fill(0);
        at += zeros;
        for sample in &mut frame[at..at + others] {
            let zigzag = number();
            previous += (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32);
            *sample = previous as u16;
        }
        at += others;
    }
}

fn zstd_alone() -> Result<Row<'static>, Failure> {
    let mut compressor = zstd::bulk::Compressor::new(1)?;
    let mut decompressor = zstd::bulk::Decompressor::new()?;
    let mut raw = Vec::new();
    let mut unpacked = Vec::new();
    Ok(Candidate {
        name: "zstd 1",
        encode: Box::new(move |frame, payload| {
            raw.clear();
            raw.extend(frame.iter().flat_map(|sample| sample.to_le_bytes()));
            payload.resize(zstd::zstd_safe::compress_bound(raw.len()), 0);
            let length = compressor.compress_to_buffer(&raw, payload.as_mut_slice())?;
            payload.truncate(length);
            Ok(())
        }),
        decode: Box::new(move |payload, frame| {
            unpacked.resize(2 * frame.len(), 0);
            decompressor.decompress_to_buffer(payload, unpacked.as_mut_slice())?;
            for (sample, bytes) in frame.iter_mut().zip(unpacked.as_chunks::<2>().0) {
                *sample = u16::from_le_bytes(*bytes);
            }
            Ok(())
        }),
    })
}

fn png(name: &'static str, level: CompressionType, width: u32, height: u32) -> Row<'static> {
    Candidate {
        name,
        encode: Box::new(move |frame, payload| {
            payload.clear();
            let bytes: Vec<u8> = frame
                .iter()
                .flat_map(|sample| sample.to_ne_bytes())
                .collect();
            PngEncoder::new_with_quality(payload, level, FilterType::Adaptive).write_image(
                &bytes,
                width,
                height,
                ExtendedColorType::L16,
            )?;
            Ok(())
        }),
        decode: Box::new(|payload, frame| {
            let image = image::load_from_memory_with_format(payload, ImageFormat::Png)?;
            frame.copy_from_slice(image.into_luma16().as_raw());
            Ok(())
        }),
    }
}
