//! How well mosaics of real colour are interpolated, beside bilinear in the same linear light: `shared/data/colour-png`,
//! lossless frames of a PrimeSense camera, mosaiced again. They were interpolated once, by the camera, so sharp detail
//! that sets methods apart is rare. Skipped by name where the data is absent.

use std::path::{Path, PathBuf};

use imaging::develop::codes;
use imaging::{ColorLayout, Image, Response, Rgb8Image, decode_png_rgb8};

fn frames() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
    let folder = root.join("shared/data/colour-png");
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut paths: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|e| e == "png"))
        .collect();
    paths.sort();
    paths
}

fn channel_at(x: u32, y: u32) -> usize {
    [[1, 0], [2, 1]][(y % 2) as usize][(x % 2) as usize]
}

/// Each missing colour as the mean of the linear radiance of its neighbours in the 3x3 block.
fn bilinear(mosaic: &Image<u8>, response: &Response) -> Rgb8Image {
    Image::from_fn(mosaic.width(), mosaic.height(), |x, y| {
        std::array::from_fn(|channel| {
            if channel_at(x, y) == channel {
                return mosaic.at(x, y);
            }
            let (mut sum, mut count) = (0.0, 0.0);
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                let (nx, ny) = (i64::from(x) + dx, i64::from(y) + dy);
                let is_site = channel_at((nx & 1) as u32, (ny & 1) as u32) == channel;
                if let Some(code) = mosaic.get(nx, ny).filter(|_| is_site) {
                    sum += response.linear(code, channel);
                    count += 1.0;
                }
            }
            response.code(sum / count, channel).round() as u8
        })
    })
}

/// Peak signal to noise, decibels, without a border of 4 pixels.
fn psnr(truth: &Rgb8Image, got: &Rgb8Image) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 4..truth.height() - 4 {
        for x in 4..truth.width() - 4 {
            for (a, b) in truth.at(x, y).into_iter().zip(got.at(x, y)) {
                sum += (f64::from(a) - f64::from(b)).powi(2);
                count += 1.0;
            }
        }
    }
    10.0 * (255.0 * 255.0 * count / sum).log10()
}

#[test]
fn edges_of_real_frames_are_kept_better_than_by_bilinear_interpolation() {
    let paths = frames();
    if paths.is_empty() {
        println!("skipped: no frames in shared/data/colour-png");
        return;
    }
    let response = Response::gamma(2.2).unwrap();
    let (mut gain, mut worst) = (0.0, f64::INFINITY);
    for path in &paths {
        let truth = decode_png_rgb8(&std::fs::read(path).unwrap()).unwrap();
        let (width, height) = (truth.width(), truth.height());
        let mosaic = Image::from_fn(width, height, |x, y| truth.at(x, y)[channel_at(x, y)]);
        let frame = mosaic.pixels();
        let ours = codes(&response, ColorLayout::BayerGrbg, frame, width, height).unwrap();
        let plain = psnr(&truth, &bilinear(&mosaic, &response));
        let ours = psnr(&truth, &ours);
        println!("{ours:.2} dB, bilinear {plain:.2} dB");
        gain += (ours - plain) / paths.len() as f64;
        worst = worst.min(ours - plain);
    }
    println!(
        "mean gain {gain:.2} dB, least {worst:.2} dB over {} frames",
        paths.len()
    );
    assert!(worst > 0.0 && gain > 0.3, "{gain} {worst}");
}
