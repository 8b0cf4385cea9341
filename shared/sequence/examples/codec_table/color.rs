//! Colour codecs on frames that never were JPEG, re-mosaicked and converted.

use std::path::Path;

use sequence::codecs::{ColorDecoder, ColorEncoder, ColorFormat};

use super::ffv1;
use super::measure::{Candidate, Failure, files, print_head, print_row};

type Row = Candidate<'static, u8>;

pub(crate) fn print(data: &Path) -> Result<(), Failure> {
    let mut rgb = Vec::new();
    let (mut width, mut height) = (0, 0);
    for path in files(&data.join("colour-png"), ".color.png", 1)? {
        let image = image::open(path)?.into_rgb8();
        (width, height) = image.dimensions();
        rgb.push(image.into_raw());
    }
    let columns = width as usize;
    let mosaics: Vec<_> = rgb.iter().map(|frame| mosaic(frame, columns)).collect();
    let uyvy: Vec<_> = rgb
        .iter()
        .map(|frame| yuv422(frame, [1, 0, 3, 2]))
        .collect();
    let yuyv: Vec<_> = rgb
        .iter()
        .map(|frame| yuv422(frame, [0, 1, 2, 3]))
        .collect();
    println!("\n{} colour frames {width}x{height}", rgb.len());
    let pixel_count = columns * height as usize;
    for (name, format, frames) in [
        ("Bayer GRBG", ColorFormat::BayerGrbg, &mosaics),
        ("YUV 4:2:2, UYVY", ColorFormat::Uyvy, &uyvy),
        ("YUV 4:2:2, YUYV", ColorFormat::Yuyv, &yuyv),
        ("RGB8", ColorFormat::Rgb8, &rgb),
    ] {
        print_head(name);
        print_row(frames, pixel_count, ours(format, width, height)?)?;
        print_row(frames, pixel_count, zstd_alone(format)?)?;
        match format {
            ColorFormat::BayerGrbg => {
                let planes: Vec<_> = mosaics
                    .iter()
                    .map(|frame| stacked(frame, columns))
                    .collect();
                ffv1::print_row("gray", &planes, width, height)?;
            }
            ColorFormat::Rgb8 => ffv1::print_row("bgr0", &bgr0(&rgb), width, height)?,
            ColorFormat::Uyvy | ColorFormat::Yuyv | ColorFormat::Infrared10 => {}
        }
    }
    Ok(())
}

/// GRBG: row 0 is G R G R …, row 1 is B G B G …
fn mosaic(rgb: &[u8], width: usize) -> Vec<u8> {
    let channel_at = |index: usize| match (index / width % 2, index % width % 2) {
        (0, 1) => 0,
        (1, 0) => 2,
        _ => 1,
    };
    let pixels = rgb.as_chunks::<3>().0.iter().enumerate();
    pixels
        .map(|(index, pixel)| pixel[channel_at(index)])
        .collect()
}

/// The four colour planes below each other in the width of one, twice beside each other: what FFV1 likes best.
fn stacked(mosaic: &[u8], width: usize) -> Vec<u8> {
    let mut planes = Vec::with_capacity(mosaic.len());
    for first_row in 0..2 {
        for rows in mosaic.chunks_exact(2 * width) {
            let row = &rows[first_row * width..][..width];
            planes.extend(row.iter().step_by(2));
            planes.extend(row.iter().skip(1).step_by(2));
        }
    }
    planes
}

fn bgr0(frames: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let pixels = |frame: &Vec<u8>| frame.as_chunks::<3>().0.to_vec();
    let turned = |[r, g, b]: [u8; 3]| [b, g, r, 0];
    frames
        .iter()
        .map(|frame| pixels(frame).into_iter().flat_map(turned).collect())
        .collect()
}

/// BT.601 full range, chroma the mean of a pair; `places` of Y0, U, Y1, V in the four bytes of a pair.
fn yuv422(rgb: &[u8], places: [usize; 4]) -> Vec<u8> {
    let code = |value: f64| value.round().clamp(0.0, 255.0) as u8;
    let yuv = |pixel: [u8; 3]| {
        let [r, g, b] = pixel.map(f64::from);
        let y = 0.299 * r + 0.587 * g + 0.114 * b;
        [y, 128.0 + (b - y) / 1.772, 128.0 + (r - y) / 1.402]
    };
    let pair = |pair: &[u8; 6]| {
        let (a, b) = (
            yuv([pair[0], pair[1], pair[2]]),
            yuv([pair[3], pair[4], pair[5]]),
        );
        let values = [
            a[0],
            f64::midpoint(a[1], b[1]),
            b[0],
            f64::midpoint(a[2], b[2]),
        ];
        let mut bytes = [0; 4];
        for (place, value) in places.into_iter().zip(values) {
            bytes[place] = code(value);
        }
        bytes
    };
    rgb.as_chunks::<6>().0.iter().flat_map(pair).collect()
}

fn ours(format: ColorFormat, width: u32, height: u32) -> Result<Row, Failure> {
    let mut encoder = ColorEncoder::new(format, width, height)?;
    let mut decoder = ColorDecoder::new(format, width, height)?;
    Ok(Candidate {
        name: "median edge + zstd 1 (ours)",
        encode: Box::new(move |frame, payload| {
            payload.resize(encoder.max_payload_bytes(), 0);
            let length = encoder.encode(frame, payload)?;
            payload.truncate(length);
            Ok(())
        }),
        decode: Box::new(move |payload, frame| Ok(decoder.decode(payload, frame)?)),
    })
}

fn zstd_alone(format: ColorFormat) -> Result<Row, Failure> {
    let mut compressor = zstd::bulk::Compressor::new(1)?;
    let mut decompressor = zstd::bulk::Decompressor::new()?;
    Ok(Candidate {
        name: if format == ColorFormat::Rgb8 {
            "zstd 1 of RGB"
        } else {
            "zstd 1"
        },
        encode: Box::new(move |frame, payload| {
            payload.resize(zstd::zstd_safe::compress_bound(frame.len()), 0);
            let length = compressor.compress_to_buffer(frame, payload.as_mut_slice())?;
            payload.truncate(length);
            Ok(())
        }),
        decode: Box::new(move |payload, frame| {
            decompressor.decompress_to_buffer(payload, frame)?;
            Ok(())
        }),
    })
}
