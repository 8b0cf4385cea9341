use geometry::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::image::Image;
use crate::kernels::Level;
use crate::linear_pixel::LinearPixel;
use crate::radiance::Corrector;
use crate::response::Response;
use crate::vignetting::Vignetting;

const LAYOUTS: [ColorLayout; 6] = [
    ColorLayout::Rgb8,
    ColorLayout::BayerGrbg,
    ColorLayout::Uyvy(YuvCoding {
        matrix: YuvMatrix::Bt601,
        range: YuvRange::Limited,
        siting: ChromaSiting::Left,
    }),
    ColorLayout::Uyvy(YuvCoding {
        matrix: YuvMatrix::Bt709,
        range: YuvRange::Full,
        siting: ChromaSiting::Center,
    }),
    ColorLayout::Yuyv(YuvCoding {
        matrix: YuvMatrix::Bt601,
        range: YuvRange::Full,
        siting: ChromaSiting::Left,
    }),
    ColorLayout::Yuyv(YuvCoding {
        matrix: YuvMatrix::Bt709,
        range: YuvRange::Limited,
        siting: ChromaSiting::Center,
    }),
];

/// A lens whose corners are invalid.
fn corrector(width: u32, height: u32) -> Corrector {
    let center = 0.5 * DVec2::new(f64::from(width), f64::from(height));
    let lens =
        Vignetting::even_polynomial(center, center.length().max(1.0), [-1.0, 0.0, 0.0]).unwrap();
    Corrector::new(&Response::gamma(2.2).unwrap(), &lens, width, height, 0.8)
}

/// Mostly mild codes with some clipped ones.
fn noise(layout: ColorLayout, width: u32, height: u32, seed: u64) -> Vec<u8> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..layout.frame_bytes(width, height))
        .map(|_| match rng.random_range(0..200) {
            0 => 255,
            _ => rng.random_range(20..160),
        })
        .collect()
}

struct Developed {
    pixels: Vec<LinearPixel>,
    grey: Vec<f32>,
}

fn developed(developer: &mut Developer, frame: &[u8], chroma_subsampled: bool) -> Developed {
    let (width, height) = (developer.width() as usize, developer.height() as usize);
    // Left over from another frame: every place must be written.
    let mut pixels = vec![LinearPixel([9; 4]); width * height];
    let mut grey = vec![-7.0; (width / 2) * (height / 2)];
    developer
        .develop(frame, chroma_subsampled, &mut pixels, &mut grey)
        .unwrap();
    Developed { pixels, grey }
}

#[test]
fn the_live_path_is_training_radiance_in_fixed_point() {
    for layout in LAYOUTS {
        for (width, height) in [(70, 131), (2, 2), (4, 1), (66, 60), (34, 61)] {
            let corrector = corrector(width, height);
            let frame = noise(layout, width, height, 3);
            for chroma_subsampled in [false, true] {
                let radiance = radiance(&corrector, layout, &frame, chroma_subsampled).unwrap();
                let mut developer = Developer::new(&corrector, layout).unwrap();
                let live = developed(&mut developer, &frame, chroma_subsampled);
                for (at, &pixel) in live.pixels.iter().enumerate() {
                    let expected = if radiance.invalid.pixels()[at] {
                        LinearPixel::INVALID
                    } else {
                        let is_saturated = radiance.saturated.pixels()[at];
                        LinearPixel::from_radiance(radiance.linear.pixels()[at], is_saturated)
                    };
                    assert_eq!(pixel, expected, "{layout:?} {width}x{height}, pixel {at}");
                }
            }
        }
    }
}

#[test]
fn grey_is_the_mean_luminance_of_the_block() {
    for layout in LAYOUTS {
        let (width, height) = (70_u32, 123_u32);
        let mut developer = Developer::new(&corrector(width, height), layout).unwrap();
        let live = developed(&mut developer, &noise(layout, width, height, 4), false);
        let mut counted = [0; 5];
        for (at, &grey) in live.grey.iter().enumerate() {
            let (x, y) = (2 * (at % 35), 2 * (at / 35));
            let block = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(dx, dy)| live.pixels[(y + dy) * width as usize + x + dx]);
            let plain = block.iter().filter(|p| p.is_valid() && !p.is_saturated());
            let luminances: Vec<f64> = plain
                .map(|pixel| {
                    let [r, g, b] = pixel.radiance().map(f64::from);
                    0.2126 * r + 0.7152 * g + 0.0722 * b
                })
                .collect();
            counted[luminances.len()] += 1;
            let mean = luminances.iter().sum::<f64>() / luminances.len().max(1) as f64;
            assert!(
                (f64::from(grey) - mean).abs() < 1e-6,
                "{layout:?} block {at}"
            );
        }
        assert!(counted[0] > 0 && counted[4] > 0, "{counted:?}");
    }
}

#[test]
fn levels_and_threads_do_not_change_a_bit() {
    for layout in LAYOUTS {
        let corrector = corrector(66, 250);
        let frame = noise(layout, 66, 250, 5);
        let run = |threads: usize, level: Level| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let mut developer = Developer::with_level(&corrector, layout, level).unwrap();
            pool.install(|| developed(&mut developer, &frame, true))
        };
        let reference = run(1, Level::Scalar);
        for (threads, level) in [(1, Level::Avx2), (2, Level::Scalar), (3, Level::Avx2)] {
            let other = run(threads, level);
            assert_eq!(reference.pixels, other.pixels, "{layout:?} {level:?}");
            assert_eq!(reference.grey, other.grey, "{layout:?} {level:?}");
        }
    }
}

