use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::super::Level;
use super::{CodeLanes, grey_row, linear_row};
use crate::linear_pixel::LinearPixel;

/// Lengths beyond four vectors of the widest kernel.
const LONGEST: usize = 4 * 16 + 1;

fn random_lanes(rng: &mut Pcg64) -> CodeLanes {
    let mut lanes = [[[0.0; 4]; 256]; 3];
    for (channel, table) in lanes.iter_mut().enumerate() {
        for (code, entry) in table.iter_mut().enumerate() {
            entry[channel] = rng.random::<f32>() * 2.0_f32.powi(rng.random_range(-30..6));
            entry[3] = if code >= 250 { 2.0 } else { 0.0 };
            if channel == 0 {
                entry[3] += 1.0;
            }
        }
    }
    lanes[0][7][0] = f32::MAX;
    lanes[1][9][1] = f32::MIN_POSITIVE / 2.0;
    lanes
}

#[test]
fn vector_rows_equal_their_scalar_twins() {
    if !Level::Avx2.is_usable() {
        println!("skipped: this machine has no AVX2");
        return;
    }
    let mut rng = Pcg64::seed_from_u64(11);
    let lanes = random_lanes(&mut rng);
    for length in 0..=LONGEST {
        for offset in 0..3 {
            let total = length + offset;
            let codes: Vec<[u8; 3]> = (0..total).map(|_| rng.random()).collect();
            let scale: Vec<f32> = (0..total)
                .map(|_| match rng.random_range(0..8) {
                    0 => 0.0,
                    1 => 1e9,
                    _ => 16_384.0 * (1.0 + 9.0 * rng.random::<f32>()),
                })
                .collect();
            let made = |level| {
                let mut pixels = vec![LinearPixel([7; 4]); total];
                let row = &mut pixels[offset..];
                linear_row(level, &lanes, &codes[offset..], &scale[offset..], row);
                pixels
            };
            assert_eq!(made(Level::Scalar), made(Level::Avx2), "{length} pixels");
        }
    }
}

#[test]
fn vector_grey_equals_its_scalar_twin() {
    if !Level::Avx2.is_usable() {
        println!("skipped: this machine has no AVX2");
        return;
    }
    let mut rng = Pcg64::seed_from_u64(12);
    for length in 0..=LONGEST {
        // Mostly plain pixels, so that both branches of the vector kernel are met.
        let mut row = |share: u32| -> Vec<LinearPixel> {
            (0..length)
                .map(|_| {
                    let [r, g, b]: [u16; 3] = rng.random();
                    let is_odd = rng.random_range(0..100) < share;
                    let flags = if is_odd {
                        [0, 3][rng.random_range(0..2)]
                    } else {
                        1
                    };
                    LinearPixel([r, g, b, flags])
                })
                .collect()
        };
        for share in [0, 2, 50, 100] {
            let (above, below) = (row(share), row(share));
            let made = |level| {
                let mut grey = vec![-1.0_f32; length / 2];
                grey_row(level, &above, &below, &mut grey);
                grey
            };
            assert_eq!(made(Level::Scalar), made(Level::Avx2), "{length} pixels");
        }
    }
}

#[test]
fn grey_is_the_mean_luminance_of_what_counts() {
    let plain = LinearPixel([16_384, 16_384, 16_384, 1]);
    let dark = LinearPixel([0, 8192, 0, 1]);
    let clipped = LinearPixel([65_535, 65_535, 65_535, 3]);
    let mut grey = [0.0; 2];
    let above = [plain, clipped, clipped, LinearPixel::INVALID];
    let below = [dark, LinearPixel::INVALID, clipped, clipped];
    grey_row(Level::Scalar, &above, &below, &mut grey);
    assert!((grey[0] - 0.5 * (1.0 + 0.5 * 0.7152)).abs() < 1e-6);
    assert_eq!(grey[1], 0.0);
}