#[test]
fn frames_of_another_size_are_refused() {
    let corrector = corrector(8, 6);
    for layout in LAYOUTS {
        let mut developer = Developer::new(&corrector, layout).unwrap();
        let frame = noise(layout, 8, 6, 6);
        let mut pixels = vec![LinearPixel::INVALID; 48];
        let mut grey = [0.0; 12];
        let mut refuses = |frame: &[u8], pixel_count: usize, grey_count: usize| {
            developer
                .develop(
                    frame,
                    false,
                    &mut pixels[..pixel_count],
                    &mut grey[..grey_count],
                )
                .is_err()
        };
        assert!(!refuses(&frame, 48, 12));
        assert!(refuses(&frame[1..], 48, 12));
        assert!(refuses(&[], 48, 12));
        assert!(refuses(&frame, 47, 12) && refuses(&frame, 48, 11));
        assert!(radiance(&corrector, layout, &frame[1..], false).is_err());
        assert!(codes(&Response::identity(), layout, &frame, 6, 9).is_err());
    }
    let odd = Corrector::new(&Response::identity(), &Vignetting::none(), 7, 6, 1.0);
    assert!(Developer::new(&odd, LAYOUTS[2]).is_err());
    assert!(Developer::new(&odd, ColorLayout::BayerGrbg).is_ok());
    let empty = Corrector::new(&Response::identity(), &Vignetting::none(), 0, 6, 1.0);
    assert!(Developer::new(&empty, ColorLayout::Rgb8).is_err());
}

#[test]
fn a_grey_scene_stays_grey_in_every_layout() {
    // Neutral codes: 128 is the zero of chroma, and the luma of limited range that stands for a code.
    for layout in LAYOUTS {
        let limited = |coding: YuvCoding| coding.range == YuvRange::Limited;
        let (frame, expected) = match layout {
            ColorLayout::Rgb8 => (vec![100; 3 * 12 * 10], 100),
            ColorLayout::BayerGrbg => (vec![100; 12 * 10], 100),
            ColorLayout::Uyvy(coding) => (
                [128, 100].repeat(12 * 10),
                if limited(coding) { 98 } else { 100 },
            ),
            ColorLayout::Yuyv(coding) => (
                [100, 128].repeat(12 * 10),
                if limited(coding) { 98 } else { 100 },
            ),
        };
        let image = codes(&Response::gamma(2.2).unwrap(), layout, &frame, 12, 10).unwrap();
        assert_eq!(image, Image::new(12, 10, [expected; 3]), "{layout:?}");
    }
}

#[test]
fn sites_of_a_mosaic_keep_the_code_of_the_sensor() {
    for (width, height) in [(13, 9), (1, 1), (2, 1), (1, 4), (2, 2), (3, 3)] {
        let frame = noise(ColorLayout::BayerGrbg, width, height, 8);
        let response = Response::gamma(2.2).unwrap();
        let image = codes(&response, ColorLayout::BayerGrbg, &frame, width, height).unwrap();
        for y in 0..height {
            for x in 0..width {
                let channel = [[1, 0], [2, 1]][(y % 2) as usize][(x % 2) as usize];
                let code = frame[(y * width + x) as usize];
                assert_eq!(
                    image.at(x, y)[channel],
                    code,
                    "({x}, {y}) of {width}x{height}"
                );
            }
        }
    }
}

#[test]
fn each_colour_of_a_flat_mosaic_fills_the_image() {
    let scene = [180, 90, 40];
    let frame: Vec<u8> = (0..9 * 8)
        .map(|at| scene[[[1, 0], [2, 1]][(at / 9) % 2][(at % 9) % 2]])
        .collect();
    let image = codes(&Response::identity(), ColorLayout::BayerGrbg, &frame, 9, 8).unwrap();
    assert_eq!(image, Image::new(9, 8, scene));
}

#[test]
fn chroma_sits_where_the_siting_says() {
    // Luma constant, V a step between the second and the third pair.
    let v = [100, 100, 140, 140];
    let frame: Vec<u8> = v.into_iter().flat_map(|v| [128, 128, 128, v]).collect();
    let red = |siting| {
        let coding = YuvCoding {
            range: YuvRange::Full,
            siting,
            ..YuvCoding::default()
        };
        let image = codes(
            &Response::identity(),
            ColorLayout::Yuyv(coding),
            &frame,
            8,
            1,
        )
        .unwrap();
        image.map(|code| i32::from(code[0])).into_pixels()
    };
    let of = |v: f64| (128.0 + 1.402 * (v - 128.0)).round() as i32;
    assert_eq!(
        red(ChromaSiting::Left),
        [100.0, 100.0, 100.0, 120.0, 140.0, 140.0, 140.0, 140.0].map(of)
    );
    assert_eq!(
        red(ChromaSiting::Center),
        [100.0, 100.0, 100.0, 110.0, 130.0, 140.0, 140.0, 140.0].map(of)
    );
}
